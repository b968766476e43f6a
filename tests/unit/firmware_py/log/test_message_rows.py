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


def read_all(row, data, notes=None):
    reader, size = RowReader(row, described(row.type), {} if notes is None else notes), row.type.size
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


def test_a_number_outside_its_enumeration_leaves_the_record_out():
    data = bytearray(PLAIN.pack(1.0, Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)))
    data[-1] = 99
    notes = {}
    assert read_all(PLAIN, bytes(data) * 2, notes) == [None, None]
    assert list(notes) == ["message PLN: Fix 99 is not known here, the record is left out"]


def test_a_number_outside_its_enumeration_leaves_a_field_at_its_default():
    row = Row(202, "DEF", (*COLUMNS, choice("Snd", "sound", FixType)), Thing)
    thing = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D, sound=FixType.DGPS)
    data, notes = bytearray(row.pack(1.0, thing)), {}
    data[-1] = 99
    assert read_all(row, bytes(data), notes) == [Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)]
    assert list(notes) == ["message DEF: Snd 99 is not known here, its default is taken"]


def test_a_number_that_cannot_be_a_whole_one_leaves_the_record_out():
    thing, notes = Thing(1.0, 2.0, math.inf, True, True, FixType.FIX_2D), {}
    assert read_all(PLAIN, PLAIN.pack(1.0, thing), notes) == [None]
    assert list(notes) == ["message PLN: N inf is not known here, the record is left out"]


def test_columns_are_found_by_label():
    kind = MessageType(200, "PLN", "New,Fix,Kn,On,N,D,S", "QBbBddd", "-------", "-------")
    notes = {}
    reader = RowReader(PLAIN, described(kind), notes)
    assert reader.read(kind.pack(7, 3, -1, 1, 4.0, math.nan, 0.5), 0) == Thing(0.5, None, 4, True, None, FixType.FIX_3D)
    assert notes == {}


def test_a_missing_column_without_a_default_leaves_the_records_out():
    kind, notes = MessageType(200, "PLN", "S,D,N,On,Kn", "dddBb", "-----", "-----"), {}
    reader = RowReader(PLAIN, described(kind), notes)
    assert reader.missing == ("Fix",)
    assert reader.read(kind.pack(0.5, 1.0, 2.0, 1, 1), 0) is None
    assert list(notes) == ["message PLN: column Fix is missing, its records are left out"]


def test_a_missing_column_takes_the_default_of_its_field():
    row, notes = Row(200, "PLN", (*COLUMNS, choice("Snd", "sound", FixType)), Thing), {}
    reader = RowReader(row, described(PLAIN.type), notes)
    thing = Thing(1.0, 2.0, 3, True, True, FixType.FIX_2D)
    assert reader.read(PLAIN.pack(1.0, thing), 0) == thing
    assert list(notes) == ["message PLN: column Snd is missing, its default is taken"]


def test_a_column_of_another_size_is_read_and_one_of_another_sort_is_not():
    kind, notes = MessageType(200, "PLN", "S,D,N,On,Kn,Fix", "fddQbH", "------", "------"), {}
    reader = RowReader(PLAIN, described(kind), notes)
    assert reader.read(kind.pack(0.5, 1.0, 2.0, 1, 1, 2), 0) == Thing(0.5, 1.0, 2, True, True, FixType.FIX_2D)
    assert "message PLN: column Fix is stored as 'H', here as 'B'" in notes
    kind = MessageType(200, "PLN", "S,D,N,On,Kn,Fix", "qddBbB", "------", "------")
    assert RowReader(PLAIN, described(kind), {}).missing == ("S",)


def test_only_fields_of_the_record_are_read_back():
    row = Row(200, "PLN", (whole("X", "Q", "on"), whole("Y", "Q", "nowhere.else_m")), Thing)
    assert [name for name, _ in row.fields] == ["on"]


@pytest.mark.parametrize(("t_s", "time_us"), [(0.0, 0), (1.5, 1_500_000), (-1.0, 0), (math.nan, 0), (1e300, 0)])
def test_time_of_the_tools_is_never_an_error(t_s, time_us):
    assert microseconds(t_s) == time_us
