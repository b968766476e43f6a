"""AIS sentences found in streams, and messages of several of them."""

import pytest

from firmware_py.sensors.ais_sentences import MAX_INCOMPLETE, Assembler, SentenceFinder
from firmware_py.sensors.message_error import MessageError

ONE = b"!AIVDM,1,1,,B,15M67FC000G?ufbE`FepT@3n00Sa,0*5C\r\n"


def sentence(body):
    check = 0
    for byte in body:
        check ^= byte
    return b"!%s*%02X\r\n" % (body, check)


def part(number, count=2, sequence=b"3", channel=b"A", payload=b"0123456789"):
    return sentence(b"AIVDM,%d,%d,%s,%s,%s,0" % (count, number, sequence, channel, payload))


def joined(stream, now_s=0.0, assembler=None):
    assembler = assembler or Assembler()
    taken = [assembler.add(body, stated, now_s) for body, stated in SentenceFinder().feed(stream)]
    return [message for message in taken if message is not None]


@pytest.mark.parametrize("size", [1, 2, 7, 33, 1000])
def test_sentences_are_found_however_the_stream_is_cut_and_whatever_stands_between(size):
    stream = b"\\s:r,c:1*5B\\" + ONE + b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n!!!AIVDM,\x00\xff" + ONE + b"!AIVDM,1,1"
    finder, found = SentenceFinder(), []
    for start in range(0, len(stream), size):
        found += finder.feed(stream[start : start + size])
    assert [body for body, _ in found] == [ONE[1:-5]] * 2


def test_what_never_ends_is_not_kept():
    finder = SentenceFinder()
    for _ in range(1000):
        assert list(finder.feed(b"!AIVDM,1,1,," + b"A" * 400)) == []
    assert len(finder._rest) < 200


def test_parts_are_joined_those_of_others_between_them():
    stream = part(1, payload=b"AAA") + part(1, sequence=b"4", payload=b"CCC") + ONE + part(2, payload=b"BBB")
    assert [message.payload for message in joined(stream)] == [b"15M67FC000G?ufbE`FepT@3n00Sa", b"AAABBB"]


@pytest.mark.parametrize(
    "stream",
    [
        part(2),
        part(1, 3) + part(3, 3),
        part(1) + part(2, channel=b"B"),
        part(0),
        part(6, 6),
        part(2, 1),
        sentence(b"AIVDM,1,1,,A,1234567,9"),
        sentence(b"AIVDM,1,1,,A,1234567"),
        ONE.replace(b"15M", b"16M"),
    ],
)
def test_what_does_not_belong_together_is_refused(stream):
    with pytest.raises(MessageError):
        joined(stream)


def test_a_part_that_comes_too_late_is_none():
    assembler = Assembler()
    assert joined(part(1), 0.0, assembler) == []
    with pytest.raises(MessageError):
        joined(part(2), 11.0, assembler)


def test_beginnings_without_an_end_are_bounded():
    assembler = Assembler()
    for number in range(1000):
        joined(part(1, sequence=b"%d" % (number % 10), channel=b"%d" % number), float(number), assembler)
    assert len(assembler._incomplete) <= MAX_INCOMPLETE
