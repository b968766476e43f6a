"""Encode and decode records (frozen `msgspec.Struct` classes) by name, with a version number.

`encode` and `decode` use msgpack, which keeps every float bit for bit, also NaN and infinity. `to_plain` and
`from_plain` stop at dictionaries, lists, texts and numbers, for a caller with a text format of its own. Numbers of an
enumeration stand for its members; a class of a union needs `tag=True`.

Encoded records outlive the version that wrote them:

* A field that is missing takes its default.
* A field that is not known is ignored and reported with its path.
* A field whose value cannot be used is ignored and reported; its default applies. Where it has no default, the record
  that holds it is ignored in the same way. ValueError says why the outermost record cannot be read.
* A field that was renamed is found under its former name (`FORMER_NAMES`). A renamed class of a union keeps its former
  name as its tag.
"""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from itertools import cycle
from typing import Any, Final, TypeVar

import msgspec

from firmware_py.common.reading_notes import Spot, shown

RecordT = TypeVar("RecordT")
EncodeHook = Callable[[Any], Any]
DecodeHook = Callable[[type, Any], Any]

VERSION: Final = "version"  # beside the fields of the outermost record
MOST_REPAIRS: Final = 100

# By the name of the class: the former name of a field and its name of today.
FORMER_NAMES: dict[str, dict[str, str]] = {}

_LOCATED = re.compile(r"(.*?)(?: - at `(?:key` in `)?\$(.*)`)?", re.DOTALL)
_PART = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")


def encode(record: msgspec.Struct, version: int, hook: EncodeHook | None = None) -> bytes:
    """Return a record and its version as msgpack; `hook` converts what msgspec does not know."""
    return msgspec.msgpack.encode({VERSION: version, **to_plain(record, hook, binary=True)})


