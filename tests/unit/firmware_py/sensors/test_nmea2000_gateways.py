"""Forms of NMEA 2000: Actisense, Yacht Devices RAW, SocketCAN; pieces, damage, recordings."""

import struct

import pytest

from firmware_py.sensors.nmea2000_frames import FrameJoiner, Message
from firmware_py.sensors.nmea2000_gateways import (
    START_COMMAND,
    ActisenseGateway,
    SocketCanGateway,
    YachtDevicesGateway,
)
from hil.devices import nmea2000_frames as n2k
from support.paths import DATA

ADDRESS_CLAIM = 60928
PGNS = (ADDRESS_CLAIM, 127250, 129029)
HEADING = bytes.fromhex("00163AFF7FFF7FFD")
DLE_DATA = b"\x10\x10\x02\x93\x10\x03\x10\x10"
GNSS = n2k.gnss_position(50.0, -3.0, 1.6e9)


def can_frame(identifier, data, flags=0x80000000):
    return struct.pack("=IB3x8s", identifier | flags, len(data), data)


def joiner():
    return FrameJoiner({ADDRESS_CLAIM, 127250}, {129029})


def test_start_command_is_for_the_gateway():
    assert n2k.actisense_frame(0xA1, b"\x11\x02\x00") == START_COMMAND
    assert sum(START_COMMAND[2:-2]) % 256 == 0


@pytest.mark.parametrize("data", [HEADING, DLE_DATA])
@pytest.mark.parametrize("size", [1, 3, 4096])
def test_actisense_messages_in_pieces_between_foreign_bytes(data, size):
    gateway = ActisenseGateway(PGNS)
    message = n2k.actisense_message(127250, 0x10, data, t_ms=0x10101010)
    other = n2k.actisense_message(127488, 0x05, DLE_DATA)
    stream = b"\x10\x03\xff\x10" + other + message + b"\x10\x02\xa0\x01\x10\x03noise" + message + other
    messages = [
        message for start in range(0, len(stream), size) for message in gateway.feed(stream[start : start + size], 0.0)
    ]
    assert messages == [Message(127250, 0x10, data)] * 2
    assert (gateway.rejected, gateway.has_frames) == (0, True)


@pytest.mark.parametrize("position", range(2, 26))
def test_one_damaged_byte_of_an_actisense_message_gives_none(position):
    message = n2k.actisense_message(127250, 0x13, HEADING)
    for change in range(1, 256):
        damaged = bytearray(message)
        damaged[position] ^= change
        assert ActisenseGateway(PGNS).feed(bytes(damaged), 0.0) == []


@pytest.mark.parametrize(
    ("stream", "expected"),
    [(n2k.actisense_message(127488, 5, HEADING), True), (n2k.actisense_message(127250, 5, HEADING), True),
     (n2k.actisense_message(127488, 5, HEADING).replace(b"\x3a", b"\x3b"), False), (b"noise", False)],
)  # fmt: skip
def test_any_valid_actisense_frame_shows_that_the_bus_is_running(stream, expected):
    gateway = ActisenseGateway(PGNS)
    gateway.feed(stream, 0.0)
    assert gateway.has_frames is expected
    gateway.feed(b"noise", 0.0)
    assert gateway.has_frames is expected


@pytest.mark.parametrize(
    ("stream", "expected"),
    [(n2k.raw_line(127488, 5, b"\0"), True), (n2k.raw_line(127488, 5, bytes(8), direction="T"), True),
     (n2k.raw_line(127488, 5, bytes(9)), False), (b"noise\n", False)],
)  # fmt: skip
def test_any_line_shows_that_the_bus_is_running(stream, expected):
    gateway = YachtDevicesGateway(joiner(), PGNS)
    gateway.feed(stream, 0.0)
    assert gateway.has_frames is expected


def test_lines_of_the_lowest_pgn_without_a_destination():
    gateway = YachtDevicesGateway(FrameJoiner({126992}, ()), (126992,))
    lines = n2k.raw_line(126992, 1, HEADING) + n2k.raw_line(126993, 2, HEADING)
    assert gateway.feed(lines, 0.0) == [Message(126992, 1, HEADING)]
    assert gateway._line.search(n2k.raw_line(126993, 2, HEADING)) is None  # the search finds the selected PGNs only


def test_damaged_actisense_message_is_counted_and_the_next_one_is_read():
    gateway = ActisenseGateway(PGNS)
    message = n2k.actisense_message(127250, 0x13, HEADING)
    damaged = message[:15] + bytes([message[15] ^ 1]) + message[16:]
    assert gateway.feed(damaged + message[:20] + message, 0.0) == [Message(127250, 0x13, HEADING)]
    assert gateway.rejected == 1


def test_actisense_frame_without_a_message_is_ignored():
    header = n2k.actisense_message(127250, 0x13, HEADING)[2:15]
    gateway = ActisenseGateway(PGNS)
    assert gateway.feed(b"\x10\x02" + header + b"\x10\x03", 0.0) == []
    assert (gateway.rejected, gateway.has_frames) == (0, False)


@pytest.mark.parametrize("change", [{"size": 9}, {"length": 20}])
def test_actisense_message_with_a_wrong_length_is_rejected(change):
    body = bytearray(n2k.actisense_message(127250, 0x13, HEADING)[2:-3])
    body[1] = change.get("length", body[1])
    body[12] = change.get("size", body[12])
    gateway = ActisenseGateway(PGNS)
    assert gateway.feed(b"\x10\x02" + bytes(body) + bytes([-sum(body) % 256]) + b"\x10\x03", 0.0) == []
    assert (gateway.rejected, gateway.has_frames) == (1, False)


