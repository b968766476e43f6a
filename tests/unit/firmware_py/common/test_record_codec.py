"""Record codec: records are read by name, and unusable values are reported with their path."""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common import record_codec
from firmware_py.common.record_codec import Hooks, decode, encode, from_text, to_text

MAX_NOTES = 50
MAX_REPAIRS = 100


class Colour(IntEnum):
    RED = 1
    GREEN = 2


class Near(msgspec.Struct, frozen=True, tag=True):
    distance_m: float
    colour: Colour = Colour.RED


class Far(msgspec.Struct, frozen=True, tag=True):
    bearings_rad: tuple[float, ...] = ()


class Depth:
    """A class that msgspec does not know."""

    def __init__(self, fathoms):
        self.fathoms = fathoms

    def __repr__(self):
        return f"Depth({self.fathoms})"

    def __eq__(self, other):
        return self.fathoms == other.fathoms

    __hash__ = None


class Boat(msgspec.Struct, frozen=True):
    name: str = ""
    speed_m_s: float = 0.5
    target: Near | Far | None = None
    places: tuple[Near, ...] = ()
    pair: tuple[Near | None, float] = (None, 0.0)
    counts: Mapping[str, int] = {}
    packed: bytes = b""
    depth: Depth | None = None
    tender: "Boat | None" = None
    label: int | str | None = None


def depth_to_plain(value):
    assert isinstance(value, Depth)
    return {"fathoms": value.fathoms}


def depth_from_plain(_kind, plain):
    if not isinstance(plain, dict) or not isinstance(plain.get("fathoms"), int):
        raise ValueError("this is no depth")  # noqa: TRY004
    return Depth(plain["fathoms"])


def drop_unit(plain, location):
    if isinstance(plain, dict) and plain.pop("unit", None):
        location.note("the unit is not known here, ignored")


HOOKS = Hooks(depth_to_plain, depth_from_plain, {Depth: drop_unit})


numbers = st.floats()  # NaN, infinity and -0.0 among them
nears = st.builds(Near, numbers, st.sampled_from(Colour))
boats = st.builds(
    Boat,
    st.text(),
    numbers,
    st.none() | nears | st.builds(Far, st.lists(numbers).map(tuple)),
    st.lists(nears, max_size=3).map(tuple),
    st.tuples(st.none() | nears, numbers),
    st.dictionaries(st.text(), st.integers(-(2**63), 2**64 - 1)),
    st.binary(),
    st.none() | st.builds(Depth, st.integers(0, 10)),
    st.none() | st.builds(Boat, st.text()),
)
BOAT = Boat("Ada", 1.5, Near(3.0), (Near(1.0), Near(2.0)), (Near(4.0), 5.0), {"fish": 2}, b"\xff", Depth(7), label="B4")


def bits(value):
    """A value with its floats as bits, so that NaN equals itself and -0.0 is not 0.0."""
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, msgspec.Struct):
        return type(value), tuple(bits(getattr(value, name)) for name in value.__struct_fields__)
    return tuple(map(bits, value)) if isinstance(value, tuple) else value


def read(change, version=1):
    plain = msgspec.msgpack.decode(encode(BOAT, 1, HOOKS))
    change(plain)
    return decode(Boat, msgspec.msgpack.encode(plain), version, HOOKS)


def changed(*path_and_value):
    *path, last, value = path_and_value

    def change(plain):
        for key in path:
            plain = plain[key]
        plain[last] = value

    return change


def test_records_of_a_union_are_read_by_their_tags():
    boat = Boat(target=Far((1.0, 2.0)))
    assert decode(Boat, encode(boat, 1), 1) == (boat, ())


class Fleet(msgspec.Struct, frozen=True):
    by_name: Mapping[str, Near] = {}


def test_unusable_value_in_a_mapping_is_ignored_with_the_mapping():
    text = to_text(Fleet({"a": Near(1.0)}), 1)
    fleet, notes = from_text(Fleet, text.replace("1.0", '"far"'), 1)
    assert (fleet, notes) == (Fleet(), ("Fleet.by_name: Expected `float`, got `str`, ignored",))


