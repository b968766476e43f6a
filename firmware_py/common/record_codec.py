"""Encode and decode records (frozen `msgspec.Struct` classes) by name, with a version number.

`encode` and `decode` use msgpack, which keeps every float bit for bit, also NaN and infinity. `to_text` and `from_text`
use JSON with the words NaN, Infinity and -Infinity, where a text is needed. Members of an enumeration are written as
their numbers; a class of a union needs `tag=True`. NamedTuples of the numeric core, whose fields all have defaults, are
written by name, too; null in one of their fields is its default. Arrays of floats in them are written as lists, and
read in the shape of the default.

Encoded records can be read by later versions:

* A missing field has its default value.
* An unknown field is ignored and reported with its path.
* A field whose value cannot be used is ignored and reported; its default applies. Where it has no default, the record
  that contains it is ignored in the same way. If that is the outermost record, ValueError contains the reason.
* A renamed field is also read by its former name (`FORMER_NAMES`). A renamed class of a union keeps its former
  name as its tag.
"""

from __future__ import annotations

import json
import re
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from enum import Enum
from functools import cache, partial
from itertools import chain, cycle
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

from firmware_py.common.reading_notes import Location, abbreviate

RecordT = TypeVar("RecordT")

VERSION: Final = "version"  # key of the version number in the outermost record
EARLY_TAG: Final = "$"  # the name of the class, in texts of early development versions
MAX_REPAIRS: Final = 100
MAX_REASON_LENGTH: Final = 120

# By the name of the class: former and present names of fields.
FORMER_NAMES: dict[str, dict[str, str]] = {
    "AvoidanceState": {"going_on": "unchanged", "told": "is_refusal_reported"},
    "Block": {"shown_rad": "compass_rad"},
    "CompassState": {"stay": "plateau"},
    "ConvergenceState": {"told": "not_converging"},
    "DeviceReports": {"power_told_s": "power_reported_s"},
    "Evidence": {"telling_s": "turn_time_s"},
    "HalfCycle": {"turned": "is_turn"},
    "HeadingTick": {"silent": "uncorrected", "silent_s": "uncorrected_s", "swing_rad2": "wave_yaw_rad2"},
    "LatchState": {"stood_s": "last_present_s"},
    "LastPosition": {"reckoning": "dead_reckoning"},
    "LoiterPlacement": {"asked_margin_m": "requested_margin_m", "found": "is_final"},
    "OscillationState": {
        "softened_s": "reduced_s",
        "softness": "gain_reduction",
        "swung_s": "last_cycle_s",
    },
    "PositionConsistency": {"still_told": "still_reported", "told_s": "reported_s"},
    "PositionState": {"reckoning": "dead_reckoning"},
    "ResponseState": {
        "felt_rad": "rudder_rad",
        "beyond_rad": "residual_rad",
        "lacks_disturbance_rad": "disturbance_deficit_rad",
        "lacks_other_rad": "disturbance_deficit_rad",
        "lacks_rad": "heading_deficit_rad",
        "other_rad": "disturbance_rad",
    },
    "SteeringLossState": {
        "missing": "lost",
        "other_variance": "disturbance_variance",
        "wander": "disturbance_power_rad2",
    },
    "SteeringMonitorState": {"answer": "loss", "wrong_way": "reversal"},
    "SupervisorState": {"coming_round": "convergence"},
    "TrafficState": {
        "looked_s": "checked_s",
        "receiver_told_s": "receiver_reported_s",
        "told_s": "reported_s",
        "turned_away": "rejected",
    },
    "Trial": {"part": "ratio"},
    "TaskFollowerState": {"berth": "loiter_placement"},
}

# Reason and path; the path is the last match, because a value may contain the same words.
_ERROR_TEXT = re.compile(r"(.*) - at `(?:key` in `)?\$(.*)`", re.DOTALL)
_UNKNOWN_CLASS: Final = "Invalid value "
_PATH_ELEMENT = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")
_TO_JSON = json.JSONEncoder(separators=(",", ":")).encode


