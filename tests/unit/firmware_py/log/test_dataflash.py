import struct

import pytest

from firmware_py.log.dataflash import FMT, UNITS, Format, MessageType, Parser, decode_text, header

FMT_BYTES = 89
TEXT_BYTES = 64
PUBLISHED_FACTORS = {"-": 0.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}  # log_Multipliers of ArduPilot

ONE = MessageType(200, "ONE", "TimeUS,A,B", "Qbd", "s-r", "F-0")
TWO = MessageType(201, "TWO", "TimeUS,T", "QZ", "s-", "F-")
HEAD = header((ONE, TWO), 1000)
BODY = [ONE.pack(1, 2, 0.5), TWO.pack(2, b"hello"), ONE.pack(3, -4, -0.0)]
EXPECTED = [("ONE", (1, 2, 0.5)), ("TWO", (2, b"hello".ljust(64, b"\0"))), ("ONE", (3, -4, -0.0))]


def parse(data):
    """Return the records of the types ONE and TWO, the garbage bytes and the tail bytes."""
    parser = Parser(data)
    records = [(record.name, record.unpack(data, offset)) for record, offset in parser]
    return [record for record in records if record[0] in ("ONE", "TWO")], parser.garbage_bytes, parser.tail_bytes


def test_layout_is_the_published_one():
    assert ONE.pack(1, 2, 0.5) == b"\xa3\x95\xc8" + struct.pack("<Qbd", 1, 2, 0.5)
    assert FMT.size == FMT_BYTES
    assert HEAD[:5] == b"\xa3\x95\x80" + bytes((128, 89))
    assert TWO.pack(1, b"x" * 100)[11:] == b"x" * TEXT_BYTES


def test_header_describes_every_type_unit_and_multiplier():
    parser = Parser(HEAD)
    records = [(row.name, dict(zip(row.labels, row.unpack(HEAD, offset), strict=True))) for row, offset in parser]
    formats = {decode_text(values["Name"]) for name, values in records if name == "FMT"}
    assert formats == {"FMT", "UNIT", "MULT", "FMTU", "ONE", "TWO"}
    assert {chr(values["Id"]): decode_text(values["Label"]) for name, values in records if name == "UNIT"} == dict(
        UNITS
    )
    assert {chr(values["Id"]): values["Mult"] for name, values in records if name == "MULT"} == PUBLISHED_FACTORS
    units = {values["FmtType"]: decode_text(values["UnitIds"]) for name, values in records if name == "FMTU"}
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


def test_a_description_at_the_limits_is_accepted():
    labels = ",".join(["TimeUS", *(["LLL"] * 14), "L"])
    assert (len(labels.split(",")), len(labels)) == (16, 64)
    assert MessageType(1, "NAME", labels, "B" * 16, "-" * 16, "-" * 16).size == 19
    values = "ZZZ" + "q" * 7 + "i"  # 3 + 192 + 56 + 4 bytes
    assert MessageType(1, "N", ",".join("A" * 11), values, "-" * 11, "-" * 11).size == 255


@pytest.mark.parametrize(("time_us", "stamp_us"), [(255, 0), (256, 256)])
def test_a_time_in_the_header_is_no_number_of_a_type(time_us, stamp_us):
    head = header((), time_us)
    assert {row.unpack(head, at)[0] for row, at in Parser(head) if row.name != "FMT"} == {stamp_us}


@pytest.mark.parametrize("junk", [b"\0" * 300, b"\xa3", b"\xa3\x95", b"\xa3\x95\xfe", b"\x95\xa3\xa3"])
@pytest.mark.parametrize("position", [0, 1, 2])
def test_garbage_between_records_is_skipped_and_counted(junk, position):
    data = HEAD + b"".join((*BODY[:position], junk, *BODY[position:]))
    assert parse(data) == (EXPECTED, len(junk), 0)


def test_garbage_after_the_last_record_is_the_tail():
    assert parse(HEAD + b"".join(BODY)) == (EXPECTED, 0, 0)
    assert parse(HEAD + b"".join(BODY) + b"\0" * 300) == (EXPECTED, 0, 300)
    assert parse(b"") == ([], 0, 0)


def test_a_mark_without_its_record_may_lose_the_next_records_only():
    records, _, _ = parse(HEAD + b"\xa3\x95\xc9" + b"".join(BODY))
    assert records[-1] == EXPECTED[-1]


def test_a_mark_within_garbage_loses_no_record():
    junk = b"\0\xa3\x95\xc9" + b"\0" * 10  # looks like TWO, whose end would be within a record
    assert parse(HEAD + junk + b"".join(BODY)) == (EXPECTED, len(junk), 0)


def test_a_truncated_record_is_the_tail():
    for cut in range(1, len(BODY[2])):
        assert parse((HEAD + b"".join(BODY))[:-cut]) == (EXPECTED[:2], 0, len(BODY[2]) - cut)


@pytest.mark.parametrize(("length", "values", "labels"), [(12, "Q", "A"), (11, "Q", "A,B"), (11, "?", "A")])
def test_a_format_that_contradicts_itself_is_refused(length, values, labels):
    assert Format(1, 11, "N", "Q", "A").unpack(bytes(11), 0) == (0,)
    with pytest.raises(ValueError, match="N: "):
        Format(1, length, "N", values, labels)


def test_types_of_other_programs_are_skipped():
    unknown = FMT.pack(77, 20, b"ODD", b"x?", b"A,B")  # unknown value characters
    invalid = FMT.pack(78, 2, b"BAD", b"", b"")  # shorter than the head of a record
    record = b"\xa3\x95\x4d" + b"\xa3\x95\xc8" + b"\0" * 14
    assert parse(HEAD + unknown + invalid + record + b"".join(BODY)) == (EXPECTED, 0, 0)
