"""Encode and decode records (frozen `msgspec.Struct` classes) by name, with a version number.

`encode` and `decode` use msgpack, which keeps every float bit for bit, also NaN and infinity. `to_text` and `from_text`
use JSON with the words NaN, Infinity and -Infinity, where a text is needed. Members of an enumeration are written as
their numbers; a class of a union needs `tag=True`. NamedTuples of the numeric core, whose fields all have defaults, are
written by name, too; null in one of their fields is its default. Arrays of floats in them are written as lists, and
read in the shape of the default.

Encoded records outlive the version that wrote them:

* A field that is missing takes its default.
* A field that is not known is ignored and reported with its path.
* A field whose value cannot be used is ignored and reported; its default applies. Where it has no default, the record
  that holds it is ignored in the same way. ValueError says why the outermost record cannot be read.
* A field that was renamed is found under its former name (`FORMER_NAMES`). A renamed class of a union keeps its former
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

from firmware_py.common.reading_notes import Spot, shown

RecordT = TypeVar("RecordT")

VERSION: Final = "version"  # beside the fields of the outermost record
EARLY_TAG: Final = "$"  # the name of the class, in texts of early development versions
MOST_REPAIRS: Final = 100
MOST_CHARACTERS: Final = 120  # of a reason

# By the name of the class: the former name of a field and its name of today.
FORMER_NAMES: dict[str, dict[str, str]] = {
    "ConvergenceState": {"told": "not_converging"},
    "HalfCycle": {"turned": "is_turn"},
    "LastPlace": {"reckoning": "dead_reckoning"},
    "OscillationState": {
        "softened_s": "reduced_s",
        "softness": "gain_reduction",
        "swung_s": "last_cycle_s",
    },
    "PositionState": {"reckoning": "dead_reckoning"},
    "ResponseState": {
        "felt_rad": "rudder_rad",
        "lacks_other_rad": "lacks_disturbance_rad",
        "other_rad": "disturbance_rad",
    },
    "SteeringLossState": {"missing": "lost", "other_variance": "disturbance_variance"},
    "SteeringMonitorState": {"answer": "loss", "wrong_way": "reversal"},
    "SupervisorState": {"coming_round": "convergence"},
    "TaskFollowerState": {"berth": "loiter_placement"},
}

_LOCATED = re.compile(r"(.*) - at `(?:key` in `)?\$(.*)`", re.DOTALL)  # the last place: a value may look like one
_UNKNOWN_CLASS: Final = "Invalid value "
_PART = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")
_TO_JSON = json.JSONEncoder(separators=(",", ":")).encode


class Hooks(msgspec.Struct, frozen=True):
    """How classes that msgspec does not know are encoded and decoded; both raise ValueError for what they refuse.

    `prepare` changes the plain values of a class in place before they are decoded, and may note something.
    """

    encode: Callable[[Any], Any] | None = None
    decode: Callable[[type, Any], Any] | None = None
    prepare: Mapping[type, Callable[[Any, Spot], None]] = {}


NO_HOOKS: Final = Hooks()


def encode(record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS) -> bytes:
    """Return a record and its version as msgpack."""
    return msgspec.msgpack.encode(to_plain(record, version, hooks, kept=(bytes,)))


def decode(kind: type[RecordT], data: bytes, version: int, hooks: Hooks = NO_HOOKS) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record that `encode` wrote, and notes on what was ignored; ValueError says why there is none."""
    if data.startswith(b"{"):
        raise ValueError(_EARLY)
    try:
        plain = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"this is no encoded record ({error})") from None
    return from_plain(kind, plain, version, hooks)


def to_text(record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS) -> str:
    """Return a record and its version as one line of ASCII; bytes are base64."""
    return text_of(to_plain(record, version, hooks))


