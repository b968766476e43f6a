import struct

import pytest

from firmware_py.log.dataflash import (
    FMT,
    FMT_BYTES,
    MULTIPLIERS,
    TEXT_BYTES,
    UNITS,
    MessageType,
    Parser,
    header,
    text_of,
)

ONE = MessageType(200, "ONE", "TimeUS,A,B", "Qbd", "s-r", "F-0")
TWO = MessageType(201, "TWO", "TimeUS,T", "QZ", "s-", "F-")
HEAD = header((ONE, TWO), 1000)
BODY = [ONE.pack(1, 2, 0.5), TWO.pack(2, b"hello"), ONE.pack(3, -4, -0.0)]


def found_in(data):
    parser = Parser(data)
    values = [(found.name, found.unpack(data, at)) for found, at in parser]
    return [one for one in values if one[0] in ("ONE", "TWO")], parser


EXPECTED = [("ONE", (1, 2, 0.5)), ("TWO", (2, b"hello".ljust(64, b"\0"))), ("ONE", (3, -4, -0.0))]


def test_layout_is_the_published_one():
    assert ONE.pack(1, 2, 0.5) == b"\xa3\x95\xc8" + struct.pack("<Qbd", 1, 2, 0.5)
    assert FMT.size == FMT_BYTES
    assert HEAD[:3] == b"\xa3\x95\x80"
    assert HEAD[3:5] == bytes((128, 89))


def test_header_describes_every_type_unit_and_multiplier():
    parser = Parser(HEAD)
    records = [(found.name, dict(zip(found.labels, found.unpack(HEAD, at), strict=True))) for found, at in parser]
    formats = {text_of(values["Name"]) for name, values in records if name == "FMT"}
    assert formats == {"FMT", "UNIT", "MULT", "FMTU", "ONE", "TWO"}
    assert {chr(values["Id"]): text_of(values["Label"]) for name, values in records if name == "UNIT"} == dict(UNITS)
    assert {chr(values["Id"]): values["Mult"] for name, values in records if name == "MULT"} == dict(MULTIPLIERS)
    units = {values["FmtType"]: text_of(values["UnitIds"]) for name, values in records if name == "FMTU"}
    assert units[200] == "s-r"
    assert parser.garbage_bytes == parser.tail_bytes == 0


@pytest.mark.parametrize(
    "description",
    [
        (1, "FIVES", "A", "B", "-", "-"),
        (1, "", "A", "B", "-", "-"),
        (1, "N", ",".join("ABCDEFGHIJKLMNOPQ"), "B" * 17, "-" * 17, "-" * 17),
        (1, "N", "A" * 65, "B", "-", "-"),
        (1, "N", "A,B", "B", "-", "-"),
        (1, "N", "A", "B", "--", "-"),
        (1, "N", "A", "B", "!", "-"),
        (1, "N", "A", "B", "-", "!"),
        (1, "N", "A,B,C,D", "ZZZZ", "----", "----"),
    ],
)
def test_a_description_beyond_the_limits_is_refused(description):
    with pytest.raises(ValueError, match=":"):
        MessageType(*description)


def test_records_come_in_order():
    found, parser = found_in(HEAD + b"".join(BODY))
    assert found == EXPECTED
    assert parser.garbage_bytes == parser.tail_bytes == 0


@pytest.mark.parametrize("junk", [b"\0" * 300, b"\xa3", b"\xa3\x95", b"\xa3\x95\xfe", b"\x95\xa3\xa3"])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_garbage_between_records_is_skipped_and_counted(junk, place):
    found, parser = found_in(HEAD + b"".join(BODY[:place]) + junk + b"".join(BODY[place:]))
    assert found == EXPECTED
    assert parser.garbage_bytes == len(junk)
    assert parser.tail_bytes == 0


def test_garbage_behind_the_last_record_is_tail():
    found, parser = found_in(HEAD + b"".join(BODY) + b"\0" * 300)
    assert found == EXPECTED
    assert (parser.garbage_bytes, parser.tail_bytes) == (0, 300)


def test_a_head_without_its_record_costs_what_it_claims():
    found, _ = found_in(HEAD + b"\xa3\x95\xc9" + b"".join(BODY))
    assert found[-1] == EXPECTED[-1]


def test_a_false_mark_within_garbage_swallows_nothing():
    junk = b"\0\xa3\x95\xc9" + b"\0" * 10  # claims to be TWO, whose end falls into a record
    found, parser = found_in(HEAD + junk + b"".join(BODY))
    assert found == EXPECTED
    assert parser.garbage_bytes == len(junk)


def test_a_cut_record_is_tail():
    whole = HEAD + b"".join(BODY)
    for cut in range(1, len(BODY[2])):
        found, parser = found_in(whole[:-cut])
        assert found == EXPECTED[:2]
        assert parser.tail_bytes == len(BODY[2]) - cut


def test_types_of_other_programs_are_stepped_over():
    odd = FMT.pack(77, 20, b"ODD", b"x?", b"A,B")  # unknown characters
    short = FMT.pack(78, 2, b"BAD", b"", b"")  # shorter than its own head: cannot be
    data = HEAD + odd + short + b"\xa3\x95\x4d" + b"\xa3\x95\xc8" + b"\0" * 14 + b"".join(BODY)
    found, parser = found_in(data)
    assert found == EXPECTED
    assert parser.garbage_bytes == 0


def test_an_empty_buffer_has_no_records():
    parser = Parser(b"")
    assert list(parser) == []
    assert parser.tail_bytes == 0


def test_text_column_holds_what_the_schema_says():
    assert TWO.pack(1, b"x" * 100)[11:] == b"x" * TEXT_BYTES
