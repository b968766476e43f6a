"""CAN frames of NMEA 2000: identifiers and fast packets with lost, repeated and mixed frames."""

import pytest

from firmware_py.sensors.nmea2000_frames import FrameJoiner, Message, split_identifier
from hil.devices import nmea2000_frames as n2k

FAST, SINGLE = 129029, 127250
DATA = bytes(range(43))


@pytest.fixture
def joiner():
    return FrameJoiner({SINGLE}, {FAST, 129038})


def add(joiner, frames, source=0x10, pgn=FAST, now_s=0.0):
    identifier = n2k.identifier(pgn, source)
    return [message for frame in frames if (message := joiner.add(identifier, frame, now_s)) is not None]


def frames(data=DATA, sequence=0):
    return list(n2k.frames(data, sequence))


@pytest.mark.parametrize(
    ("identifier", "pgn", "source"),
    [(0x09F11213, 127250, 0x13), (0x0DF80516, 129029, 0x16), (0x18EEFF01, 60928, 1), (0x18EA2301, 59904, 1),
     (0x15FD0723, 130311, 0x23), (0x09F1FE00, 127486, 0), (0x0DEFFF42, 126720, 0x42), (0x09F01042, 126992, 0x42),
     (0x0DEF1042, 126720, 0x42)],
)  # fmt: skip
def test_pgn_and_source_of_an_identifier(identifier, pgn, source):
    assert split_identifier(identifier) == (pgn, source)


def test_single_frames_of_selected_pgns_with_8_bytes_are_messages(joiner):
    assert add(joiner, [b"12345678"], pgn=SINGLE) == [Message(SINGLE, 0x10, b"12345678")]
    assert add(joiner, [b"1234567"], pgn=SINGLE) == []
    assert add(joiner, [b"12345678"], pgn=127251) == []


@pytest.mark.parametrize("size", [1, 6, 7, 13, 14, 43, 222, 223])
def test_fast_packet_is_joined(joiner, size):
    data = bytes(index % 256 for index in range(size))
    assert add(joiner, frames(data)) == [Message(FAST, 0x10, data)]
    assert joiner.lost == 0


def test_interleaved_sources_and_pgns_are_joined_separately(joiner):
    other = bytes(reversed(DATA))
    messages = []
    for first, second, third in zip(frames(), frames(other, 3), frames(DATA, 1), strict=True):
        messages += add(joiner, [first], 0x10) + add(joiner, [second], 0x11) + add(joiner, [third], 0x10, 129038)
    assert messages == [Message(FAST, 0x10, DATA), Message(FAST, 0x11, other), Message(129038, 0x10, DATA)]


@pytest.mark.parametrize("lost", range(7))
def test_lost_frame_gives_no_message_and_is_counted_once(joiner, lost):
    sent = frames()
    del sent[lost]
    assert add(joiner, sent) == []
    assert add(joiner, frames(DATA, 1)) == [Message(FAST, 0x10, DATA)]
    assert joiner.lost == (1 if lost else 0)  # without its first frame a message is not known


@pytest.mark.parametrize("position", range(7))
def test_repeated_or_exchanged_frames_give_no_message(joiner, position):
    sent = frames()
    repeated = [*sent[: position + 1], sent[position], *sent[position + 1 :]]
    expected = [] if 0 < position < 6 else [Message(FAST, 0x10, DATA)]
    assert add(joiner, repeated) == expected
    sent[position], sent[position - 1] = sent[position - 1], sent[position]
    assert add(joiner, sent) == []


def test_frames_of_two_sequences_are_not_mixed(joiner):
    first, second = frames(DATA, 2), frames(bytes(43), 3)
    assert add(joiner, [*first[:3], *second[3:]]) == []
    assert joiner.lost == 1


def test_frames_after_a_pause_are_not_joined(joiner):
    sent = frames()
    assert add(joiner, sent[:3], now_s=1.0) == []
    assert add(joiner, sent[3:], now_s=1.75) == [Message(FAST, 0x10, DATA)]
    assert add(joiner, sent[:3], now_s=2.0) == []
    assert add(joiner, sent[3:], now_s=2.76) == []
    assert joiner.lost == 1


@pytest.mark.parametrize("length", [0, 224, 255])
def test_impossible_length_is_counted(joiner, length):
    assert add(joiner, [bytes([0, length]) + bytes(6)]) == []
    assert joiner.lost == 1


def test_short_frame_drops_the_message(joiner):
    sent = frames()
    assert add(joiner, [*sent[:2], sent[2][:5], *sent[3:]]) == []
    assert joiner.lost == 1
    assert add(joiner, [b"\x00"]) == []
    assert add(joiner, [b"\x00\x03"]) == []  # the length without data
    assert joiner.lost == 2


def test_open_messages_are_limited(joiner):
    for source in range(40):
        add(joiner, frames()[:1], source, now_s=source * 1e-3)
    assert len(joiner._open) == 32
    assert joiner.lost == 8
    assert add(joiner, frames()[1:], 0, now_s=0.1) == []  # the oldest was dropped
    assert add(joiner, frames()[1:], 39, now_s=0.1) == [Message(FAST, 39, DATA)]


@pytest.mark.parametrize(("interval_s", "count"), [(0.75, 1), (0.8, 0)])
def test_frames_of_a_fast_packet_follow_within_three_quarters_of_a_second(joiner, interval_s, count):
    first, second, *others = frames()
    assert add(joiner, [first], now_s=1.0) == []
    assert len(add(joiner, [second, *others], now_s=1.0 + interval_s)) == count
    assert joiner.lost == 1 - count


@pytest.mark.parametrize(("length", "lost"), [(0, 1), (223, 0), (224, 1)])
def test_length_of_a_fast_packet_is_limited(joiner, length, lost):
    assert add(joiner, [bytes((0, length)) + bytes(6)]) == []
    assert joiner.lost == lost


@pytest.mark.parametrize(("others", "lost"), [(31, 0), (32, 1)])
def test_oldest_of_33_incomplete_packets_is_dropped(joiner, others, lost):
    first, *rest = frames()
    add(joiner, [first], source=0)
    for source in range(1, others + 1):
        add(joiner, [first], source=source, now_s=0.1)
    assert joiner.lost == lost
    assert len(add(joiner, rest, source=0, now_s=0.2)) == 1 - lost