def test_incomplete_actisense_frame_has_a_limited_length():
    gateway = ActisenseGateway(PGNS)
    gateway.feed(b"\x10\x02\x93" + b"x" * 4000, 0.0)
    assert len(gateway._buffer) <= 500
    longest = n2k.actisense_message(129029, 0x10, b"\x10" * 223)
    assert gateway.feed(longest[:-1], 0.0) == []
    assert gateway.feed(longest[-1:], 0.0) == [Message(129029, 0x10, b"\x10" * 223)]


@pytest.mark.parametrize("size", [1, 7, 4096])
def test_lines_of_yacht_devices(size):
    gateway = YachtDevicesGateway(joiner(), PGNS)
    stream = b"noise\r\n" + n2k.raw_line(127251, 0x13, HEADING) + n2k.raw_line(127250, 0x13, HEADING, priority=7)
    stream += n2k.raw_line(ADDRESS_CLAIM, 0x13, HEADING) + n2k.raw_line(127250, 0x13, HEADING, direction="T")
    for frame in n2k.frames(GNSS, 5):
        stream += n2k.raw_line(129029, 0x10, frame)
    messages = [
        message for start in range(0, len(stream), size) for message in gateway.feed(stream[start : start + size], 0.0)
    ]
    assert messages == [
        Message(127250, 0x13, HEADING),
        Message(ADDRESS_CLAIM, 0x13, HEADING),
        Message(129029, 0x10, GNSS),
    ]
    assert (gateway.rejected, gateway.has_frames) == (0, True)


@pytest.mark.parametrize(
    "line",
    [
        b"00:29:58.627 R 09F11213 00 16 3A FF 7F FF 7F\r\n",  # 7 bytes
        b"00:29:58.627 R 09F11213 00 16 3A FF 7F FF 7F FD FF\r\n",
        b"00:29:58.627 R 09F11213 00 16 3A FF 7F FF 7F F\r\n",
        b"00:29:58.627 R 09F11213 00 16 3A FF 7FFF 7F FD\r\n",
        b"00:29:58.627 R 09F112130 00 16 3A FF 7F FF 7F FD\r\n",
        b"00:29:58.627 R 29F11213 00 16 3A FF 7F FF 7F FD\r\n",
        b"00:29:58.627 R 08F11213 00 16 3A FF 7F FF 7F FD\r\n",  # data page 0
        b"00:29:58.627 R 09F11213 00 16 3A FF 7F FF 7F FD",  # not complete
    ],
)
def test_damaged_lines_give_no_message(line):
    assert YachtDevicesGateway(joiner(), PGNS).feed(line, 0.0) == []


def test_line_without_end_has_a_limited_length():
    gateway = YachtDevicesGateway(joiner(), PGNS)
    for _ in range(3):
        gateway.feed(b"00:29:58.627 R " * 100, 0.0)
    assert len(gateway._buffer) <= 80


@pytest.mark.parametrize("size", [1, 16, 100])
def test_frames_of_socketcan(size):
    gateway = SocketCanGateway(joiner())
    heading = n2k.identifier(127250, 0x13)
    stream = can_frame(heading, HEADING) + can_frame(heading, HEADING, 0) + can_frame(heading, HEADING, 0xC0000000)
    stream += can_frame(heading, HEADING, 0xA0000000) + can_frame(heading, HEADING[:7])
    for frame in n2k.frames(GNSS, 1):
        stream += can_frame(n2k.identifier(129029, 0x10), frame)
    messages = [
        message for start in range(0, len(stream), size) for message in gateway.feed(stream[start : start + size], 0.0)
    ]
    assert messages == [Message(127250, 0x13, HEADING), Message(129029, 0x10, GNSS)]
    assert gateway.has_frames


def test_frames_without_29_bits_are_no_sign_of_nmea_2000():
    gateway = SocketCanGateway(joiner())
    gateway.feed(can_frame(0x123, HEADING, 0), 0.0)
    assert not gateway.has_frames


def test_recorded_lines_of_a_gateway():
    """canboat, samples/merrimac-ydwg-2020.raw: headings of one device, positions of four."""
    gateway = YachtDevicesGateway(joiner(), PGNS)
    messages = gateway.feed((DATA / "nmea2000" / "canboat_merrimac-ydwg-2020_excerpt.raw").read_bytes(), 0.0)
    headings = [message for message in messages if message.pgn == 127250]
    assert {message.source for message in headings} == {0x13}
    assert len(headings) == 21
    assert {message.source for message in messages if message.pgn == 129029} == {0x10, 0x15, 0x16, 0x2D}


def test_recorded_bytes_of_a_gateway():
    """canboat, samples/ydnu-02-raymarine-ev1.dle: a heading sensor and its autopilot."""
    gateway = ActisenseGateway(PGNS)
    messages = gateway.feed((DATA / "nmea2000" / "canboat_ydnu-02-raymarine-ev1_excerpt.dle").read_bytes(), 0.0)
    assert {message.source for message in messages} == {0xCC}
    assert len(messages) > 40
    assert gateway.rejected == 0