def test_record_is_prepared_before_it_is_read():
    hooks = Hooks(prepare={Near: lambda plain, location: location.note(f"at {plain.pop('range_m')} m")})
    text = to_text(Fleet({"a": Near(1.0)}), 1).replace('"colour"', '"range_m":5,"colour"')
    assert from_text(Fleet, text, 1, hooks) == (Fleet({"a": Near(1.0)}), ("Fleet.by_name: at 5 m",))


def test_missing_field_has_its_default_without_a_note():
    assert read(lambda plain: plain.pop("speed_m_s")) == (msgspec.structs.replace(BOAT, speed_m_s=0.5), ())


@pytest.mark.parametrize(
    ("path", "note"),
    [
        (("tide_m",), "Boat: field 'tide_m' is not known here, ignored"),
        ((7,), "Boat: field 7 is not known here, ignored"),
        (("target", "tide_m"), "Boat.target: field 'tide_m' is not known here, ignored"),
        (("places", 1, "tide_m"), "Boat.places: field 'tide_m' is not known here, ignored"),
        (("pair", 0, "tide_m"), "Boat.pair: field 'tide_m' is not known here, ignored"),
        (("depth", "unit"), "Boat.depth: the unit is not known here, ignored"),
    ],
)
def test_unknown_field_is_ignored_and_reported(path, note):
    assert read(changed(*path, 1.5)) == (BOAT, (note,))


@pytest.mark.parametrize(
    ("path", "value", "fields", "notes"),
    [
        (("speed_m_s",), "fast", {"speed_m_s": 0.5}, ["Boat.speed_m_s: Expected `float`, got `str`, ignored"]),
        (("speed_m_s",), True, {"speed_m_s": 0.5}, ["Boat.speed_m_s: Expected `float`, got `bool`, ignored"]),
        (("target", "colour"), 7, {}, ["Boat.target.colour: Invalid enum value 7, ignored"]),
        (("target", "type"), "Gone", {"target": None}, ["Boat.target: Invalid value 'Gone', ignored"]),
        (("target", "type"), "x - at `$.pair.x.y`", {"target": None}, ["Boat.target: Invalid value 'x - at"]),
        (("target",), 3, {"target": None}, ["Boat.target: Expected `object | null`, got `int`, ignored"]),
        (("places", 1), 3, {"places": ()}, ["Boat.places: Expected `object`, got `int`, ignored"]),
        (("places",), 3, {"places": ()}, ["Boat.places: Expected `array`, got `int`, ignored"]),
        (("tender",), 3, {"tender": None}, ["Boat.tender: Expected `object | null`, got `int`, ignored"]),
        (("counts", "fish"), "two", {"counts": {}}, ["Boat.counts: Expected `int`, got `str`, ignored"]),
        (("depth",), 3, {"depth": None}, ["Boat.depth: this is no depth, ignored"]),
        (
            ("places", 1, "distance_m"),
            None,
            {"places": ()},
            ["Boat.places[1].distance_m: Expected `float`, got `null`, ignored", "Boat.places: Object missing"],
        ),
    ],
)
def test_unusable_value_is_ignored_and_reported(path, value, fields, notes):
    boat, texts = read(changed(*path, value))
    assert boat == msgspec.structs.replace(BOAT, **fields)
    assert [note[: len(start)] for note, start in zip(texts, notes, strict=False)] == notes


def test_renamed_field_is_read_by_its_former_name(monkeypatch):
    monkeypatch.setitem(record_codec.FORMER_NAMES, "Near", {"range_m": "distance_m"})

    def change(plain):
        for near in (plain["target"], *plain["places"], plain["pair"][0]):
            near["range_m"] = near.pop("distance_m")

    assert read(change) == (BOAT, ())


@pytest.mark.parametrize("change", [lambda plain: plain.pop("version"), changed("version", "1"), changed("version", 0)])
def test_record_without_a_version_is_rejected(change):
    with pytest.raises(ValueError, match="Boat: no version number"):
        read(change)


def test_record_of_a_later_version_is_read_by_name():
    boat, notes = read(changed("version", 4))
    assert boat == BOAT
    assert notes == ("Boat: written by a later version (4, here 1), read by name",)


@given(st.binary().filter(lambda data: not data.startswith(b"{")))
def test_other_bytes_are_rejected(data):
    with pytest.raises(ValueError, match=r"not an encoded record|expected a record of Boat|no version number"):
        decode(Boat, data, 1)


