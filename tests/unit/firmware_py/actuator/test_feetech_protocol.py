"""Frames and registers of Feetech servos, by the examples of the maker's protocol description."""

import math

import pytest

from firmware_py.actuator import feetech_protocol as protocol

COUNT_RAD = math.tau / 4096


def reply(data=b"", status=0, device_id=1):
    body = bytes((device_id, len(data) + 2, status)) + bytes(data)
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))


def state_block(size=31, **registers):
    """Return the block of `size` bytes up to address 70 with registers by name."""
    addresses = {"torque": 40, "acceleration": 41, "goal": 42, "lock": 55, "position": 56}
    addresses |= {"voltage": 62, "temperature": 63, "status": 65, "current": 69}
    block = bytearray(71)
    for name, value in {"position": 2048, "voltage": 120, "temperature": 30, **registers}.items():
        length = 2 if name in ("goal", "position", "current") else 1
        block[addresses[name] : addresses[name] + length] = value.to_bytes(length, "little")
    return bytes(block[71 - size :])


@pytest.mark.parametrize(
    ("code", "parameters", "frame"),
    [
        (0x01, (), "FFFF 01 02 01 FB"),  # 4.1, ping
        (0x02, (0x38, 0x02), "FFFF 01 04 02 38 02 BE"),  # 4.2, read of the position
        (0x03, (0x2A, 0x00, 0x08, 0x00, 0x00, 0xE8, 0x03), "FFFF 01 09 03 2A 00 08 00 00 E8 03 D5"),  # 4.3, goal 2048
        (0x04, (0x2A, 0x00, 0x08, 0x00, 0x00, 0xE8, 0x03), "FFFF 01 09 04 2A 00 08 00 00 E8 03 D4"),  # 4.4
        (0x0A, (), "FFFF 01 02 0A F2"),  # 4.8, reset
        (0x0B, (0x00, 0x04), "FFFF 01 04 0B 00 04 EB"),  # 4.9, calibration to 1024
    ],
)
def test_instructions_of_the_manual(code, parameters, frame):
    assert protocol.instruction(1, code, *parameters) == bytes.fromhex(frame)


def test_broadcast_instruction_of_the_manual():
    assert protocol.instruction(0xFE, 0x03, 0x05, 0x01) == bytes.fromhex("FFFF FE 04 03 05 01 F4")


def test_acknowledgement_of_the_manual_is_decoded():
    parser = protocol.ReplyParser(1)
    assert parser.feed(bytes.fromhex("FFFF010200FC")) == [protocol.Reply(0, b"")]
    assert parser.feed(bytes.fromhex("FFFF020200FB")) == []  # of servo 2
    assert parser.rejected == 0


@pytest.mark.parametrize("size", [31, 34, 37, 40, 43, 46])
def test_blocks_that_the_driver_reads_are_decoded(size):
    data = bytes(range(100, 100 + size))
    assert protocol.ReplyParser(7).feed(reply(data, status=0x21, device_id=7)) == [protocol.Reply(0x21, data)]


@pytest.mark.parametrize("size", [1, 2, 3, 5, 15, 30, 32, 33, 35, 36, 38, 39, 41, 45, 47])
def test_other_lengths_are_skipped(size):
    parser = protocol.ReplyParser(1)
    assert parser.feed(reply(bytes(size)) + reply()) == [protocol.Reply(0, b"")]
    assert parser.rejected == 0


def test_each_block_has_its_own_length():
    assert [len(block) for block in protocol.STATES] == [31, 34, 37, 43, 46]
    assert {block.stop for block in protocol.STATES} == {71}
    assert (protocol.SETTINGS.start, protocol.SETTINGS.stop) == (0, 40)
    assert sorted(protocol.REPLY_SIZES) == [0, 31, 34, 37, 40, 43, 46]


def test_damage_to_any_byte_is_detected():
    frame = reply(state_block(position=1304))
    for place in range(len(frame)):
        for change in (1, 0x80, 0xFF):
            damaged = bytearray(frame)
            damaged[place] ^= change
            assert protocol.ReplyParser(1).feed(bytes(damaged)) == []


def test_reply_after_a_truncated_one_is_decoded_at_once():
    frame, next_frame = reply(state_block(position=1304)), reply(state_block(position=2389))
    for size in range(len(frame)):
        parser = protocol.ReplyParser(1)
        assert parser.feed(frame[:size]) == []
        assert [protocol.decode_state(found.data).shaft_rad for found in parser.feed(next_frame)] == [341 * COUNT_RAD]
        assert parser.rejected == (size >= 4)  # a shorter rest is no header
        assert parser.pending == 0 or size < 4