def from_text(kind: type[RecordT], text: str, version: int, hooks: Hooks = NO_HOOKS) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record that `to_text` wrote, and notes on what was ignored; ValueError says why there is none."""
    try:
        plain = json.loads(text)
    except RecursionError:
        raise ValueError("the text is nested too deeply") from None
    return from_plain(kind, plain, version, hooks)


def text_of(plain: Mapping[str, Any]) -> str:
    """Return plain values as one line of JSON, ASCII, with the words NaN, Infinity and -Infinity."""
    return _TO_JSON(plain)


def to_plain(
    record: msgspec.Struct, version: int, hooks: Hooks = NO_HOOKS, kept: tuple[type, ...] = ()
) -> dict[str, Any]:
    """Return a record and its version as dictionaries, lists, texts and numbers; bytes are base64 unless `kept`."""
    if VERSION in record.__struct_fields__:
        raise TypeError(f"{type(record).__name__}: a field cannot be named {VERSION!r}")
    encode_other = partial(_encode_other, hooks.encode)
    plain = msgspec.to_builtins(record, builtin_types=kept, enc_hook=encode_other)
    return {VERSION: version, **_name_record(type(record), plain, Spot("", {}), hooks)}


def _encode_other(hook: Callable[[Any], Any] | None, value: Any) -> Any:
    """Return plain values for what msgspec does not know: an array or float of numpy, or what the hook knows."""
    if isinstance(value, (np.ndarray, np.floating)):
        return value.tolist()
    if hook is None:
        raise TypeError(f"{type(value).__name__} cannot be encoded")
    return hook(value)


def _decode_other(hook: Callable[[type, Any], Any] | None, kind: type, value: Any) -> Any:
    """Return a value of a class that msgspec does not know: an array, which is one already, or what the hook knows."""
    if hook is None or isinstance(value, np.ndarray):
        return value
    return hook(kind, value)


def from_plain(
    kind: type[RecordT], plain: Any, version: int, hooks: Hooks = NO_HOOKS
) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record that dictionaries, lists, texts and numbers describe, and notes; they are changed in place."""
    spot = Spot(kind.__name__, {})
    if not isinstance(plain, dict):
        raise ValueError(f"expected a record of {kind.__name__}, found {shown(plain)}")  # noqa: TRY004 -- bad data
    _check_version(plain, version, spot)
    plain = _visit_record(kind, plain, spot, hooks)
    decode_other = partial(_decode_other, hooks.decode)
    for _ in range(MOST_REPAIRS):
        try:
            return msgspec.convert(plain, kind, dec_hook=decode_other), tuple(spot.notes)
        except msgspec.ValidationError as error:
            _drop_unusable(plain, error, spot)
    raise ValueError(f"{kind.__name__}: more than {MOST_REPAIRS} values cannot be used")


_EARLY: Final = "written as text by an early development version, which this version cannot read"


def _check_version(plain: dict[str, Any], version: int, spot: Spot) -> None:
    found = plain.pop(VERSION, None)
    if EARLY_TAG in plain:
        raise ValueError(_EARLY)
    if type(found) is not int or found < 1:
        raise ValueError(f"{spot.path}: no version number")
    if found > version:
        spot.note(f"written by a later version ({shown(found)}, here {version}), read by name")


def _drop_unusable(plain: dict[str, Any], error: msgspec.ValidationError, spot: Spot) -> None:
    """Remove the field that msgspec refuses, and report it; ValueError when it is the outermost record."""
    located = _LOCATED.fullmatch(str(error))
    reason, path = (str(error), "") if located is None else located.groups()
    reason = ascii(reason)[1:-1][:MOST_CHARACTERS]
    held: list[tuple[Any, str, int]] = []  # each field on the way: its record, its name, where it ends in the path
    value: Any = plain
    for part in _PART.finditer(path):
        if part[1] is not None:
            held.append((value, part[1], part.end()))
            value = value.get(part[1])
        elif part[2] == "...":
            break  # one of the values of a mapping, which one is not said
        else:
            value = value[int(part[2])]
    if len(held) > 1 and reason.startswith(_UNKNOWN_CLASS):
        held.pop()  # the tag of a union: the class is not known
    if not held:
        raise ValueError("; ".join((f"{spot.path}: {reason}", *list(spot.notes)[-1:])))
    holder, name, end = held[-1]
    spot.add(f"{spot.path}{path[:end]}: {reason}, ignored")
    holder.pop(name, None)


Visit = Callable[[Any, Spot, Hooks], Any]


def _visit_record(kind: Any, value: Any, spot: Spot, hooks: Hooks) -> Any:
    """Rename the fields of a record that had other names, drop those not known, and prepare the values."""
    if not isinstance(value, dict):
        return value  # which msgspec reports
    _rename(kind, value)
    if (prepare := hooks.prepare.get(kind)) is not None:
        prepare(value, spot)
    visits = _field_visits(kind)
    _drop_unknown(value, visits.keys() | {kind.__struct_config__.tag_field}, spot)
    for name, deeper in visits.items():
        if deeper is not None and name in value:
            value[name] = deeper(value[name], spot.below(name), hooks)
    return value


def _visit_named(kind: Any, value: Any, spot: Spot, hooks: Hooks) -> Any:
    """Return the values of a NamedTuple in their order, as msgspec expects them; null is a default."""
    if value is None:
        value = {}
    if not isinstance(value, dict):
        spot.note(f"expected fields by name, found {shown(value)}, ignored")
        return None
    _rename(kind, value)
    _drop_unknown(value, kind._fields, spot)
    values, hints = [], typing.get_type_hints(kind)
    for name, deeper in _field_visits(kind).items():
        found, at = value.get(name), spot.below(name)
        if deeper is not None:
            found = deeper(found, at, hooks)
        if found is not None:
            try:
                if isinstance(default := kind._field_defaults[name], np.ndarray):
                    found = _array(found, default)
                msgspec.convert(found, hints[name])
            except msgspec.ValidationError as error:
                at.note(f"{ascii(str(error))[1:-1][:MOST_CHARACTERS]}, ignored")
                found = None
        values.append(kind._field_defaults[name] if found is None else found)
    return values


