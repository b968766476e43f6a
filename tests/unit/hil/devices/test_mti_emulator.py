import math
import struct

import numpy as np
import pytest

from hil.devices.mti import MtiEmulator

GOTO_CONFIG = bytes.fromhex("FAFF3000D1")
GOTO_MEASUREMENT = bytes.fromhex("FAFF1000F1")
REQ_DID = bytes.fromhex("FAFF000001")
REQ_OUTPUT = bytes.fromhex("FAFFC00041")


def command(mid, data=b""):
    summed = [0xFF, mid, len(data), *data]
    return bytes([0xFA, *summed, 0x100 - sum(summed) % 0x100 & 0xFF])


def outputs(*rows):
    return command(0xC0, b"".join(struct.pack(">HH", *row) for row in rows))


def messages(data):
    """Split a stream into (id, data) and check the checksums."""
    parsed = []
    while data:
        assert data[:2] == b"\xfa\xff"
        length = data[3]
        assert length < 0xFF
        message, data = data[: length + 5], data[length + 5 :]
        assert sum(message[1:]) % 256 == 0
        parsed.append((message[2], message[4:-1]))
    return parsed


def items(content):
    """Split the data of an MTData2 into {identifier: value}."""
    values = {}
    while content:
        identifier, size = struct.unpack(">HB", content[:3])
        values[identifier] = content[3 : 3 + size]
        content = content[3 + size :]
    return values


@pytest.fixture
def mti(boat):
    return MtiEmulator(
        boat, np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0, turn_noise_rad_s=0.0, settle_s=0.15
    )


@pytest.fixture
def ask(run):
    def exchange(device, data, now_s=1.0):
        device.receive(now_s, data)
        return messages(b"".join(output for _, output in run(device, now_s + 0.05)))

    return exchange


@pytest.fixture
def configured(mti, run, ask):
    """The device in the configuration state at 1 s."""
    run(mti, 1.0)
    assert ask(mti, GOTO_CONFIG)[-1] == (0x31, b"")
    return mti


@pytest.fixture
def measure(configured, mti, ask, run):
    """Configure outputs and return the items of the messages of one second."""

    def measure_second(*rows):
        assert ask(mti, outputs(*rows), 1.1)[0][0] == 0xC1
        mti.receive(1.2, GOTO_MEASUREMENT)
        output = messages(b"".join(data for _, data in run(mti, 2.25)))
        assert output[0] == (0x11, b"")
        assert {mid for mid, _ in output[1:]} == {0x36}
        return [items(content) for _, content in output[1:]]

    return measure_second


def test_factory_configuration_sends_counter_time_angles_and_status(mti, run):
    output = messages(b"".join(data for _, data in run(mti, 1.0)))
    assert 98 <= len(output) <= 100
    last = items(output[-1][1])
    assert list(last) == [0x1020, 0x1060, 0x2030, 0xE020]
    assert struct.unpack(">3f", last[0x2030])[2] == pytest.approx(90.0 - 98.3, abs=1e-4)
    counters = [int.from_bytes(items(content)[0x1020], "big") for _, content in output]
    assert counters == list(range(len(output)))


def test_message_is_complete_after_its_transfer(mti, run):
    due_s, data = run(mti, 0.1)[0]
    assert due_s == pytest.approx(0.01 + len(data) * 10 / 115200)


def test_configuration_state_sends_only_replies(configured, run, ask):
    assert run(configured, 5.0) == []
    assert ask(configured, REQ_DID, 5.0) == [(0x01, bytes.fromhex("03601234"))]
    assert ask(configured, REQ_OUTPUT, 5.1) == [(0xC1, bytes.fromhex("1020FFFF1060FFFF20300064E020FFFF"))]
    assert ask(configured, GOTO_CONFIG, 5.2) == [(0x31, b"")]


def test_measurement_state_ignores_configuration_commands(mti, run, ask):
    run(mti, 1.0)
    assert {mid for mid, _ in ask(mti, REQ_DID + REQ_OUTPUT + command(0x40))} == {0x36}
    assert (0x11, b"") in ask(mti, GOTO_MEASUREMENT, 1.1)


def test_reply_to_outputs_contains_the_supported_rates(configured, ask):
    ((mid, content),) = ask(configured, outputs((0xE020, 7), (0x2034, 400), (0x0810, 100), (0x8020, 0)), 1.1)
    assert (mid, content) == (0xC1, bytes.fromhex("E020FFFF203400640810000180200064"))
    assert configured.stored == 1