def test_checksum_and_the_byte_after_it_do_not_complete_a_header():
    """A reply ends with FF FF 01, and its checksum is a length; or with FF FF, and its checksum is the id."""
    for end, checksum in ((b"\xff\xff\x01", 2), (b"\xff\xff", 1)):
        data = bytes(31 - len(end)) + end
        (fill,) = (value for value in range(256) if reply(bytes((value,)) + data[1:])[-1] == checksum)
        data = bytes((fill,)) + data[1:]
        parser = protocol.ReplyParser(1)
        assert parser.feed(reply(data) + b"\x02") == [protocol.Reply(0, data)]
        assert parser.rejected == 0


def test_header_of_four_bytes_of_which_three_are_equal():
    assert protocol.ReplyParser(1).feed(b"\xff\xff\xff" + reply()) == [protocol.Reply(0, b"")]


def test_reply_in_single_bytes_is_decoded_after_the_last_one():
    parser = protocol.ReplyParser(1)
    frame = b"\xff" + reply(state_block(), status=1)
    replies = [parser.feed(frame[place : place + 1]) for place in range(len(frame))]
    assert replies == [[]] * (len(frame) - 1) + [[protocol.Reply(1, state_block())]]


def test_clear_discards_the_start_of_a_reply():
    parser = protocol.ReplyParser(1)
    frame = reply(state_block())
    parser.feed(frame[:30])
    assert parser.pending == 30
    parser.clear()
    assert parser.feed(frame[30:]) == []


def test_state_has_the_units_of_the_memory_table():
    measured = {"position": 2389, "voltage": 121, "temperature": 31, "status": 4, "current": 100}
    state = protocol.decode_state(state_block(torque=1, acceleration=254, goal=2389, lock=1, **measured))
    assert (state.torque, state.acceleration, state.goal, state.lock, state.status) == (1, 254, 2389, 1, 4)
    assert state.shaft_rad == pytest.approx(math.radians(341 * 360 / 4096))
    assert state.current_a == pytest.approx(0.65)
    assert state.voltage_v == pytest.approx(12.1)
    assert state.temperature_c == 31.0
    assert state.invalid_values == 0


@pytest.mark.parametrize("size", [34, 37, 43, 46])
def test_longer_blocks_end_with_the_same_registers(size):
    registers = {"torque": 1, "goal": 1000, "lock": 1, "position": 1304, "status": 32, "current": 7}
    assert protocol.decode_state(state_block(size, **registers)) == protocol.decode_state(state_block(**registers))


@pytest.mark.parametrize(
    ("register", "value", "field", "expected"),
    [
        ("position", 0x8000 | 100, "shaft_rad", (-100 - 2048) * COUNT_RAD),  # bit 15 is the sign
        ("position", 0x8000 | 1024, "shaft_rad", (-1024 - 2048) * COUNT_RAD),
        ("position", 0x8000 | 1025, "shaft_rad", None),
        ("position", 5120, "shaft_rad", 3072 * COUNT_RAD),
        ("position", 5121, "shaft_rad", None),
        ("current", 0x8000 | 100, "current_a", -0.65),
        ("current", 2047, "current_a", 13.3055),
        ("current", 2048, "current_a", None),
        ("current", 0x8000 | 2048, "current_a", None),
        ("voltage", 20, "voltage_v", 2.0),
        ("voltage", 19, "voltage_v", None),
        ("temperature", 0xD8, "temperature_c", -40.0),
        ("temperature", 0xD7, "temperature_c", None),
        ("temperature", 125, "temperature_c", 125.0),
        ("temperature", 126, "temperature_c", None),
    ],
)
def test_signs_and_ranges(register, value, field, expected):
    state = protocol.decode_state(state_block(**{register: value}))
    assert getattr(state, field) == (None if expected is None else pytest.approx(expected))
    assert state.invalid_values == (expected is None)


def settings(low, high):
    return bytes(9) + low.to_bytes(2, "little") + high.to_bytes(2, "little") + bytes(27)


@pytest.mark.parametrize(
    ("low", "high", "limits"),
    [
        (0, 4095, (0, 4095)),
        (1000, 3000, (1000, 3000)),
        (1000, 4095, (1000, 4095)),
        (0, 0, (0, 4095)),  # several turns
        (3000, 3000, (0, 4095)),
        (3000, 1000, (0, 4095)),
        (1000, 4096, (0, 4095)),
    ],
)
def test_angle_limits(low, high, limits):
    assert protocol.angle_limits(settings(low, high)) == limits


def test_angle_limits_of_unknown_settings_are_one_turn():
    assert protocol.angle_limits(None) == (0, 4095)


@pytest.mark.parametrize(
    ("bits", "text"),
    [
        (0x01, "voltage"),
        (0x02, "encoder"),
        (0x05, "voltage, overheating"),
        (0x28, "overcurrent, overload"),
        (0x90, "unknown 0x90"),
        (0x60, "overload, unknown 0x40"),
    ],
)
def test_status_text(bits, text):
    assert protocol.status_text(bits) == text