def test_incomplete_records_and_early_texts_are_rejected():
    with pytest.raises(ValueError, match="Near: Object missing required field `distance_m`"):
        decode(Near, msgspec.msgpack.encode({"version": 1}), 1)
    unusable = {"version": 1, "a": 1, "b": 2, "colour": "x", "distance_m": "y"}
    reason = "Near: Object missing required field `distance_m`; Near.distance_m: Expected `float`, got `str`, ignored"
    with pytest.raises(ValueError, match=f"^{reason}$"):
        decode(Near, msgspec.msgpack.encode(unusable), 1)
    data = encode(BOAT, 1, HOOKS)
    for end in range(len(data)):
        with pytest.raises(ValueError, match="not an encoded record"):
            decode(Boat, data[:end], 1)
    early = '{"version":6,"name":"Ada","$":"Boat"}'
    for read_early in (lambda: decode(Boat, early.encode(), 7), lambda: from_text(Boat, early, 7)):
        with pytest.raises(ValueError, match="written as text by an early development version"):
            read_early()
    with pytest.raises(ValueError, match="nested too deeply"):
        from_text(Boat, '{"a":' + "[" * 100_000, 1)


def test_outermost_record_may_have_another_tag():
    other = {"version": 1, "type": "Gone", "distance_m": 2.0}
    assert decode(Near, msgspec.msgpack.encode(other), 1) == (Near(2.0), ("Near.type: Invalid value 'Gone', ignored",))


def test_field_cannot_have_the_name_of_the_version():
    class Odd(msgspec.Struct):
        version: int = 1

    with pytest.raises(TypeError, match="Odd: a field cannot be named 'version'"):
        encode(Odd(), 1)


class Point(NamedTuple):
    """State of the numeric core: NaN is absence."""

    x_m: float = math.nan
    seen: bool = False


class Track(NamedTuple):
    newest: Point = Point()
    corners: tuple[Point, Point] = (Point(), Point(1.0))


class Chart(msgspec.Struct, frozen=True):
    track: Track = Track()
    other: Track | None = None
    by_name: Mapping[str, Point] = {}


CHART = Chart(Track(Point(2.0, seen=True)), Track(corners=(Point(3.0), Point(-0.0))), {"a": Point(4.0)})


def read_chart(change):
    plain = msgspec.msgpack.decode(encode(CHART, 1))
    change(plain)
    return decode(Chart, msgspec.msgpack.encode(plain), 1)


@pytest.mark.parametrize("chart", [Chart(), CHART])
def test_named_tuple_is_restored_bit_for_bit(chart):
    assert "x_m" in to_text(chart, 1)
    assert ('"by_name":{"a":{"x_m":4.0,"seen":false}}' in to_text(chart, 1)) == bool(chart.by_name)
    for restored, notes in (decode(Chart, encode(chart, 1), 1), from_text(Chart, to_text(chart, 1), 1)):
        assert repr(restored) == repr(chart)
        assert notes == ()


@pytest.mark.parametrize(
    ("path", "value", "track", "notes"),
    [
        (("newest", "x_m"), None, Track(Point(seen=True)), ()),
        (("newest",), None, Track(), ()),
        (("corners", 1), None, CHART.track, ()),
        (("newest", "x_m"), 5, Track(Point(5.0, seen=True)), ()),
        (("newest", "x_m"), "x", Track(Point(seen=True)), ("track.newest.x_m: Expected `float`, got `str`, ignored",)),
        (("newest", "y_m"), 1.0, CHART.track, ("track.newest: field 'y_m' is not known here, ignored",)),
        (("newest",), [1.0, True], Track(), ("track.newest: expected fields by name, found [1.0, True], ignored",)),
        (("corners",), [], CHART.track, ("track.corners: Expected `array` of length 2, got 0, ignored",)),
    ],
)
def test_value_of_a_named_tuple_is_read_or_replaced_by_its_default(path, value, track, notes):
    chart, texts = read_chart(changed("track", *path, value))
    assert repr(chart.track) == repr(track if path != ("corners", 1) else Track(track.newest, (Point(), Point())))
    assert texts == tuple(f"Chart.{note}" for note in notes)


class Gains(NamedTuple):
    values: np.ndarray = np.zeros((2, 3))
    count: int = 0


class Filter(msgspec.Struct, frozen=True):
    gains: Gains = Gains()
    depth: Depth | None = None


