"""Notes on decoded records: each states the path of a value; no duplicates, at most MAX_NOTES."""

from __future__ import annotations

from typing import Any

import msgspec

MAX_NOTES = 50
MAX_INTEGER = 1 << 1023  # the largest power of two that is a double


class Location(msgspec.Struct, frozen=True):
    """Path of a value in a record, and all notes so far."""

    path: str
    notes: dict[str, None]  # an ordered set

    def note(self, text: str) -> None:
        """Add a note on this value."""
        self.add(f"{self.path}: {text}")

    def add(self, sentence: str) -> None:
        """Add a complete sentence."""
        if len(self.notes) < MAX_NOTES:
            self.notes[sentence] = None
        elif sentence not in self.notes:
            self.notes["and more"] = None

    def field(self, name: str) -> Location:
        """Return the location of a field."""
        return Location(f"{self.path}.{name}", self.notes)


def check_number(data: Any) -> Any:
    """Return a number unchanged; raise ValueError for another type, and for an integer too large for a double."""
    if type(data) is not float and (type(data) is not int or abs(data) > MAX_INTEGER):
        raise ValueError(f"expected a number, found {abbreviate(data)}")
    return data


def abbreviate(data: Any) -> str:
    """Return data as text for a message, at most 60 characters."""
    text = ascii(data)
    return text if len(text) <= 60 else text[:57] + "..."
