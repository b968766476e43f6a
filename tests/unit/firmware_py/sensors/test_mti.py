"""MTi driver: set-up, recovery, valid headings and reported faults."""

import itertools
import math
import struct

import numpy as np
import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.sensors.mti import MtiCompass, MtiOptions
from hil.devices.mti import MtiEmulator

DATA_TIMEOUT_S = 1.0
REPLY_TIMEOUT_S = 0.5
WAKE_UP_S = 0.05
# Message ids, and data identifiers.
MT_DATA2, ERROR, OUTPUT_ACK, DEVICE_ID = 0x36, 0x42, 0xC1, 0x01
STATUS_WORD, EULER_NED, EULER_ENU, RATE_OF_TURN = 0xE020, 0x2034, 0x2030, 0x8020

GO_TO_CONFIG, ASK_OUTPUT, GO_TO_MEASUREMENT, WAKE_UP_ACK = (
    bytes.fromhex(text) for text in ("FAFF3000D1", "FAFFC00041", "FAFF1000F1", "FAFF3F00C2")
)
# Status word in each message, Euler angles as floats in NED at 10 Hz, rate of turn, temperature.
REQUIRED = bytes.fromhex("E020FFFF2034000A8020000A08100001")


def message(message_id, data=b""):
    body = bytes([0xFF, message_id, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def output(hexadecimal=""):
    return message(OUTPUT_ACK, bytes.fromhex(hexadecimal))


SET_OUTPUT, OUTPUT_REQUIRED = message(0xC0, REQUIRED), message(OUTPUT_ACK, REQUIRED)
IN_CONFIG, MEASURING, WAKE_UP = message(0x31), message(0x11), message(0x3E)


def data(heading_deg=98.5, *, status=3, identifier=EULER_NED, pitch_deg=1.5, roll_deg=177.5):
    yaw_deg = heading_deg - 360.0 if heading_deg > 180.0 else heading_deg
    return message(
        MT_DATA2,
        struct.pack(">HBI", STATUS_WORD, 4, status)
        + struct.pack(">HB3f", identifier, 12, roll_deg, pitch_deg, yaw_deg)
        + struct.pack(">HB3f", RATE_OF_TURN, 12, 0.0, 0.0, -0.25),
    )


@pytest.fixture
def compass(line):
    return MtiCompass(line, MtiOptions())


@pytest.fixture
def exchange(line, compass):
    """Function that delivers packets of the device at a time and returns the commands of the driver."""

    def exchange(now_s, *packets):
        sent = len(line.written)
        line.inbox += b"".join(packets)
        compass.receive(now_s)
        return line.written[sent:]

    return exchange


# Rows of time, packets of the device, commands of the driver.
SET_UP = [
    (0.0, (), [GO_TO_CONFIG]),
    (0.0, (IN_CONFIG,), [ASK_OUTPUT]),
    (0.0, (output("E020FFFF20300064"),), [SET_OUTPUT]),
    (0.0, (OUTPUT_REQUIRED,), [GO_TO_MEASUREMENT]),
    (0.0, (MEASURING,), []),
]
LOWER_RATE = output("E020FFFF203400058020000508100001")
TRANSCRIPTS = {
    "the output is already set": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.1, (IN_CONFIG,), [ASK_OUTPUT]),
        (0.2, (OUTPUT_REQUIRED,), [GO_TO_MEASUREMENT]),
    ],
    "a lower rate is accepted, also after a wake-up": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.0, (IN_CONFIG,), [ASK_OUTPUT]),
        (0.0, (output(),), [SET_OUTPUT]),
        (0.0, (LOWER_RATE,), [GO_TO_MEASUREMENT]),
        (0.1, (WAKE_UP,), [WAKE_UP_ACK]),
        (0.2, (), [GO_TO_CONFIG]),
        (0.2, (IN_CONFIG,), [ASK_OUTPUT]),
        (0.2, (LOWER_RATE,), [GO_TO_MEASUREMENT]),
    ],
    "unexpected acknowledgements have no effect": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.1, (MEASURING, OUTPUT_REQUIRED, message(DEVICE_ID, bytes(4))), []),
        (0.2, (IN_CONFIG, IN_CONFIG, IN_CONFIG), [ASK_OUTPUT]),
    ],
    "acknowledgements while measuring have no effect": [
        *SET_UP,
        (0.5, (MEASURING, OUTPUT_REQUIRED, IN_CONFIG, data()), []),
    ],
    "silence restarts the set-up": [
        *SET_UP,
        (0.5, (data(),), []),
        (0.5 + DATA_TIMEOUT_S - 0.01, (), []),
        (0.5 + DATA_TIMEOUT_S, (), [GO_TO_CONFIG]),
    ],
    "a wake-up restarts the set-up": [*SET_UP, (0.5, (WAKE_UP,), [WAKE_UP_ACK]), (0.5 + WAKE_UP_S, (), [GO_TO_CONFIG])],
    "an error during the set-up restarts it after a pause": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.1, (message(ERROR, b"\x21"),), []),  # invalid parameter
        (0.5, (IN_CONFIG,), []),
        (0.1 + DATA_TIMEOUT_S - 0.01, (), []),
        (0.1 + DATA_TIMEOUT_S, (), [GO_TO_CONFIG]),
    ],
    "a device without Euler angles is configured again after a pause": [
        *SET_UP[:3],
        (0.0, (output("E020FFFF80200064"),), []),
        (DATA_TIMEOUT_S - 0.01, (), []),
        (DATA_TIMEOUT_S, (), [GO_TO_CONFIG]),
    ],
}