def _array(value: Any, default: Any) -> Any:
    """Return lists of floats as an array; msgspec.ValidationError when they have not the shape of the default."""
    hint: Any = float
    for length in reversed(default.shape):
        hint = types.GenericAlias(tuple, (hint,) * length)
    return np.array(msgspec.convert(value, hint))


def _rename(kind: Any, plain: dict[str, Any]) -> None:
    for former, name in FORMER_NAMES.get(kind.__name__, {}).items():
        if former in plain and name not in plain:
            plain[name] = plain.pop(former)


def _drop_unknown(plain: dict[str, Any], known: Collection[str], spot: Spot) -> None:
    for name in [name for name in plain if name not in known]:
        spot.note(f"field {shown(name)} is not known here, ignored")
        del plain[name]


def _name_record(kind: Any, value: Any, spot: Spot, hooks: Hooks) -> Any:
    """Give the values of the NamedTuples in an encoded record their names."""
    for name, deeper in _field_visits(kind, naming=True).items():
        if deeper is not None:
            value[name] = deeper(value[name], spot, hooks)
    return value


def _name_values(kind: Any, value: Any, spot: Spot, hooks: Hooks) -> Any:
    visits = _field_visits(kind, naming=True).items()
    return {
        name: part if deeper is None else deeper(part, spot, hooks)
        for (name, deeper), part in zip(visits, value, strict=True)
    }


def _visit_other(kind: type, value: Any, spot: Spot, hooks: Hooks) -> Any:
    if value is not None and (prepare := hooks.prepare.get(kind)) is not None:
        prepare(value, spot)
    return value


@cache
def _field_visits(kind: Any, *, naming: bool = False) -> dict[str, Visit | None]:
    """Return the visitor of each field of a record or NamedTuple."""
    names = kind.__struct_fields__ if issubclass(kind, msgspec.Struct) else kind._fields
    hints = typing.get_type_hints(kind)
    return {name: _visit_of(hints[name], naming=naming) for name in names}


def _visit_of(hint: Any, *, naming: bool) -> Visit | None:
    """Return what visits the records in a value of this annotation; None where there are none.

    `naming`: after msgspec has encoded it, otherwise before msgspec decodes it. Raises TypeError for a class whose
    fields msgspec would write without their names.
    """
    if isinstance(hint, type):
        if issubclass(hint, msgspec.Struct):  # looks no deeper yet: a record may hold one of its own class
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
        each = [_visit_of(part, naming=naming) for part in parts if part is not Ellipsis]
        return _items_visit(each, repeated=parts[-1] is Ellipsis) if any(each) else None
    if (
        isinstance(origin, type)
        and issubclass(origin, Mapping)
        and (one := _visit_of(parts[1], naming=naming)) is not None
    ):
        return _values_visit(one)
    return None


def _union_visit(options: Sequence[Any], *, naming: bool) -> Visit | None:
    """Return what visits a value of several classes: records of more than one are told apart by their tags."""
    records = [option for option in options if isinstance(option, type) and issubclass(option, msgspec.Struct)]
    if len(records) < 2:
        one = next((one for option in options if (one := _visit_of(option, naming=naming)) is not None), None)
        return one and (lambda value, spot, hooks: value if value is None else one(value, spot, hooks))
    tag_field = records[0].__struct_config__.tag_field
    by_tag = {record.__struct_config__.tag: _visit_of(record, naming=naming) for record in records}

    def visit(value: Any, spot: Spot, hooks: Hooks) -> Any:
        tag = value.get(tag_field) if isinstance(value, dict) else None
        one = by_tag.get(tag) if isinstance(tag, str) else None
        return value if one is None else one(value, spot, hooks)

    return visit


def _items_visit(each: Sequence[Visit | None], *, repeated: bool) -> Visit:
    def visit(value: Any, spot: Spot, hooks: Hooks) -> Any:
        if not isinstance(value, (list, tuple)):
            return value
        visits = cycle(each) if repeated else chain(each, cycle((None,)))
        return [item if one is None else one(item, spot, hooks) for item, one in zip(value, visits, strict=False)]

    return visit


def _values_visit(one: Visit) -> Visit:
    def visit(value: Any, spot: Spot, hooks: Hooks) -> Any:
        if not isinstance(value, dict):
            return value
        return {name: one(item, spot, hooks) for name, item in value.items()}

    return visit
