"""Copies of frozen records with some fields changed, several times as quick as those of the standard library.

A tick makes some thirty. `dataclasses.replace` asks every field for what it is and runs the generated constructor,
which sets each attribute of a frozen class by its name; this fills the slots themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

__all__ = ["replace"]

if TYPE_CHECKING:
    from dataclasses import replace  # whose fields and types mypy knows
else:

    def replace(record: Record, /, **changes: Any) -> Record:
        """Return a copy of a frozen record with slots; KeyError for a field that it has not.

        A record with a `__post_init__` is not for here: it is not called.
        """
        kind = record.__class__
        layout = _LAYOUTS.get(kind) or _layout_of(kind)
        copy = _new(kind)
        for put, value in zip(layout.puts, layout.values(record), strict=True):
            put(copy, value)
        for name, value in changes.items():
            layout.by_name[name](copy, value)
        return copy


Record = TypeVar("Record")
_new = object.__new__


class _Layout(NamedTuple):
    """The slots of a class: what reads them all, and what sets each."""

    values: Callable[[Any], tuple[Any, ...]]
    puts: tuple[Callable[[Any, Any], None], ...]
    by_name: dict[str, Callable[[Any, Any], None]]


_LAYOUTS: dict[type, _Layout] = {}


def _layout_of(kind: type) -> _Layout:
    """Return the slots of a class with two fields or more, and remember them."""
    if hasattr(kind, "__post_init__"):
        raise TypeError(f"{kind.__name__} checks itself when it is made: copy it with dataclasses.replace")
    names = tuple([field.name for field in fields(kind)])
    by_name = {name: getattr(kind, name).__set__ for name in names}
    values = attrgetter(*names)
    layout = _LAYOUTS[kind] = _Layout(
        values if len(names) > 1 else lambda record: (values(record),), tuple(by_name.values()), by_name
    )
    return layout
