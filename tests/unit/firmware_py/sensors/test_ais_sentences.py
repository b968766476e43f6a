"""Finding of AIS sentences in a stream, and joining of multi-part messages."""

import pytest

from firmware_py.sensors.ais_sentences import Assembler, SentenceFinder
from firmware_py.sensors.message_error import MessageError

SENTENCE = b"!AIVDM,1,1,,B,15M67FC000G?ufbE`FepT@3n00Sa,0*5C\r\n"


def sentence(body):
    checksum = 0
    for byte in body:
        checksum ^= byte
    return b"!%s*%02X\r\n" % (body, checksum)


def part(number, count=2, sequence=b"3", channel=b"A", payload=b"0123456789"):
    return sentence(b"AIVDM,%d,%d,%s,%s,%s,0" % (count, number, sequence, channel, payload))


def assemble(stream, now_s=0.0, assembler=None):
    assembler = assembler or Assembler()
    messages = [assembler.add(body, checksum, now_s) for body, checksum in SentenceFinder().feed(stream)]
    return [message for message in messages if message is not None]


@pytest.mark.parametrize("size", [1, 2, 7, 33, 1000])
def test_finder_skips_other_bytes_and_does_not_depend_on_the_chunks(size):
    stream = (
        b"\\s:r,c:1*5B\\" + SENTENCE + b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n!!!AIVDM,\x00\xff" + SENTENCE + b"!AIVDM,1,1"
    )
    finder, bodies = SentenceFinder(), []
    for start in range(0, len(stream), size):
        bodies += [body for body, _ in finder.feed(stream[start : start + size])]
    assert bodies == [SENTENCE[1:-5]] * 2


def test_finder_does_not_store_endless_sentences():
    finder = SentenceFinder()
    for _ in range(1000):
        assert list(finder.feed(b"!AIVDM,1,1,," + b"A" * 400)) == []
    assert len(finder._incomplete_sentence) < 200


@pytest.mark.parametrize(("size", "count"), [(120, 1), (121, 0)])
def test_sentence_has_at_most_120_characters_after_its_address(size, count):
    finder = SentenceFinder()
    stream = sentence(b"AIVDM,1,1,,A,".ljust(6 + size, b"0"))
    assert len([body for byte in stream for body in finder.feed(bytes([byte]))]) == count


def test_five_parts_are_joined_and_five_fill_bits_allowed():
    (message,) = assemble(b"".join(part(number, 5) for number in range(1, 6)))
    assert message.payload == b"0123456789" * 5
    (message,) = assemble(sentence(b"ABVDO,1,1,,A,1234567,5"))
    assert (message.payload, message.fill_bits, message.is_own) == (b"1234567", 5, True)


def test_characters_after_the_number_of_fill_bits_are_ignored():
    (message,) = assemble(sentence(b"AIVDM,1,1,,A,1234567,2x"))
    assert message.fill_bits == 2


def test_interleaved_messages_are_joined():
    stream = part(1, payload=b"AAA") + part(1, sequence=b"4", payload=b"CCC") + SENTENCE + part(2, payload=b"BBB")
    assert [message.payload for message in assemble(stream)] == [b"15M67FC000G?ufbE`FepT@3n00Sa", b"AAABBB"]


@pytest.mark.parametrize(
    "stream",
    [
        part(2),
        part(1, 3) + part(3, 3),
        part(1) + part(2, channel=b"B"),
        part(0),
        part(1, 6),
        part(2, 1),
        sentence(b"AIVDM,1,1,,A,1234567,6"),
        sentence(b"AIVDM,1,1,,A,1234567"),
        sentence(b"AIVDM,x,1,,A,1234567,0"),
        sentence(b"AIVDM,1,x,,A,1234567,0"),
        SENTENCE.replace(b"15M", b"16M"),
    ],
    ids=[
        "no first part",
        "gap",
        "other channel",
        "part 0",
        "six parts",
        "part 2 of 1",
        "fill bits",
        "fields",
        "count",
        "part",
        "checksum",
    ],
)
def test_invalid_sentences_and_missing_parts_are_rejected(stream):
    with pytest.raises(MessageError):
        assemble(stream)


def test_late_part_is_rejected():
    assembler = Assembler()
    assert assemble(part(1) + part(1, sequence=b"4"), 100.0, assembler) == []
    assert len(assemble(part(2), 110.0, assembler)) == 1
    with pytest.raises(MessageError):
        assemble(part(2, sequence=b"4"), 110.1, assembler)


def test_message_with_a_gap_is_discarded():
    assembler = Assembler()
    for stream in (part(1, 3) + part(3, 3), part(2, 3)):
        with pytest.raises(MessageError, match="earlier parts"):
            assemble(stream, 0.0, assembler)


def test_complete_messages_do_not_replace_an_incomplete_one():
    assembler = Assembler()
    assemble(part(1), 0.0, assembler)
    for number in range(16):
        stream = part(1, channel=b"%d" % number) + part(2, channel=b"%d" % number)
        assert len(assemble(stream, 1.0, assembler)) == 1
    assert len(assemble(part(2), 2.0, assembler)) == 1


def test_oldest_of_more_than_sixteen_incomplete_messages_is_dropped():
    assembler = Assembler()
    for number in range(17):
        assemble(part(1, sequence=b"1", channel=b"%d" % number), number / 16.0, assembler)
    assert len(assemble(SENTENCE, 1.0, assembler)) == 1
    assemble(part(1, sequence=b"1", channel=b"2"), 1.0, assembler)  # begins again
    complete = [assemble(part(2, sequence=b"1", channel=b"%d" % number), 1.0, assembler) for number in range(1, 17)]
    assert sum(map(len, complete)) == 16
    with pytest.raises(MessageError, match="earlier parts"):
        assemble(part(2, sequence=b"1", channel=b"0"), 1.0, assembler)