@pytest.mark.parametrize("transcript", TRANSCRIPTS.values(), ids=TRANSCRIPTS)
def test_set_up(exchange, transcript):
    for now_s, packets, commands in transcript:
        assert exchange(now_s, *packets) == commands


@pytest.fixture
def set_up(exchange):
    """Acknowledge every command, at 0 s."""
    for now_s, packets, _ in SET_UP:
        exchange(now_s, *packets)


@pytest.mark.parametrize(
    ("packets", "text"),
    [
        ([b"\x80\x10"], "data not understood: wrong baud rate?"),
        ([IN_CONFIG], "connected, no heading yet"),
        ([IN_CONFIG, message(ERROR, b"\x21")], "device error 33: parameter invalid"),
        ([IN_CONFIG, output(), output("E020FFFF80200064")], "gives no Euler angles and status: no AHRS model?"),
    ],
)
def test_problem_before_the_first_heading_is_reported(compass, exchange, packets, text):
    exchange(0.0)
    for packet in packets:
        exchange(0.0, packet)
    assert compass.health(0.1).text == text


def test_command_without_reply_is_repeated_at_the_reply_timeout(line, exchange):
    times = [step / 100 for step in range(3000) if exchange(step / 100)]
    assert all(later - earlier >= REPLY_TIMEOUT_S - 1e-9 for earlier, later in itertools.pairwise(times))
    assert line.written == [GO_TO_CONFIG] * 60


def test_command_is_repeated_after_a_blocked_line(line, exchange):
    line.full = True
    assert exchange(0.0) == []
    assert exchange(0.1, IN_CONFIG) == []  # the command was not sent
    line.full = False
    assert exchange(REPLY_TIMEOUT_S) == [GO_TO_CONFIG]


def test_headings_are_magnetic_with_the_arrival_time_of_the_last_byte(deliver, compass, set_up, near):
    packet = data(269.5)
    assert deliver(compass, packet[:-1], now_s=1.0) == ()
    (sample,) = deliver(compass, packet[-1:], now_s=1.1)
    assert near(sample.heading_rad, 269.5)
    assert near(sample.pitch_rad, 1.5)
    assert near(sample.roll_rad, -2.5)
    assert (sample.t_s, sample.reference, sample.variation_rad) == (1.1, NorthReference.MAGNETIC, None)
    assert sample.yaw_rate_rad_s == pytest.approx(0.25, rel=0.01)  # label up: positive z is to port
    assert compass.health(1.1).state is DeviceState.RUNNING


def test_nothing_is_sent_while_headings_arrive(exchange, compass, set_up):
    assert [command for tenth in range(100) for command in exchange(tenth / 10, data())] == []
    assert len(compass.poll()) == 100


def test_reopened_port_is_set_up_again(line, exchange, compass, set_up):
    exchange(0.5, data(), data()[:9])
    assert compass.fileno() == line.fileno()
    line.unplug()
    assert exchange(0.7) == []
    assert compass.fileno() == -1
    line.plug()
    assert exchange(0.8) == [GO_TO_CONFIG]
    assert exchange(0.9, IN_CONFIG) == [ASK_OUTPUT]
    assert compass.health(0.9).rejected == 0  # the incomplete message was discarded


def test_invalid_orientation_gives_no_heading_and_no_new_set_up(exchange, compass, set_up):
    assert [command for tenth in range(50) for command in exchange(tenth / 10, data(status=1))] == []
    assert compass.poll() == ()
    health = compass.health(5.0)
    assert (health.state, health.text) == (DeviceState.FAULTY, "orientation not valid")
    exchange(5.1, data())
    assert len(compass.poll()) == 1
    assert compass.health(5.1).state is DeviceState.RUNNING


def test_data_without_angles_or_status_give_no_heading(deliver, compass, set_up):
    assert deliver(compass, message(MT_DATA2, struct.pack(">HBI", STATUS_WORD, 4, 3))) == ()
    assert compass.health(1.0).accepted == 0
    assert deliver(compass, message(MT_DATA2, struct.pack(">HB3f", EULER_NED, 12, 0.0, 0.0, 90.0))) == ()
    assert compass.health(1.0).text == "data without status"
    assert len(deliver(compass, data())) == 1
    assert compass.health(1.0).text == ""


