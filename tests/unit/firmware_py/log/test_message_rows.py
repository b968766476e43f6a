import math

import msgspec
import pytest

from firmware_py.common.records import FixType
from firmware_py.log.dataflash import Format, MessageType
from firmware_py.log.message_rows import (
    Row,
    RowReader,
    enum_column,
    flag_column,
    float_column,
    integer_column,
    microseconds,
    optional_column,
    optional_flag_column,
)


class Record(msgspec.Struct, frozen=True):
    size_m: float
    depth_m: float | None
    count: int | None
    on: bool
    known: bool | None
    fix: FixType
    text: str = ""
    sound: FixType = FixType.NONE


def make_columns():
    return (
        float_column("S", "m", "size_m"),
        optional_column("D", "m", "depth_m"),
        optional_column("N", "-", "count", int),
        flag_column("On", "on"),
        optional_flag_column("Kn", "known"),
        enum_column("Fix", "fix", FixType),
    )


COLUMNS = make_columns()
ROW = Row(200, "PLN", COLUMNS, Record)
ROW_WITH_TEXT = Row(201, "TXT", COLUMNS, Record, text=True)
ROW_WITH_DEFAULT = Row(200, "PLN", (*COLUMNS, enum_column("Snd", "sound", FixType)), Record)
RECORD = Record(1.0, 2.0, 3, True, True, FixType.FIX_2D)


def format_of(kind: MessageType):
    return Format(kind.number, kind.size, kind.name, kind.values, kind.labels)


def read_all(row, data):
    reader, size = RowReader(row, format_of(row.type), {}), row.type.size
    return [reader.read(data, offset) for offset in range(0, len(data), size)]


@pytest.mark.parametrize(
    "record",
    [
        Record(0.1, None, None, False, None, FixType.NONE),
        Record(-0.0, -0.0, 0, True, False, FixType.RTK_FIXED),
        Record(5e-324, -1.0, -1, True, True, FixType.DGPS),
    ],
)
def test_records_are_read_back(record):
    row = Row(200, "PLN", make_columns(), Record)
    assert repr(read_all(row, row.pack(1.0, record))) == repr([record])
    assert (row.type.values, row.type.units, row.type.multipliers) == ("QdddBbB", "smm----", "F000---")
    (name, number) = integer_column("A", "B", "a", "#"), integer_column("B", "Z", "b")
    assert Row(1, "X", (name, number), Record, text=True).type.units == "s#-----"


@pytest.mark.parametrize("text", ["", "x" * 64, "x" * 65, "é" * 200, "nul\0\0", "\ud800"])
def test_texts_of_any_length_are_read_back(text):
    record, row = msgspec.structs.replace(RECORD, text=text), Row(201, "TXT", COLUMNS, Record, text=True)
    data = row.pack_text(1.0, record, text)
    parts = max(1, math.ceil(len(text.encode("utf-8", "surrogatepass")) / 64))
    assert read_all(row, data) == [None] * (parts - 1) + [record]


def test_a_text_with_a_missing_piece_or_a_wrong_length_is_refused():
    data, size = ROW_WITH_TEXT.pack_text(1.0, RECORD, "x" * 150), ROW_WITH_TEXT.type.size
    wrong_length = bytearray(ROW_WITH_TEXT.pack_text(1.0, RECORD, "x"))
    wrong_length[-65] = 65  # the column Len, before the 64 bytes of the text
    for damaged in (data[size:], data[:size] + data[2 * size :], bytes(wrong_length)):
        with pytest.raises(ValueError, match="missing"):
            read_all(ROW_WITH_TEXT, damaged)


def test_only_columns_that_are_fields_of_the_record_are_read():
    row = Row(200, "PLN", (integer_column("X", "Q", "on"), integer_column("Y", "Q", "nowhere.else_m")), Record)
    assert [name for name, _ in row.fields] == ["on"]


@pytest.mark.parametrize(
    ("t_s", "time_us"), [(0.0, 0), (1.5, 1_500_000), (9e11, 9 * 10**17), (1e12, 0), (-1.0, 0), (math.nan, 0)]
)
def test_time_in_microseconds_is_zero_out_of_range(t_s, time_us):
    assert microseconds(t_s) == time_us


def other_version(labels, values):
    """Return the message type as another version stores it."""
    return MessageType(200, "PLN", labels, values, "-" * len(values), "-" * len(values))


@pytest.mark.parametrize(
    ("row", "kind", "values", "record", "notes"),
    [
        (ROW, ROW.type, (0, 1.0, 2.0, 3.0, 1, 1, 99), None, ["Fix 99 is not known here, the record is left out"]),
        (ROW, ROW.type, (0, 1.0, 2.0, math.inf, 1, 1, 2), None, ["N inf is not known here, the record is left out"]),
        (ROW_WITH_DEFAULT, ROW_WITH_DEFAULT.type, (0, 1.0, 2.0, 3.0, 1, 1, 2, 99), RECORD,
         ["Snd 99 is not known here, its default is taken"]),
        (ROW_WITH_DEFAULT, ROW.type, (0, 1.0, 2.0, 3.0, 1, 1, 2), RECORD,
         ["column Snd is missing, its default is taken"]),
        (ROW, other_version("New,Fix,Kn,On,N,D,S", "QBbBddd"), (7, 2, 1, 1, 3.0, 2.0, 1.0), RECORD, []),
        (ROW, other_version("S,D,N,On,Kn", "dddBb"), (1.0, 2.0, 3.0, 1, 1), None,
         ["column Fix is missing, its records are left out"]),
        (ROW, other_version("S,D,N,On,Kn,Fix", "fddBbH"), (1.0, 2.0, 3.0, 1, 1, 2), RECORD,
         ["column S is stored as 'f', here as 'd'", "column Fix is stored as 'H', here as 'B'"]),
        (ROW, other_version("S,D,N,On,Kn,Fix", "qddBbB"), (1, 2.0, 3.0, 1, 1, 2), None,
         ["column S is stored as 'q', here as 'd'", "column S is missing, its records are left out"]),
    ],
)  # fmt: skip
def test_messages_of_other_versions_are_read_or_noted(row, kind, values, record, notes):
    all_notes = {}
    assert RowReader(row, format_of(kind), all_notes).read(kind.pack(*values), 0) == record
    assert list(all_notes) == [f"message PLN: {note}" for note in notes]
