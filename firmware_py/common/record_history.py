"""How the text of records changed from version to version, and how older text is brought up to date.

Text carries the number of its version beside the fields of its outermost record; text without one
is of version 1. Before text is read by name, the `Change` of every later version is applied to its
parsed data, in order. Whoever renames a class or a field, or moves a field, adds a row to a change
and nothing else. A path begins with the name of a class, as it was in the version before, and goes
on with fields; it holds wherever such a record is found:

* a field renamed: `("Go.to", "Go.place")`
* a field moved: `("State.lookout", "State.estimate.heading")`; records on the way are made
* a field given up on purpose: `("WatchState.bent_s", None)`; without a row its loss is reported
* a class renamed: `renamed={"Keep": "HoldStation"}`; needed where the class is one of a union, or
  where later rows name it
* a field whose values have another shape: a function in `converted`, by the name of the class; it
  gets the data of one record, as it was in the version before, and changes it in place

A change is applied in this order: converted, moved row by row, renamed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

TAG = "$"
VERSION = "version"
FIRST_VERSION = 1

Record = dict[str, Any]


class Change(msgspec.Struct, frozen=True):
    """What is different from `version` on; ValueError for a row that leads from one class to another."""

    version: int
    moved: tuple[tuple[str, str | None], ...] = ()
    renamed: Mapping[str, str] = msgspec.field(default_factory=dict)
    converted: Mapping[str, Callable[[Record], None]] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the rows."""
        for old, new in self.moved:
            if "." not in old or (new is not None and new.split(".")[0] != old.split(".")[0]):
                raise ValueError(f"{old} -> {new}: both begin with one class and go on with fields")


def latest_version(changes: Sequence[Change]) -> int:
    """Return the version that is written; ValueError when the changes are not numbered 2, 3 and so on."""
    if [change.version for change in changes] != list(range(FIRST_VERSION + 1, FIRST_VERSION + 1 + len(changes))):
        raise ValueError("the changes are not numbered 2, 3 and so on")
    return FIRST_VERSION + len(changes)


def bring_up_to_date(data: Record, changes: Sequence[Change], note: Callable[[str], None]) -> None:
    """Take the version from the outermost record and turn the data, in place, into those of the latest version."""
    latest = latest_version(changes)
    version = data.pop(VERSION, FIRST_VERSION)
    if type(version) is not int or version < FIRST_VERSION:
        note(f"the version is no number, read as version {latest}")
        return
    if version > latest:
        note(f"written by a later version ({version}, here {latest}), read by name")
    for change in changes:
        if change.version > version:
            _apply(change, data, note)


def _apply(change: Change, data: Record, note: Callable[[str], None]) -> None:
    for tag, convert in change.converted.items():
        for record in _records(data).get(tag, ()):
            try:
                convert(record)
            except (ArithmeticError, LookupError, TypeError, ValueError):
                note(f"{tag} cannot be converted to version {change.version}")
    records = _records(data)
    for old, new in change.moved:
        tag, *path = old.split(".")
        for record in records.get(tag, ()):
            _move(record, path, None if new is None else new.split(".")[1:])
    for old, new in change.renamed.items():
        for record in records.get(old, ()):
            record[TAG] = new


def _records(data: Any) -> dict[str, list[Record]]:
    """Return the records at any depth by the name of their class."""
    found: dict[str, list[Record]] = {}
    for record in _walk(data):
        tag = record.get(TAG)
        if isinstance(tag, str):
            found.setdefault(tag, []).append(record)
    return found


def _walk(data: Any) -> Iterator[Record]:
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            yield value
            waiting.extend(value.values())
        elif isinstance(value, list):
            waiting.extend(value)


def _move(record: Record, old: Sequence[str], new: Sequence[str] | None) -> None:
    """Move one field; it stays, and the reading will report it, where its place is taken or cannot be."""
    source = _inner(record, old[:-1], make=False)
    if source is None or old[-1] not in source:
        return
    value = source.pop(old[-1])
    if new is None:
        return
    target = _inner(record, new[:-1], make=True)
    if target is None or new[-1] in target:
        source[old[-1]] = value
    else:
        target[new[-1]] = value


def _inner(record: Record, path: Sequence[str], *, make: bool) -> Record | None:
    """Return the record at the end of a path, made where it is absent and `make` says so; None when there is none."""
    for name in path:
        inner = record.setdefault(name, {}) if make else record.get(name)
        if not isinstance(inner, dict):
            return None
        record = inner
    return record
