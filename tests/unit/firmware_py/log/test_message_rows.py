import math

import msgspec
import pytest

from firmware_py.common.records import FixType
from firmware_py.log.dataflash import Format, MessageType
from firmware_py.log.message_rows import Row, RowReader, choice, flag, maybe, maybe_flag, microseconds, real, whole


class Thing(msgspec.Struct, frozen=True):
    size_m: float
    depth_m: float | None
    count: int | None
    on: bool
    known: bool | None
    fix: FixType
    text: str = ""
    sound: FixType = FixType.NONE


COLUMNS = (
    real("S", "m", "size_m"),
    maybe("D", "m", "depth_m"),
    maybe("N", "-", "count", int),
    flag("On", "on"),
    maybe_flag("Kn", "known"),
    choice("Fix", "fix", FixType),
)
PLAIN = Row(200, "PLN", COLUMNS, Thing)
TEXTUAL = Row(201, "TXT", COLUMNS, Thing, text=True)


def described(kind: MessageType):
    return Format(kind.number, kind.size, kind.name, kind.values, kind.labels)


def read_all(row, data):
    reader, size = RowReader(row, described(row.type), {}), row.type.size
    return [reader.read(data, at) for at in range(0, len(data), size)]


@pytest.mark.parametrize(
    "thing",
    [
        Thing(0.1, None, None, False, None, FixType.NONE),
        Thing(-0.0, -0.0, 0, True, False, FixType.RTK_FIXED),
        Thing(5e-324, -1.0, -1, True, True, FixType.DGPS),
    ],
)
def test_absent_values_and_kinds_survive(thing):
    assert repr(read_all(PLAIN, PLAIN.pack(1.0, thing))) == repr([thing])


@pytest.mark.parametrize("text", ["", "x" * 64, "x" * 65, "é" * 200, "nul\0\0", "\ud800"])
def test_texts_of_any_length_survive(text):
    thing = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D, text)
    data = TEXTUAL.pack_text(1.0, thing, text)
    parts = max(1, math.ceil(len(text.encode("utf-8", "surrogatepass")) / 64))
    assert read_all(TEXTUAL, data) == [None] * (parts - 1) + [thing]


def test_a_text_with_a_part_missing_is_refused():
    thing = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)
    data, size = TEXTUAL.pack_text(1.0, thing, "x" * 150), TEXTUAL.type.size
    for cut in (data[size:], data[:size] + data[2 * size :]):
        with pytest.raises(ValueError, match="missing"):
            read_all(TEXTUAL, cut)


def test_a_length_beyond_its_column_is_refused():
    thing = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)
    data = bytearray(TEXTUAL.pack_text(1.0, thing, "x"))
    data[-65] = 65
    with pytest.raises(ValueError, match="missing"):
        read_all(TEXTUAL, bytes(data))


def test_only_fields_of_the_record_are_read_back():
    row = Row(200, "PLN", (whole("X", "Q", "on"), whole("Y", "Q", "nowhere.else_m")), Thing)
    assert [name for name, _ in row.fields] == ["on"]


@pytest.mark.parametrize(("t_s", "time_us"), [(0.0, 0), (1.5, 1_500_000), (-1.0, 0), (math.nan, 0), (1e300, 0)])
def test_time_of_the_tools_is_never_an_error(t_s, time_us):
    assert microseconds(t_s) == time_us


DEFAULTED = Row(200, "PLN", (*COLUMNS, choice("Snd", "sound", FixType)), Thing)
THING = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)


def stored(labels, values):
    """Return the type of a message as another version stores it."""
    return MessageType(200, "PLN", labels, values, "-" * len(values), "-" * len(values))


@pytest.mark.parametrize(
    ("row", "kind", "values", "record", "notes"),
    [
        (PLAIN, PLAIN.type, (0, 1.0, 2.0, 3.0, 1, 1, 99), None, ["Fix 99 is not known here, the record is left out"]),
        (PLAIN, PLAIN.type, (0, 1.0, 2.0, math.inf, 1, 1, 2), None,
         ["N inf is not known here, the record is left out"]),
        (DEFAULTED, DEFAULTED.type, (0, 1.0, 2.0, 3.0, 1, 1, 2, 99), THING,
         ["Snd 99 is not known here, its default is taken"]),
        (DEFAULTED, PLAIN.type, (0, 1.0, 2.0, 3.0, 1, 1, 2), THING, ["column Snd is missing, its default is taken"]),
        (PLAIN, stored("New,Fix,Kn,On,N,D,S", "QBbBddd"), (7, 2, 1, 1, 3.0, 2.0, 1.0), THING, []),
        (PLAIN, stored("S,D,N,On,Kn", "dddBb"), (1.0, 2.0, 3.0, 1, 1), None,
         ["column Fix is missing, its records are left out"]),
        (PLAIN, stored("S,D,N,On,Kn,Fix", "fddBbH"), (1.0, 2.0, 3.0, 1, 1, 2), THING,
         ["column S is stored as 'f', here as 'd'", "column Fix is stored as 'H', here as 'B'"]),
        (PLAIN, stored("S,D,N,On,Kn,Fix", "qddBbB"), (1, 2.0, 3.0, 1, 1, 2), None,
         ["column S is stored as 'q', here as 'd'", "column S is missing, its records are left out"]),
    ],
)  # fmt: skip
def test_messages_of_other_versions(row, kind, values, record, notes):
    found = {}
    assert RowReader(row, described(kind), found).read(kind.pack(*values), 0) == record
    assert list(found) == [f"message PLN: {note}" for note in notes]
