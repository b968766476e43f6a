"""Copies of frozen records with some fields changed, ten times as quick as those of the standard library.

A tick makes some thirty. `dataclasses.replace` asks every field for what it is and runs the generated constructor,
which sets each attribute of a frozen class by its name. This fills an object of a twin of the class, which has the same
slots and is not frozen, so that Python copies slot by slot, and makes it one of the class itself at the end. What does
so is written for each set of fields that are changed together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

from firmware_py.common.record_class import twin_of

__all__ = ["replace"]

if TYPE_CHECKING:
    from dataclasses import replace  # whose fields and types mypy knows
else:

    def replace(record: Record, /, **changes: Any) -> Record:
        """Return a copy of a frozen record with slots; KeyError for a field that it has not.

        A record with a `__post_init__` is not for here: it is not called.
        """
        kind, names = record.__class__, tuple(changes)
        try:
            copied = _COPIERS[kind][names]
        except KeyError:
            copied = _copier_of(kind, names)
        return copied(record, changes)


Record = TypeVar("Record")

_Copier = Callable[[Any, dict[str, Any]], Any]
_COPIERS: dict[type, dict[tuple[str, ...], _Copier]] = {}  # by the fields that are changed, in their order there


def _copier_of(kind: type, changed: tuple[str, ...]) -> _Copier:
    """Write what copies the records of a class with these fields changed, and remember it."""
    if hasattr(kind, "__post_init__"):
        raise TypeError(f"{kind.__name__} checks itself when it is made: copy it with dataclasses.replace")
    names = [field.name for field in fields(kind)]
    if strange := [name for name in changed if name not in names]:
        raise KeyError(*strange)
    known: dict[str, Any] = {"kind": kind, "twin": twin_of(kind)}
    lines = [
        "def copied(record, changes):",
        " copy = twin()",
        *(f" copy.{name} = " + (f"changes['{name}']" if name in changed else f"record.{name}") for name in names),
        " copy.__class__ = kind",
        " return copy",
    ]
    exec("\n".join(lines), known)  # noqa: S102 - the names are those of fields
    copier: _Copier = known["copied"]
    _COPIERS.setdefault(kind, {})[changed] = copier
    return copier
