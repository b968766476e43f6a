"""Frozen records as `dataclasses.dataclass(frozen=True, slots=True)` makes them, in a fifth of the time.

The standard library writes and compiles six functions for each class, which was two fifths of a start. Here one is, the
constructor, and that when the first record is made; it makes one in half the time, too. What else a record does is
shared. Who makes a record in every tick asks for a `maker`: Python hands a class its keywords in a dictionary, and a
function each in its place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NoReturn, ParamSpec, TypeVar

__all__ = ["dataclass", "maker"]

Words = ParamSpec("Words")
Record = TypeVar("Record")

if TYPE_CHECKING:
    from dataclasses import dataclass  # which mypy knows
else:

    def dataclass(*, frozen: bool, slots: bool) -> Callable[[type], type]:
        """Return what makes a record of a class; for records without bases, frozen and with slots, and no others."""
        if not (frozen and slots):
            raise TypeError("it is for frozen records with slots; others are those of dataclasses.dataclass")
        return _record_of


def _record_of(source: type) -> type:
    """Return a class as a record."""
    kind: Any = dataclasses.dataclass(init=False, repr=False, eq=False, slots=True)(source)
    fields = dataclasses.fields(kind)
    names = tuple([field.name for field in fields])
    parameters = kind.__dataclass_params__
    parameters.init = parameters.repr = parameters.eq = parameters.frozen = True
    values = _reader(names)
    kind.__init__ = _awaited_constructor(kind)
    kind.__repr__ = lambda record: _text(record, names, values)
    kind.__eq__ = lambda one, other: (
        values(one) == values(other) if other.__class__ is one.__class__ else NotImplemented
    )
    kind.__hash__ = lambda record: hash(values(record))
    kind.__setattr__, kind.__delattr__ = _refuse_set, _refuse_delete
    kind.__getstate__ = lambda record: list(values(record))
    kind.__setstate__ = _restore
    made: type = kind
    return made


def _reader(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """Return what reads these attributes of a record as a tuple."""
    if not names:
        return lambda _record: ()
    read = attrgetter(*names)
    return read if len(names) > 1 else lambda record: (read(record),)


def maker(kind: Callable[Words, Record]) -> Callable[Words, Record]:
    """Return a function that makes records of a class as the class itself does, keywords in half the time.

    With more than fifteen keywords Python makes a dictionary of them here too: some are to be told by their places.
    """
    known, parameters, lines = _filling(kind)
    code = [f"def make({', '.join(parameters)}):", " self = _twin()", *lines, " return self"]
    exec("\n".join(code), known)  # noqa: S102 - as the standard library does
    make: Callable[Words, Record] = known["make"]
    return make


def _awaited_constructor(kind: Any) -> Callable[..., None]:
    """Return what puts the constructor in its place when the first record is made; many a class makes none for long."""

    def __init__(self: object, *words: Any, **more: Any) -> None:  # noqa: N807 - it is one
        kind.__init__ = _constructor(kind)
        kind.__init__(self, *words, **more)

    return __init__


def _constructor(kind: type) -> Callable[..., None]:
    """Return the constructor of a record."""
    known, parameters, lines = _filling(kind)
    known["_put_class"] = _put_class
    code = [f"def __init__({', '.join(['self', *parameters])}):", " _put_class(self, _twin)", *lines]
    exec("\n".join(code), known)  # noqa: S102 - as the standard library does
    made: Callable[..., None] = known["__init__"]
    made.__qualname__ = f"{kind.__qualname__}.__init__"
    return made


def _filling(kind: Any) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return what fills a record `self`: names that it knows, a parameter for each field, an assignment to it.

    A record is of its twin meanwhile, which has the same slots and is not frozen: Python knows there where a slot lies,
    and need not call its descriptor.
    """
    parameters, lines, known = [], [], {"_kind": kind, "_twin": twin_of(kind)}
    for name, field in ((field.name, field) for field in dataclasses.fields(kind)):
        value = name
        if field.default_factory is not dataclasses.MISSING:
            known[f"_make_{name}"], known["_missing"] = field.default_factory, dataclasses.MISSING
            parameters.append(f"{name}=_missing")
            value = f"_make_{name}() if {name} is _missing else {name}"
        elif field.default is not dataclasses.MISSING:
            known[f"_default_{name}"] = field.default
            parameters.append(f"{name}=_default_{name}")
        else:
            parameters.append(name)
        lines.append(f" self.{name} = {value}")
    lines.append(" self.__class__ = _kind")
    if hasattr(kind, "__post_init__"):
        lines.append(" self.__post_init__()")
    return known, parameters, lines


_FILLED: Final = {
    "__init__": object.__init__,
    "__setattr__": object.__setattr__,
    "__delattr__": object.__delattr__,
}
_put_class = vars(object)["__class__"].__set__  # past the frozen class's own


@cache
def twin_of(kind: type) -> type:
    """Return a class of records that begin empty and can be filled: with the very slots of this one, to become it."""
    return type(f"{kind.__name__}Twin", (kind,), {"__slots__": (), **_FILLED})


def _text(record: Any, names: tuple[str, ...], values: Callable[[Any], tuple[Any, ...]]) -> str:
    parts = ", ".join(f"{name}={value!r}" for name, value in zip(names, values(record), strict=True))
    return f"{record.__class__.__qualname__}({parts})"


def _refuse_set(_record: object, name: str, _value: object) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_delete(_record: object, name: str) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _restore(record: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(record), state, strict=True):
        object.__setattr__(record, field.name, value)
