"""Frozen dataclasses as JSON text and back, bit for bit.

A dataclass becomes `{"$": "ClassName", "field": value, ...}`, a tuple a list, an
IntEnum its number. Floats are written as Python's shortest text that reads back as
the same double; `NaN`, `Infinity` and `-Infinity` stand for themselves, which Python
reads and strict JSON does not. Reading is strict: what the annotations of the class do
not allow is refused, so that text of another version is not half understood.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

TAG = "$"

Read = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Hook:
    """How a class that is not a dataclass travels; `decode` raises ValueError for data it refuses."""

    kind: type
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]


class Codec:
    """Writes and reads records of the given classes, and of all that their annotations name.

    Raises TypeError when built for a class with an annotation that cannot be carried.
    """

    def __init__(self, roots: Iterable[type], hooks: Iterable[Hook] = ()) -> None:
        """Compile the readers of the root classes; hooks carry classes that are not dataclasses."""
        self._hooks: dict[type, Hook] = {hook.kind: hook for hook in hooks}
        self._fields: dict[type, tuple[str, ...]] = {}
        self._classes: dict[type, Read] = {}
        self._roots: dict[str, Read] = {root.__name__: self._class_reader(root) for root in roots}
        self._encoder = json.JSONEncoder(separators=(",", ":"), default=self._encode)

    def to_text(self, record: object) -> str:
        """Write a record as one line of ASCII; TypeError for a class that cannot be carried."""
        return self._encoder.encode(record)

    def from_text(self, text: str) -> Any:
        """Read a record of one of the root classes; ValueError says what is wrong and where."""
        try:
            data = json.loads(text)
            tag = data.get(TAG) if isinstance(data, dict) else None
            root = self._roots.get(tag) if isinstance(tag, str) else None
            if root is None:
                raise ValueError(f"expected one of {', '.join(self._roots)}, found {_shown(data)}")
            return root(data)
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
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            return self._class_reader(hint)
        raise TypeError(f"annotation {hint!r} cannot be carried as plain text")

    def _class_reader(self, kind: type) -> Read:
        if kind in self._fields:  # known, or being compiled further up: a class may hold itself
            return lambda data: self._classes[kind](data)  # noqa: PLW0108 -- not there before it is compiled
        names = tuple(field.name for field in dataclasses.fields(kind))
        self._fields[kind] = names
        hints = typing.get_type_hints(kind)
        readers = {name: self._reader(hints[name]) for name in names}
        expected = {TAG, *names}

        def read(data: Any) -> Any:
            if not isinstance(data, dict) or data.get(TAG) != kind.__name__:
                raise ValueError(f"expected {kind.__name__}, found {_shown(data)}")
            if data.keys() != expected:
                raise ValueError(_fields_differ(kind.__name__, data.keys(), expected))
            return kind(**{name: _located(kind, name, reader, data[name]) for name, reader in readers.items()})

        self._classes[kind] = read
        return read

    def _union_reader(self, options: tuple[Any, ...]) -> Read:
        records = [option for option in options if isinstance(option, type) and dataclasses.is_dataclass(option)]
        tagged = {option.__name__: self._reader(option) for option in records}
        others = [self._reader(option) for option in options if option not in records]
        allowed = ", ".join(getattr(option, "__name__", str(option)) for option in options)

        def read(data: Any) -> Any:
            if isinstance(data, dict) and data.get(TAG) in tagged:
                return tagged[data[TAG]](data)
            for other in others:
                try:
                    return other(data)
                except ValueError:
                    continue
            raise ValueError(f"expected one of {allowed}, found {_shown(data)}")

        return read

    def _tuple_reader(self, items: tuple[Any, ...]) -> Read:
        if len(items) == 2 and items[1] is Ellipsis:
            each = self._reader(items[0])
            return lambda data: tuple(each(item) for item in _list(data))
        readers = [self._reader(item) for item in items]

        def read(data: Any) -> Any:
            if len(_list(data)) != len(readers):
                raise ValueError(f"expected {len(readers)} items, found {len(data)}")
            return tuple(reader(item) for reader, item in zip(readers, data, strict=True))

        return read


def _located(kind: type, name: str, reader: Read, data: Any) -> Any:
    try:
        return reader(data)
    except ValueError as error:
        raise ValueError(f"{kind.__name__}.{name}: {error}") from None


def _fields_differ(name: str, found: Iterable[str], expected: set[str]) -> str:
    unknown = sorted(set(found) - expected)
    missing = sorted(expected - set(found))
    parts = [f"unknown field {field!r}" for field in unknown] + [f"field {field!r} is missing" for field in missing]
    return f"{name}: {', '.join(parts)}"


def _exactly(what: str, *kinds: type) -> Read:
    """Accept the given JSON types and no subclass: a bool is not a number here."""

    def read(data: Any) -> Any:
        if type(data) not in kinds:
            raise ValueError(f"expected {what}, found {_shown(data)}")
        return data

    return read


def _enum_reader(kind: type[IntEnum]) -> Read:
    members = {member.value: member for member in kind}

    def read(data: Any) -> Any:
        if type(data) is not int or data not in members:
            raise ValueError(f"expected a number of {kind.__name__}, found {_shown(data)}")
        return members[data]

    return read


def _list(data: Any) -> list[Any]:
    if not isinstance(data, list):
        raise ValueError(f"expected a list, found {_shown(data)}")  # noqa: TRY004 -- bad data, not a bad call
    return data


def _shown(data: Any) -> str:
    text = repr(data)
    return text if len(text) <= 60 else text[:57] + "..."


_SIMPLE: Mapping[Any, Read] = {
    # A whole number in a float field stays one, so that it computes as it did.
    float: _exactly("a number", float, int),
    int: _exactly("a whole number", int),
    bool: _exactly("true or false", bool),
    str: _exactly("a text", str),
    types.NoneType: _exactly("null", types.NoneType),
}