@pytest.mark.parametrize(("status", "text"), [(2, "self-test failed"), (3 | 1 << 14, "out of range: magnetometer")])
def test_reported_fault_is_faulty_and_keeps_the_heading(deliver, compass, set_up, status, text):
    assert len(deliver(compass, data(status=status))) == 1
    health = compass.health(1.0)
    assert (health.state, health.text) == (DeviceState.FAULTY, text)


def test_other_frame_than_ned_gives_no_heading(deliver, compass, set_up):
    for tenth in range(30):
        assert deliver(compass, data(identifier=EULER_ENU), now_s=tenth / 10) == ()
    assert compass.health(3.0).text == "Euler angles in ENU, not in NED"


def test_error_while_measuring_is_only_reported(exchange, compass, set_up):
    assert exchange(0.5, message(ERROR, b"\x29"), data()) == []
    assert compass.health(0.5).text == "device error 41: more data than the baud rate allows"
    assert len(compass.poll()) == 1


def test_rejected_messages_are_counted(deliver, compass, set_up):
    damaged = bytearray(data())
    damaged[20] ^= 1
    deliver(compass, data(), bytes(damaged), data(pitch_deg=math.nan), b"\x00\xfa\x07noise", data())
    health = compass.health(1.0)
    assert (health.accepted, health.rejected) == (2, 2)
    assert health.text == "pitch nan out of range"


@pytest.mark.parametrize("rate_hz", [0, -1, 101, 2.5, math.nan, math.inf])
def test_invalid_rates_are_rejected(rate_hz):
    with pytest.raises(ValueError, match=r"rate_hz: .*(whole number|1 to 100)"):
        MtiOptions(rate_hz=rate_hz)


def test_low_rate_has_longer_timeouts(line, deliver):
    assert MtiOptions(rate_hz=100).rate_hz == 100  # the highest rate
    compass = MtiCompass(line, MtiOptions(rate_hz=1))
    slow = message(OUTPUT_ACK, bytes.fromhex("E020FFFF203400018020000108100001"))
    for packet in (b"", IN_CONFIG, slow, MEASURING, data()):
        deliver(compass, packet, now_s=1.0)
    assert line.written == [GO_TO_CONFIG, ASK_OUTPUT, GO_TO_MEASUREMENT]
    assert [compass.health(now_s).state for now_s in (4.0, 4.1)] == [DeviceState.RUNNING, DeviceState.SILENT]
    compass.receive(3.9)
    assert len(line.written) == 3
    compass.receive(4.0)
    assert len(line.written) == 4


class TurningBoat:
    def heading_rad(self):
        return math.radians(350.0)

    def yaw_rate_rad_s(self):
        return 0.2


def run(line, compass, emulator, start_s, end_s):
    """Connect driver and emulator in steps of 10 ms; return the samples."""
    samples = []
    for step in range(round(start_s * 100), round(end_s * 100)):
        now_s = step / 100
        line.inbox += emulator.take_output(now_s)
        sent = len(line.written)
        compass.receive(now_s)
        for command in line.written[sent:]:
            emulator.receive(now_s, command)
        samples += compass.poll()
    return samples


def test_driver_with_emulator(line, compass):
    emulator = MtiEmulator(
        TurningBoat(),
        np.random.default_rng(1),
        noise_deg=0.0,
        tilt_noise_deg=0.0,
        turn_noise_rad_s=0.0,
        declination_deg=12.0,
    )
    emulator.pitch_deg, emulator.roll_deg = 4.0, -12.0
    samples = run(line, compass, emulator, 0.0, 5.0)
    assert 42 <= len(samples) <= 48
    assert math.degrees(samples[-1].heading_rad) == pytest.approx(338.0, abs=1e-4)
    assert math.degrees(samples[-1].pitch_rad) == pytest.approx(4.0, abs=1e-4)
    assert math.degrees(samples[-1].roll_rad) == pytest.approx(-12.0, abs=1e-4)
    assert samples[-1].yaw_rate_rad_s == pytest.approx(0.2, abs=1e-6)
    assert 4 <= sum(sample.temperature_c is not None for sample in samples) <= 6  # once a second
    assert compass.health(5.0).state is DeviceState.RUNNING


def test_output_is_not_stored_again_after_a_power_cut(line, compass):
    emulator = MtiEmulator(TurningBoat(), np.random.default_rng(1))
    assert run(line, compass, emulator, 0.0, 3.0)
    emulator.power_cycle(3.0, off_s=1.0)
    assert run(line, compass, emulator, 3.0, 4.2) == []
    assert len(run(line, compass, emulator, 4.2, 7.0)) > 15
    assert emulator.stored == 1
    assert WAKE_UP_ACK in line.written