class Hooks(msgspec.Struct, frozen=True):
    """Encoder and decoder of classes that msgspec does not know; both raise ValueError for invalid values.

    `prepare` changes the plain values of a class in place before they are decoded, and may add notes.
    """

    encode: Callable[[Any], Any] | None = None
    decode: Callable[[type, Any], Any] | None = None
    prepare: Mapping[type, Callable[[Any, Location], None]] = {}


NO_HOOKS: Final = Hooks()


def encode(record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS) -> bytes:
    """Return a record and its version as msgpack."""
    return msgspec.msgpack.encode(to_plain(record, version, hooks, unchanged_types=(bytes,)))


def decode(kind: type[RecordT], data: bytes, version: int, hooks: Hooks = NO_HOOKS) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record written by `encode`, and notes on ignored parts; ValueError if it cannot be read."""
    if data.startswith(b"{"):
        raise ValueError(_EARLY)
    try:
        plain = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"not an encoded record ({error})") from None
    return from_plain(kind, plain, version, hooks)


def to_text(record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS) -> str:
    """Return a record and its version as one line of ASCII; bytes are base64."""
    return text_of(to_plain(record, version, hooks))


def from_text(kind: type[RecordT], text: str, version: int, hooks: Hooks = NO_HOOKS) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record written by `to_text`, and notes on ignored parts; ValueError if it cannot be read."""
    try:
        plain = json.loads(text)
    except RecursionError:
        raise ValueError("the text is nested too deeply") from None
    return from_plain(kind, plain, version, hooks)


def text_of(plain: Mapping[str, Any]) -> str:
    """Return plain values as one line of JSON, ASCII, with the words NaN, Infinity and -Infinity."""
    return _TO_JSON(plain)


def to_plain(
    record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS, unchanged_types: tuple[type, ...] = ()
) -> dict[str, Any]:
    """Return a record and its version as plain values; bytes become base64 unless they are in `unchanged_types`."""
    if VERSION in record.__struct_fields__:
        raise TypeError(f"{type(record).__name__}: a field cannot be named {VERSION!r}")
    encode_other = partial(_encode_other, hooks.encode)
    plain = msgspec.to_builtins(record, builtin_types=unchanged_types, enc_hook=encode_other)
    return {VERSION: version, **_name_record(type(record), plain, Location("", {}), hooks)}


def _encode_other(hook: Callable[[Any], Any] | None, value: Any) -> Any:
    """Return plain values for an array or float of numpy, or by the hook for other classes."""
    if isinstance(value, (np.ndarray, np.floating)):
        return value.tolist()
    if hook is None:
        raise TypeError(f"{type(value).__name__} cannot be encoded")
    return hook(value)


def _decode_other(hook: Callable[[type, Any], Any] | None, kind: type, value: Any) -> Any:
    """Return an array unchanged, and values of other classes by the hook."""
    if hook is None or isinstance(value, np.ndarray):
        return value
    return hook(kind, value)


