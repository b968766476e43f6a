"""The MTi driver sets its device up, keeps at it, and gives only headings that the device stands by."""

import itertools
import math
import struct

import numpy as np
import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.sensors.mti import DATA_TIMEOUT_S, REPLY_TIMEOUT_S, WAKE_UP_S, MtiCompass, MtiOptions
from hil.devices.mti import MtiEmulator

GO_TO_CONFIG, ASK_OUTPUT, GO_TO_MEASUREMENT, WAKE_UP_ACK = (
    bytes.fromhex(text) for text in ("FAFF3000D1", "FAFFC00041", "FAFF1000F1", "FAFF3F00C2")
)
# Status word with each message, Euler angles as floats in NED at 10 Hz, rate of turn, temperature.
WANTED = bytes.fromhex("E020FFFF2034000A8020000A08100001")


def message(mid, data=b""):
    body = bytes([0xFF, mid, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


SET_OUTPUT = message(0xC0, WANTED)


def data(heading_deg=98.5, *, status=3, identifier=0x2034, pitch_deg=1.5, roll_deg=177.5):
    yaw_deg = heading_deg - 360.0 if heading_deg > 180.0 else heading_deg
    return message(
        0x36,
        struct.pack(">HBI", 0xE020, 4, status)
        + struct.pack(">HB3f", identifier, 12, roll_deg, pitch_deg, yaw_deg)
        + struct.pack(">HB3f", 0x8020, 12, 0.0, 0.0, -0.25),
    )


@pytest.fixture
def compass(line):
    return MtiCompass(line, MtiOptions())


@pytest.fixture
def hear(line, compass):
    """Have the device say something at a time; what the driver writes upon it."""

    def at(now_s, *packets):
        before = len(line.written)
        line.inbox += b"".join(packets)
        compass.receive(now_s)
        return line.written[before:]

    return at


@pytest.fixture
def set_up(hear):
    """Acknowledge every command, at 0 s."""
    for now_s, packets, _ in SET_UP:
        hear(now_s, *packets)


def test_a_device_without_orientation_is_reported_and_configured_again_after_a_pause(hear, compass):
    hear(0.0)
    hear(0.0, message(0x31))
    hear(0.0, message(0xC1, b""))
    assert hear(0.0, message(0xC1, bytes.fromhex("E020FFFF80200064"))) == []
    assert compass.health(0.1).text == "gives no Euler angles and status: no AHRS model?"
    assert hear(DATA_TIMEOUT_S - 0.01) == []
    assert hear(DATA_TIMEOUT_S) == [GO_TO_CONFIG]


def test_a_device_that_answers_and_measures_nothing_is_not_said_to_have_another_baud_rate(compass, hear):
    hear(0.0, b"\x80\x10")
    assert "baud rate" in compass.health(0.0).text
    hear(0.1, message(0x31))
    assert compass.health(0.1).text == "connected, no heading yet"


def test_an_unanswered_command_is_never_a_flood(line, compass):
    times = []
    for step in range(3000):  # 30 s in steps of 10 ms
        before = len(line.written)
        compass.receive(step / 100)
        times += [step / 100] * (len(line.written) - before)
    assert all(later - earlier >= REPLY_TIMEOUT_S - 1e-9 for earlier, later in itertools.pairwise(times))
    assert set(line.written) == {GO_TO_CONFIG}
    assert len(times) == 60


def test_acknowledgements_while_measuring_or_before_the_command_left_change_nothing(line, hear, set_up):
    assert hear(0.5, message(0x11), message(0xC1, WANTED), message(0x31), data()) == []
    line.full = True
    hear(2.0)
    assert hear(2.1, message(0x31)) == []
    line.full = False
    assert hear(2.5) == [GO_TO_CONFIG]


def test_headings_are_magnetic_and_stamped_with_their_last_byte(line, compass, set_up, near):
    whole = data(269.5)
    line.inbox += whole[:-1]
    compass.receive(1.0)
    assert compass.poll() == ()
    line.inbox += whole[-1:]
    compass.receive(1.1)
    (sample,) = compass.poll()
    assert near(sample.heading_rad, 269.5)
    assert near(sample.pitch_rad, 1.5)
    assert near(sample.roll_rad, -2.5)
    assert (sample.t_s, sample.reference, sample.variation_rad) == (1.1, NorthReference.MAGNETIC, None)
    assert sample.yaw_rate_rad_s == pytest.approx(0.25, rel=0.01)  # label up: to port is positive z
    assert compass.health(1.1).state is DeviceState.RUNNING


def test_nothing_is_sent_while_headings_come(hear, compass, set_up):
    assert [written for tenth in range(100) for written in hear(tenth / 10, data())] == []
    assert len(compass.poll()) == 100


def test_a_port_that_was_opened_again_is_set_up_again(line, hear, compass, set_up):
    hear(0.5, data(), data()[:9])
    line.unplug()
    hear(0.7)
    line.plug()
    assert hear(0.8) == [GO_TO_CONFIG]
    assert hear(0.9, message(0x31)) == [ASK_OUTPUT]
    assert compass.health(0.9).rejected == 0  # the half message of before is no damaged one


def test_an_orientation_that_is_not_valid_gives_no_heading_and_is_left_to_settle(hear, compass, set_up):
    assert [written for tenth in range(50) for written in hear(tenth / 10, data(status=1))] == []
    assert compass.poll() == ()
    health = compass.health(5.0)
    assert (health.state, health.text) == (DeviceState.FAULTY, "orientation not valid")
    hear(5.1, data())
    assert len(compass.poll()) == 1
    assert compass.health(5.1).state is DeviceState.RUNNING


@pytest.mark.parametrize(("status", "text"), [(2, "self-test failed"), (3 | 1 << 14, "out of range: magnetometer")])
def test_a_device_that_complains_is_faulty_and_still_heard(hear, compass, set_up, status, text):
    hear(0.5, data(status=status))
    assert len(compass.poll()) == 1
    health = compass.health(0.5)
    assert (health.state, health.text) == (DeviceState.FAULTY, text)


def test_another_frame_than_ned_is_no_heading(hear, compass, set_up):
    for tenth in range(30):
        hear(tenth / 10, data(identifier=0x2030))
    assert compass.poll() == ()
    assert compass.health(3.0).text == "Euler angles in ENU, not in NED"


def test_an_error_is_reported_and_ends_the_set_up_for_a_second(hear, compass):
    hear(0.0)
    hear(0.0, message(0x31))
    assert hear(0.1, message(0x42, b"\x21")) == []
    assert compass.health(0.1).text == "device error 33: parameter invalid"
    assert hear(0.1 + DATA_TIMEOUT_S - 0.01) == []
    assert hear(0.1 + DATA_TIMEOUT_S) == [GO_TO_CONFIG]


def test_an_error_while_measuring_is_only_reported(hear, compass, set_up):
    assert hear(0.5, message(0x42, b"\x29"), data()) == []
    assert compass.health(0.5).text == "device error 41: more data than the baud rate carries"
    assert len(compass.poll()) == 1


def test_refused_messages_are_counted(hear, compass, set_up):
    damaged = bytearray(data())
    damaged[20] ^= 1
    hear(0.5, data(), bytes(damaged), data(pitch_deg=math.nan), b"\x00\xfa\x07noise", data())
    health = compass.health(0.5)
    assert (health.accepted, health.rejected) == (2, 2)
    assert health.text == "pitch nan out of range"


def test_a_port_that_takes_nothing_is_tried_again(line, hear):
    line.full = True
    assert hear(0.0) == []
    line.full = False
    assert hear(REPLY_TIMEOUT_S) == [GO_TO_CONFIG]


@pytest.mark.parametrize("rate_hz", [0, -1, 101, 2.5, math.nan, math.inf])
def test_rates_that_the_protocol_cannot_state_are_refused(rate_hz):
    with pytest.raises(ValueError, match=r"rate_hz: .*(whole number|1 to 100)"):
        MtiOptions(rate_hz=rate_hz)


class Turning:
    def __init__(self):
        self.heading = math.radians(350.0)

    def heading_rad(self):
        return self.heading

    def yaw_rate_rad_s(self):
        return 0.2


def sail(line, compass, emulator, start_s, end_s):
    """Let driver and emulator talk over the line, in steps of 10 ms; the samples."""
    samples = []
    for step in range(round(start_s * 100), round(end_s * 100)):
        now_s = step / 100
        line.inbox += emulator.take_output(now_s)
        before = len(line.written)
        compass.receive(now_s)
        for written in line.written[before:]:
            emulator.receive(now_s, written)
        samples += compass.poll()
    return samples


def test_with_an_emulator_that_was_written_from_the_manual(line, compass):
    boat = Turning()
    emulator = MtiEmulator(
        boat, np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0, turn_noise_rad_s=0.0, declination_deg=12.0
    )
    emulator.pitch_deg, emulator.roll_deg = 4.0, -12.0
    samples = sail(line, compass, emulator, 0.0, 5.0)
    assert 42 <= len(samples) <= 48
    assert math.degrees(samples[-1].heading_rad) == pytest.approx(338.0, abs=1e-4)
    assert math.degrees(samples[-1].pitch_rad) == pytest.approx(4.0, abs=1e-4)
    assert math.degrees(samples[-1].roll_rad) == pytest.approx(-12.0, abs=1e-4)
    assert samples[-1].yaw_rate_rad_s == pytest.approx(0.2, abs=1e-6)
    assert 4 <= sum(sample.temperature_c is not None for sample in samples) <= 6  # once a second
    assert compass.health(5.0).state is DeviceState.RUNNING


def test_after_a_power_cut_the_outputs_are_there_and_the_memory_is_spared(line, compass):
    emulator = MtiEmulator(Turning(), np.random.default_rng(1))
    assert sail(line, compass, emulator, 0.0, 3.0)
    emulator.power_cycle(3.0, off_s=1.0)
    assert sail(line, compass, emulator, 3.0, 4.2) == []
    assert len(sail(line, compass, emulator, 4.2, 7.0)) > 15
    assert emulator.stored == 1
    assert WAKE_UP_ACK in line.written


ACKNOWLEDGED, MEASURING, WOKEN = message(0x31), message(0x11), message(0x3E)
SLOWER = message(0xC1, bytes.fromhex("E020FFFF203400058020000508100001"))
SET_UP = [
    (0.0, (), [GO_TO_CONFIG]),
    (0.0, (ACKNOWLEDGED,), [ASK_OUTPUT]),
    (0.0, (message(0xC1, bytes.fromhex("E020FFFF20300064")),), [SET_OUTPUT]),
    (0.0, (message(0xC1, WANTED),), [GO_TO_MEASUREMENT]),
    (0.0, (MEASURING,), []),
]
TRANSCRIPTS = {
    "the output is already set": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.1, (ACKNOWLEDGED,), [ASK_OUTPUT]),
        (0.2, (message(0xC1, WANTED),), [GO_TO_MEASUREMENT]),
    ],
    "a lower rate is accepted, also after a wake-up": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.0, (ACKNOWLEDGED,), [ASK_OUTPUT]),
        (0.0, (message(0xC1, b""),), [SET_OUTPUT]),
        (0.0, (SLOWER,), [GO_TO_MEASUREMENT]),
        (0.1, (WOKEN,), [WAKE_UP_ACK]),
        (0.2, (), [GO_TO_CONFIG]),
        (0.2, (ACKNOWLEDGED,), [ASK_OUTPUT]),
        (0.2, (SLOWER,), [GO_TO_MEASUREMENT]),
    ],
    "unexpected acknowledgements have no effect": [
        (0.0, (), [GO_TO_CONFIG]),
        (0.1, (MEASURING, message(0xC1, WANTED), message(0x01, bytes(4))), []),
        (0.2, (ACKNOWLEDGED, ACKNOWLEDGED, ACKNOWLEDGED), [ASK_OUTPUT]),
    ],
    "silence restarts the set-up": [
        *SET_UP,
        (0.5, (data(),), []),
        (0.5 + DATA_TIMEOUT_S - 0.01, (), []),
        (0.5 + DATA_TIMEOUT_S, (), [GO_TO_CONFIG]),
    ],
    "a wake-up restarts the set-up": [*SET_UP, (0.5, (WOKEN,), [WAKE_UP_ACK]), (0.5 + WAKE_UP_S, (), [GO_TO_CONFIG])],
}


@pytest.mark.parametrize("transcript", TRANSCRIPTS.values(), ids=TRANSCRIPTS)
def test_set_up(hear, transcript):
    """Each step has a time, the packets of the device and the commands of the driver."""
    for now_s, packets, commands in transcript:
        assert hear(now_s, *packets) == commands