@pytest.mark.parametrize("hooks", [HOOKS, Hooks()])
def test_array_of_a_named_tuple_has_the_shape_of_its_default(hooks):
    values = np.array([[1.0, -0.0, math.inf], [4.0, 5.0, 6.0]])
    text = to_text(Filter(Gains(values, 7)), 1, hooks)
    restored, notes = from_text(Filter, text, 1, hooks)
    assert (repr(restored.gains), notes) == (repr(Gains(values, 7)), ())
    for part, reason in (("[1.0,-0.0,Infinity],", "length 2, got 1"), ("1.0,", "length 3, got 2")):
        restored, (note,) = from_text(Filter, text.replace(part, ""), 1, hooks)
        assert repr(restored.gains) == repr(Gains(count=7))
        assert note.startswith("Filter.gains.values: Expected `array` of " + reason)


def test_named_tuples_by_name_that_are_no_mapping_are_ignored():
    chart, notes = read_chart(lambda plain: plain.update(by_name=3))
    assert (chart.by_name, notes) == ({}, ("Chart.by_name: Expected `object`, got `int`, ignored",))


def test_missing_or_renamed_field_of_a_named_tuple(monkeypatch):
    monkeypatch.setitem(record_codec.FORMER_NAMES, "Track", {"latest": "newest"})
    chart, notes = read_chart(lambda plain: plain["track"].update(latest=plain["track"].pop("newest")))
    assert (repr(chart), notes) == (repr(CHART), ())
    chart, notes = read_chart(lambda plain: plain["track"]["newest"].pop("seen"))
    assert (chart.track.newest, notes) == (Point(2.0), ())


def test_named_tuple_without_defaults_is_rejected():
    class Odd(msgspec.Struct):
        place: Point | None = None

    Odd.__annotations__["place"] = NamedTuple("Bare", [("x_m", float)]) | None
    with pytest.raises(TypeError, match="Bare: each field of a stored NamedTuple needs a default"):
        encode(Odd(), 1)


@dataclass(frozen=True)
class Plain:
    x_m: float = 0.0


class Other(msgspec.Struct):
    place: Plain | None = None


def test_dataclass_is_rejected():
    with pytest.raises(TypeError, match=r"Plain is no msgspec\.Struct"):
        encode(Other(), 1)


def test_reason_is_printable_and_short():
    _, notes = read(changed("target", "type", "\n\u20ac" * 500))
    assert notes[0].isascii()
    assert notes[0].isprintable()
    assert len(notes[0]) < 200


def test_numbers_of_notes_and_repairs_are_limited():
    _, notes = read(lambda plain: plain.update({f"field_{number}": 1 for number in range(2 * MAX_NOTES)}))
    assert len(notes) == MAX_NOTES + 1
    tenders = {"version": 1}
    inner = tenders
    for _ in range(MAX_REPAIRS + 1):
        inner["speed_m_s"] = "fast"
        inner["tender"] = inner = {}
    with pytest.raises(ValueError, match="more than 100 values cannot be used"):
        decode(Boat, msgspec.msgpack.encode(tenders), 1)


def test_float_of_numpy_is_written_as_a_float():
    assert encode(Near(np.float64(0.1)), 1) == encode(Near(0.1), 1)
    with pytest.raises(TypeError, match="complex"):
        encode(Near(1j), 1)


def test_nan_keeps_its_sign():
    assert math.copysign(1.0, decode(Near, encode(Near(-math.nan), 1), 1)[0].distance_m) == -1.0


class Ashore(msgspec.Struct, frozen=True, tag=True):
    pass


class Place(msgspec.Struct, frozen=True):
    at: Near | Ashore = Ashore()


def test_record_without_fields_is_written_and_read():
    assert from_text(Place, to_text(Place(), 1), 1) == (Place(), ())


@given(boats)
def test_record_is_restored_bit_for_bit(boat):
    data = encode(boat, 3, HOOKS)
    restored, notes = decode(Boat, data, 3, HOOKS)
    assert bits(restored) == bits(boat)
    assert notes == ()
    text = to_text(boat, 3, HOOKS)
    restored, notes = from_text(Boat, text, 3, HOOKS)
    assert repr(bits(restored)) == repr(bits(boat)) or "NaN" in text
    assert to_text(restored, 3, HOOKS) == text
    assert (notes, text.isascii()) == ((), True)