def from_plain(
    kind: type[RecordT], plain: Any, version: int, hooks: Hooks = NO_HOOKS
) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record described by plain values, which are changed in place, and notes on ignored parts."""
    location = Location(kind.__name__, {})
    if not isinstance(plain, dict):
        raise ValueError(f"expected a record of {kind.__name__}, found {abbreviate(plain)}")  # noqa: TRY004 -- bad data
    _check_version(plain, version, location)
    plain = _visit_record(kind, plain, location, hooks)
    decode_other = partial(_decode_other, hooks.decode)
    for _ in range(MAX_REPAIRS):
        try:
            return msgspec.convert(plain, kind, dec_hook=decode_other), tuple(location.notes)
        except msgspec.ValidationError as error:
            _drop_unusable(plain, error, location)
    raise ValueError(f"{kind.__name__}: more than {MAX_REPAIRS} values cannot be used")


_EARLY: Final = "written as text by an early development version, which this version cannot read"


def _check_version(plain: dict[str, Any], version: int, location: Location) -> None:
    written_version = plain.pop(VERSION, None)
    if EARLY_TAG in plain:
        raise ValueError(_EARLY)
    if type(written_version) is not int or written_version < 1:
        raise ValueError(f"{location.path}: no version number")
    if written_version > version:
        location.note(f"written by a later version ({abbreviate(written_version)}, here {version}), read by name")


def _drop_unusable(plain: dict[str, Any], error: msgspec.ValidationError, location: Location) -> None:
    """Remove and report the field that msgspec refuses; ValueError if it is the outermost record."""
    located = _ERROR_TEXT.fullmatch(str(error))
    reason, path = (str(error), "") if located is None else located.groups()
    reason = ascii(reason)[1:-1][:MAX_REASON_LENGTH]
    holders: list[tuple[Any, str, int]] = []  # each field of the path: its record, its name, its end in the path
    value: Any = plain
    for part in _PATH_ELEMENT.finditer(path):
        if part[1] is not None:
            holders.append((value, part[1], part.end()))
            value = value.get(part[1])
        elif part[2] == "...":
            break  # an unnamed value of a mapping
        else:
            value = value[int(part[2])]
    if len(holders) > 1 and reason.startswith(_UNKNOWN_CLASS):
        holders.pop()  # the tag of a union: the class is unknown
    if not holders:
        raise ValueError("; ".join((f"{location.path}: {reason}", *list(location.notes)[-1:])))
    holder, name, end = holders[-1]
    location.add(f"{location.path}{path[:end]}: {reason}, ignored")
    holder.pop(name, None)


Visit = Callable[[Any, Location, Hooks], Any]


def _visit_record(kind: Any, value: Any, location: Location, hooks: Hooks) -> Any:
    """Rename former fields of a record, drop unknown ones, and prepare the values."""
    if not isinstance(value, dict):
        return value  # msgspec reports it
    _rename(kind, value)
    if (prepare := hooks.prepare.get(kind)) is not None:
        prepare(value, location)
    visits = _field_visits(kind)
    _drop_unknown(value, visits.keys() | {kind.__struct_config__.tag_field}, location)
    for name, visit in visits.items():
        if visit is not None and name in value:
            value[name] = visit(value[name], location.field(name), hooks)
    return value


def _visit_named(kind: Any, value: Any, location: Location, hooks: Hooks) -> Any:
    """Return the values of a NamedTuple in order, as msgspec expects them; null means the default."""
    if value is None:
        value = {}
    if not isinstance(value, dict):
        location.note(f"expected fields by name, found {abbreviate(value)}, ignored")
        return None
    _rename(kind, value)
    _drop_unknown(value, kind._fields, location)
    values, hints = [], typing.get_type_hints(kind)
    for name, visit in _field_visits(kind).items():
        item, item_location = value.get(name), location.field(name)
        if visit is not None:
            item = visit(item, item_location, hooks)
        if item is not None:
            try:
                if isinstance(default := kind._field_defaults[name], np.ndarray):
                    item = _convert_array(item, default)
                msgspec.convert(item, hints[name])
            except msgspec.ValidationError as error:
                item_location.note(f"{ascii(str(error))[1:-1][:MAX_REASON_LENGTH]}, ignored")
                item = None
        values.append(kind._field_defaults[name] if item is None else item)
    return values


def _convert_array(value: Any, default: Any) -> Any:
    """Return lists of floats as an array; msgspec.ValidationError if the shape differs from the default."""
    hint: Any = float
    for length in reversed(default.shape):
        hint = types.GenericAlias(tuple, (hint,) * length)
    return np.array(msgspec.convert(value, hint))


def _rename(kind: Any, plain: dict[str, Any]) -> None:
    for former, name in FORMER_NAMES.get(kind.__name__, {}).items():
        if former in plain and name not in plain:
            plain[name] = plain.pop(former)


def _drop_unknown(plain: dict[str, Any], known: Collection[str], location: Location) -> None:
    for name in [name for name in plain if name not in known]:
        location.note(f"field {abbreviate(name)} is not known here, ignored")
        del plain[name]


def _name_record(kind: Any, value: Any, location: Location, hooks: Hooks) -> Any:
    """Convert the NamedTuples in an encoded record to dictionaries by name."""
    for name, visit in _field_visits(kind, naming=True).items():
        if visit is not None:
            value[name] = visit(value[name], location, hooks)
    return value


def _name_values(kind: Any, value: Any, location: Location, hooks: Hooks) -> Any:
    visits = _field_visits(kind, naming=True).items()
    return {
        name: part if visit is None else visit(part, location, hooks)
        for (name, visit), part in zip(visits, value, strict=True)
    }


def _visit_other(kind: type, value: Any, location: Location, hooks: Hooks) -> Any:
    if value is not None and (prepare := hooks.prepare.get(kind)) is not None:
        prepare(value, location)
    return value


@cache
def _field_visits(kind: Any, *, naming: bool = False) -> dict[str, Visit | None]:
    """Return the visitor of each field of a record or NamedTuple."""
    names = kind.__struct_fields__ if issubclass(kind, msgspec.Struct) else kind._fields
    hints = typing.get_type_hints(kind)
    return {name: _visit_of(hints[name], naming=naming) for name in names}


def _visit_of(hint: Any, *, naming: bool) -> Visit | None:
    """Return the visitor of the records in a value of this annotation, None if there are none.

    `naming`: for values encoded by msgspec, otherwise for values to be decoded. Raises TypeError for a class whose
    fields msgspec would write without names.
    """
    if isinstance(hint, type):
        if issubclass(hint, msgspec.Struct):  # resolved later: a record may contain one of its own class
            return partial(_name_record if naming else _visit_record, hint)
        if names := getattr(hint, "_fields", None):
            if getattr(hint, "_field_defaults", {}).keys() != set(names):
                raise TypeError(f"{hint.__name__}: each field of a stored NamedTuple needs a default")
            return partial(_name_values if naming else _visit_named, hint)
        if hasattr(hint, "__dataclass_fields__"):
            raise TypeError(f"{hint.__name__} is no msgspec.Struct: its fields would have no names, or no reports")
        return (
            None if naming or hint.__module__ == "builtins" or issubclass(hint, Enum) else partial(_visit_other, hint)
        )
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _union_visit([part for part in parts if part is not types.NoneType], naming=naming)
    if origin is tuple:
        visits = [_visit_of(part, naming=naming) for part in parts if part is not Ellipsis]
        return _items_visit(visits, repeated=Ellipsis in parts) if any(visits) else None
    if (
        isinstance(origin, type)
        and issubclass(origin, Mapping)
        and (visit_value := _visit_of(parts[1], naming=naming)) is not None
    ):
        return _values_visit(visit_value)
    return None


def _union_visit(options: Sequence[Any], *, naming: bool) -> Visit | None:
    """Return the visitor of a union; records of several classes are distinguished by their tags."""
    records = [option for option in options if isinstance(option, type) and issubclass(option, msgspec.Struct)]
    if len(records) < 2:
        visits = (_visit_of(option, naming=naming) for option in options)
        record_visit = next((visit for visit in visits if visit is not None), None)
        return record_visit and (
            lambda value, location, hooks: value if value is None else record_visit(value, location, hooks)
        )
    tag_field = records[0].__struct_config__.tag_field
    by_tag = {record.__struct_config__.tag: _visit_of(record, naming=naming) for record in records}

    def visit(value: Any, location: Location, hooks: Hooks) -> Any:
        tag = value.get(tag_field) if isinstance(value, dict) else None
        visit_class = by_tag.get(tag) if isinstance(tag, str) else None
        return value if visit_class is None else visit_class(value, location, hooks)

    return visit


def _items_visit(item_visits: Sequence[Visit | None], *, repeated: bool) -> Visit:
    def visit(value: Any, location: Location, hooks: Hooks) -> Any:
        if not isinstance(value, (list, tuple)):
            return value
        visits = cycle(item_visits) if repeated else chain(item_visits, cycle((None,)))
        return [
            item if visit_item is None else visit_item(item, location, hooks)
            for item, visit_item in zip(value, visits, strict=False)
        ]

    return visit


def _values_visit(visit_item: Visit) -> Visit:
    def visit(value: Any, location: Location, hooks: Hooks) -> Any:
        if not isinstance(value, dict):
            return value
        return {name: visit_item(item, location, hooks) for name, item in value.items()}

    return visit