def decode(
    kind: type[RecordT], data: bytes, version: int, hook: DecodeHook | None = None
) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record that `encode` wrote, and notes on what was ignored; ValueError says why there is none."""
    if data.startswith(b"{"):
        raise ValueError("written as text by an early development version, which this version cannot read")
    try:
        plain = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"this is no encoded record ({error})") from None
    return from_plain(kind, plain, version, hook)


def to_plain(record: msgspec.Struct, hook: EncodeHook | None = None, *, binary: bool = False) -> dict[str, Any]:
    """Return a record as a dictionary of plain values; bytes become base64 unless `binary` is set."""
    if VERSION in record.__struct_fields__:
        raise TypeError(f"{type(record).__name__}: a field cannot be named {VERSION!r}")
    plain: dict[str, Any] = msgspec.to_builtins(record, builtin_types=(bytes,) if binary else (), enc_hook=hook)
    return plain


def from_plain(
    kind: type[RecordT],
    plain: Any,
    version: int,
    hook: DecodeHook | None = None,
    notes: dict[str, None] | None = None,
) -> tuple[RecordT, tuple[str, ...]]:
    """Return the record that plain values describe, and notes on what was ignored; the values are changed in place.

    `hook` makes what msgspec does not know of a plain value, or raises ValueError. `notes` are of the caller.
    """
    spot = Spot(kind.__name__, {} if notes is None else notes)
    if not isinstance(plain, dict):
        raise ValueError(f"expected a record of {kind.__name__}, found {shown(plain)}")  # noqa: TRY004 -- bad data
    _check_version(plain.pop(VERSION, None), version, spot)
    _visit_record(kind, plain, spot)
    for _ in range(MOST_REPAIRS):
        try:
            return msgspec.convert(plain, kind, dec_hook=hook), tuple(spot.notes)
        except msgspec.ValidationError as error:
            _drop_unusable(plain, error, spot)
    raise ValueError(f"{kind.__name__}: more than {MOST_REPAIRS} values cannot be used")


def _check_version(found: Any, version: int, spot: Spot) -> None:
    if type(found) is not int or found < 1:
        raise ValueError(f"{spot.path}: no version number")
    if found > version:
        spot.note(f"written by a later version ({found}, here {version}), read by name")


def _drop_unusable(plain: dict[str, Any], error: msgspec.ValidationError, spot: Spot) -> None:
    """Remove the field that msgspec refuses, and report it; ValueError when it is the outermost record."""
    located = _LOCATED.fullmatch(str(error))
    reason, path = (str(error), "") if located is None else (located[1], located[2] or "")
    holder: Any = None
    value: Any = plain
    field, end = "", 0
    for part in _PART.finditer(path):
        if part[1] is not None:
            holder, field, end = value, part[1], part.end()
            value = holder.get(field)
        elif part[2] == "...":
            break  # one of the values of a mapping, which one is not said
        else:
            value = value[int(part[2])]
    if holder is None:
        raise ValueError(f"{spot.path}: {reason}") from None
    spot.add(f"{spot.path}{path[:end]}: {reason}, ignored")
    holder.pop(field, None)


Visit = Callable[[Any, Spot], None]


@cache
def _record_visit(kind: Any) -> Visit:
    """Return a function that renames the fields of a record that had other names and drops those not known."""
    hints = typing.get_type_hints(kind)
    visits = {name: _visit_of(hints[name]) for name in kind.__struct_fields__}
    known = visits.keys() | {kind.__struct_config__.tag_field}

    def visit(plain: Any, spot: Spot) -> None:
        if not isinstance(plain, dict):
            return  # which msgspec reports
        for former, name in FORMER_NAMES.get(kind.__name__, {}).items():
            if former in plain and name not in plain:
                plain[name] = plain.pop(former)
        for name in [name for name in plain if name not in known]:
            spot.note(f"field {shown(name)} is not known here, ignored")
            del plain[name]
        for name, deeper in visits.items():
            if deeper is not None and name in plain:
                deeper(plain[name], spot.below(name))

    return visit


def _visit_record(kind: Any, value: Any, spot: Spot) -> None:
    _record_visit(kind)(value, spot)


def _visit_of(hint: Any) -> Visit | None:
    """Return what visits the records in a value of this annotation; None where there are none."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return partial(_visit_record, hint)  # which looks no deeper yet: a record may hold one of its own class
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _union_visit([part for part in parts if part is not types.NoneType])
    if origin is tuple:
        each = [_visit_of(part) for part in parts if part is not Ellipsis]
        return _items_visit(each, repeated=parts[-1] is Ellipsis) if any(each) else None
    if isinstance(origin, type) and issubclass(origin, Mapping) and (one := _visit_of(parts[1])) is not None:
        return _values_visit(one)
    return None


def _union_visit(options: Sequence[Any]) -> Visit | None:
    """Return what visits a value of several classes: records of more than one are told apart by their tags."""
    records = [option for option in options if isinstance(option, type) and issubclass(option, msgspec.Struct)]
    if len(records) < 2:
        return next((one for option in options if (one := _visit_of(option)) is not None), None)
    tag_field = records[0].__struct_config__.tag_field
    by_tag = {record.__struct_config__.tag: record for record in records}

    def visit(value: Any, spot: Spot) -> None:
        tag = value.get(tag_field) if isinstance(value, dict) else None
        if isinstance(tag, str) and tag in by_tag:
            _record_visit(by_tag[tag])(value, spot)

    return visit


def _items_visit(each: Sequence[Visit | None], *, repeated: bool) -> Visit:
    def visit(value: Any, spot: Spot) -> None:
        items = value if isinstance(value, (list, tuple)) else ()
        for item, one in zip(items, cycle(each) if repeated else each, strict=False):
            if one is not None:
                one(item, spot)

    return visit


def _values_visit(one: Visit) -> Visit:
    def visit(value: Any, spot: Spot) -> None:
        for item in value.values() if isinstance(value, dict) else ():
            one(item, spot)

    return visit