@pytest.mark.parametrize(
    ("data", "replies"),
    [
        (outputs((0x3010, 10)), [(0x42, b"\x21")]),
        (outputs((0x203C, 10)), [(0x42, b"\x21")]),
        (command(0xC0, b"\x20\x34\x00"), [(0x42, b"\x21")]),
        (command(0x7E), [(0x42, b"\x04")]),
        (REQ_DID[:-1] + b"\x02", []),
        (b"\xfa\xfa\xff" + REQ_DID, [(0x01, bytes.fromhex("03601234"))]),
    ],
    ids=["unknown-output", "unknown-frame", "short-list", "unknown-command", "checksum", "garbage-before"],
)
def test_invalid_commands_get_an_error_or_no_reply(configured, ask, data, replies):
    assert ask(configured, data, 1.1) == replies
    assert configured.stored == 0


@pytest.mark.parametrize(
    ("frame", "angles_deg"),
    [(0x0, (-4.5, -3.0, -8.3)), (0x4, (175.5, 3.0, 98.3)), (0x8, (-4.5, -3.0, -98.3))],
    ids=["ENU", "NED", "NWU"],
)
def test_angles_have_zero_and_sign_of_the_frame(mti, measure, frame, angles_deg):
    """ENU counts from east to port, NWU from north to port, NED from north to starboard."""
    mti.pitch_deg, mti.roll_deg = 3.0, -4.5
    output = measure((0x2030 | frame, 10))
    assert len(output) == 10
    assert struct.unpack(">3f", output[-1][0x2030 | frame]) == pytest.approx(angles_deg, abs=1e-4)


def test_gyroscope_rates_are_in_sensor_axes(boat, mti, measure):
    boat.rate = 0.1
    mti.roll_deg = 30.0
    rates = struct.unpack(">3f", measure((0x8020, 10))[-1][0x8020])
    assert rates == pytest.approx((0.0, -0.05, -0.1 * math.cos(math.radians(30.0))), abs=1e-6)


@pytest.mark.parametrize(("precision", "size"), [(0, 4), (1, 4), (2, 6), (3, 8)])
def test_values_have_the_requested_precision(measure, precision, size):
    raw = measure((0x2034 | precision, 10))[-1][0x2034 | precision]
    assert len(raw) == 3 * size
    yaw = raw[-size:]
    value = {
        0: lambda: struct.unpack(">f", yaw)[0],
        1: lambda: int.from_bytes(yaw, "big", signed=True) / 2**20,
        2: lambda: int.from_bytes(yaw[4:], "big", signed=True) + int.from_bytes(yaw[:4], "big") / 2**32,
        3: lambda: struct.unpack(">d", yaw)[0],
    }[precision]()
    assert value == pytest.approx(98.3, abs=1e-5)


def test_temperature_is_sent_once_a_second(measure):
    output = measure((0x2034, 10), (0x0810, 10))
    assert [0x0810 in content for content in output] == [True] + [False] * 9


def test_status_contains_validity_and_clipping(mti, measure, run):
    output = [int.from_bytes(content[0xE020], "big") for content in measure((0xE020, 0), (0x2034, 10))]
    assert output == [1, 3, 3, 3, 3, 3, 3, 3, 3, 3]
    mti.filter_valid, mti.self_test_passed, mti.clipped = False, False, 1 << 9
    last = items(messages(b"".join(data for _, data in run(mti, 3.0)))[-1][1])
    assert last[0xE020] == bytes.fromhex("00000200")


def test_wake_up_without_acknowledgement_starts_measurement(mti, run):
    run(mti, 1.0)
    mti.power_cycle(1.0, off_s=0.5)
    assert run(mti, 1.79) == []
    output = [(at_s, *messages(data)[0]) for at_s, data in run(mti, 2.5)]
    assert output[0][0] == pytest.approx(1.8, abs=0.001)
    assert output[0][1:] == (0x3E, b"")
    assert output[1][0] > 1.8 + 0.5
    assert [mid for _, mid, _ in output[1:3]] == [0x0D, 0x36]


def test_wake_up_with_acknowledgement_keeps_the_outputs(configured, run, ask):
    mti = configured
    ask(mti, outputs((0x2034, 5)), 1.1)
    mti.power_cycle(1.2, off_s=0.5)
    run(mti, 2.1)
    assert ask(mti, command(0x3F), 2.2) == []
    assert run(mti, 4.0) == []
    assert ask(mti, REQ_OUTPUT, 4.0) == [(0xC1, bytes.fromhex("20340005"))]


def test_device_without_power_sends_nothing(mti, run):
    run(mti, 1.0)
    mti.power_cycle(1.0, off_s=math.inf)
    mti.receive(2.0, GOTO_CONFIG)
    assert run(mti, 100.0) == []
