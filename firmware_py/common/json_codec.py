"""Frozen dataclasses as JSON text and back, bit for bit.

A dataclass becomes `{"$": "ClassName", "field": value, ...}`, a tuple a list, an
IntEnum its number. Floats are written as Python's shortest text that reads back as
the same double; `NaN`, `Infinity` and `-Infinity` stand for themselves, which Python
reads and strict JSON does not. The outermost record carries the version of the text too.

Text outlives the version that wrote it, so it is read by name: a field that is missing takes
the default of the class, one that is not known is ignored, and one whose value cannot be used
takes its default, or None where that is allowed. The name of a class decides in a union of
classes alone. What was ignored or could not be used is reported in `notes`, plain sentences
with the path. ValueError says where text has no value that is needed, or is no record at all.
record_history.py says how a record may be renamed or moved.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any

import msgspec

from firmware_py.common.reading_notes import LocatedError, Spot, number, shown
from firmware_py.common.record_history import TAG, VERSION, Change, bring_up_to_date, latest_version

Read = Callable[[Any, Spot], Any]


class Hook(msgspec.Struct, frozen=True):
    """How a class that is not a dataclass travels; `decode` raises ValueError for data it refuses."""

    kind: type
    encode: Callable[[Any], Any]
    decode: Read


class FieldHook(msgspec.Struct, frozen=True):
    """How one field of a dataclass travels, where its annotation does not say it."""

    kind: type
    field: str
    encode: Callable[[Any], Any]
    decode: Read


class Codec:
    """Writes and reads records of the given classes, and of all that their annotations name.

    Raises TypeError when built for a class with an annotation that cannot be carried.
    """

    def __init__(
        self,
        roots: Iterable[type],
        hooks: Iterable[Hook] = (),
        fields: Iterable[FieldHook] = (),
        changes: Sequence[Change] = (),
    ) -> None:
        """Compile the readers of the root classes; hooks carry what is no dataclass, changes tell of older text."""
        self._hooks: dict[type, Hook] = {hook.kind: hook for hook in hooks}
        self._field_hooks: dict[type, dict[str, FieldHook]] = {}
        for hook in fields:
            self._field_hooks.setdefault(hook.kind, {})[hook.field] = hook
        self._changes = tuple(changes)
        self._version = latest_version(self._changes)
        self._fields: dict[type, tuple[str, ...]] = {}
        self._classes: dict[type, Read] = {}
        self._roots: dict[str, Read] = {root.__name__: self._class_reader(root) for root in roots}
        if any(VERSION in names for names in self._fields.values()):
            raise TypeError(f"a field cannot be named {VERSION!r}")
        self._encoder = json.JSONEncoder(separators=(",", ":"), default=self._encode)

    def to_text(self, record: object) -> str:
        """Write a record as one line of ASCII; TypeError for a class that cannot be carried."""
        return self._encoder.encode({VERSION: self._version, **self._encode(record)})

    def read(self, text: str) -> tuple[Any, tuple[str, ...]]:
        """Read a record of a root class, and what is to be noted of it; ValueError says what is wrong and where."""
        notes: dict[str, None] = {}
        try:
            data = json.loads(text)
            if isinstance(data, dict):
                bring_up_to_date(data, self._changes, Spot("", notes).add)
            tag = data.get(TAG) if isinstance(data, dict) else None
            root = self._roots.get(tag) if isinstance(tag, str) else None
            if root is None:
                raise ValueError(f"expected one of {', '.join(self._roots)}, found {shown(data)}")
            return root(data, Spot(str(tag), notes)), tuple(notes)
        except RecursionError:
            raise ValueError("the text is nested too deeply") from None

    def _encode(self, value: object) -> Any:
        """Take one step of what the JSON encoder does not know; it calls again for the parts."""
        kind = type(value)
        hook = self._hooks.get(kind)
        if hook is not None:
            return hook.encode(value)
        names = self._fields.get(kind)
        if names is None:
            raise TypeError(f"{kind.__name__} is not among the classes that this codec carries")
        data = {name: getattr(value, name) for name in names}
        for field_hook in self._field_hooks.get(kind, {}).values():
            data[field_hook.field] = field_hook.encode(data[field_hook.field])
        data[TAG] = kind.__name__
        return data

    def _reader(self, hint: Any) -> Read:
        """Compile the reader of one annotation."""
        if isinstance(hint, type) and hint in self._hooks:
            return self._hooks[hint].decode
        simple = _SIMPLE.get(hint)
        if simple is not None:
            return simple
        origin = typing.get_origin(hint)
        if origin in (typing.Union, types.UnionType):
            return self._union_reader(typing.get_args(hint))
        if origin is tuple:
            return self._tuple_reader(typing.get_args(hint))
        if isinstance(hint, type) and issubclass(hint, IntEnum):
            return _enum_reader(hint)
        if isinstance(hint, type) and _is_record(hint):
            return self._class_reader(hint)
        raise TypeError(f"annotation {hint!r} cannot be carried as plain text")

    def _class_reader(self, kind: type) -> Read:
        if kind in self._fields:  # known, or being compiled further up: a class may hold itself
            return lambda data, spot: self._classes[kind](data, spot)  # noqa: PLW0108 -- compiled later
        fields = {field.name: field for field in _fields_of(kind)}
        self._fields[kind] = tuple(fields)
        hints, own = typing.get_type_hints(kind), self._field_hooks.get(kind, {})
        readers = {name: own[name].decode if name in own else self._reader(hints[name]) for name in fields}
        substitutes = {name: _substitute(field, hints[name]) for name, field in fields.items()}

        def read(data: Any, spot: Spot) -> Any:
            if not isinstance(data, dict):
                raise ValueError(f"expected {kind.__name__}, found {shown(data)}")  # noqa: TRY004 -- bad data
            for name in sorted(data.keys() - readers.keys() - {TAG}):
                spot.note(f"field {shown(name)} is not known here, ignored")
            values = {}
            for name, reader in readers.items():
                if name in data:
                    values[name] = _value(reader, data[name], spot.below(name), substitutes[name])
                elif substitutes[name] is None:
                    raise LocatedError(f"{spot.path}: field {name!r} is missing")
                else:
                    values[name] = substitutes[name]()
            return kind(**values)

        self._classes[kind] = read
        return read

    def _union_reader(self, options: tuple[Any, ...]) -> Read:
        records = [option for option in options if isinstance(option, type) and _is_record(option)]
        tagged = {option.__name__: self._reader(option) for option in records}
        others = [self._reader(option) for option in options if option not in records]
        allowed = ", ".join(getattr(option, "__name__", str(option)) for option in options)

        def read(data: Any, spot: Spot) -> Any:
            if isinstance(data, dict) and len(tagged) == 1:
                return next(iter(tagged.values()))(data, spot)
            tag = data.get(TAG) if isinstance(data, dict) else None
            if isinstance(tag, str) and tag in tagged:
                return tagged[tag](data, spot)
            for other in others:
                try:
                    return other(data, spot)
                except ValueError:
                    continue
            raise ValueError(f"expected one of {allowed}, found {shown(data)}")

        return read

    def _tuple_reader(self, items: tuple[Any, ...]) -> Read:
        if len(items) == 2 and items[1] is Ellipsis:
            each = self._reader(items[0])
            return lambda data, spot: tuple(each(item, spot) for item in _list(data))
        readers = [self._reader(item) for item in items]

        def read(data: Any, spot: Spot) -> Any:
            if len(_list(data)) != len(readers):
                raise ValueError(f"expected {len(readers)} items, found {len(data)}")
            return tuple(reader(item, spot) for reader, item in zip(readers, data, strict=True))

        return read


Substitute = Callable[[], Any] | None


def _is_record(kind: type) -> bool:
    return issubclass(kind, msgspec.Struct) or dataclasses.is_dataclass(kind)


def _fields_of(kind: type) -> Any:
    return msgspec.structs.fields(kind) if issubclass(kind, msgspec.Struct) else dataclasses.fields(kind)  # type: ignore[arg-type]


def _substitute(field: Any, hint: Any) -> Any:
    """Return what makes the value of a field that text does not give; None where there is no such value."""
    if field.default is not dataclasses.MISSING and field.default is not msgspec.NODEFAULT:
        return lambda: field.default
    if field.default_factory is not dataclasses.MISSING and field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory
    return (lambda: None) if types.NoneType in typing.get_args(hint) else None


def _value(reader: Read, data: Any, spot: Spot, substitute: Substitute) -> Any:
    """Read the value of a field, or report why it cannot be used and return what stands for it."""
    try:
        return reader(data, spot)
    except ValueError as error:
        located = error if isinstance(error, LocatedError) else LocatedError(f"{spot.path}: {error}")
        if substitute is None:
            raise located from None
        spot.add(
            f"{located}; " + ("its default is taken" if located is not error else f"{spot.path} takes its default")
        )
        return substitute()


def _exactly(what: str, *kinds: type) -> Read:
    """Accept the given JSON types and no subclass: a bool is not a number here."""

    def read(data: Any, _spot: Spot) -> Any:
        if type(data) not in kinds:
            raise ValueError(f"expected {what}, found {shown(data)}")
        return data

    return read


def _enum_reader(kind: type[IntEnum]) -> Read:
    members = {member.value: member for member in kind}

    def read(data: Any, _spot: Spot) -> Any:
        if type(data) is not int or data not in members:
            raise ValueError(f"expected a number of {kind.__name__}, found {shown(data)}")
        return members[data]

    return read


def _list(data: Any) -> list[Any]:
    if not isinstance(data, list):
        raise ValueError(f"expected a list, found {shown(data)}")  # noqa: TRY004 -- bad data, not a bad call
    return data


_SIMPLE: Mapping[Any, Read] = {
    float: number,
    int: _exactly("a whole number", int),
    bool: _exactly("true or false", bool),
    str: _exactly("a text", str),
    types.NoneType: _exactly("null", types.NoneType),
}
