"""Notes on records that are decoded: the path of a value, and plain sentences, each once and a bounded number."""

from __future__ import annotations

from typing import Any

import msgspec

MOST_NOTES = 50
LARGEST_WHOLE = 1 << 1023  # a double holds it


class Spot(msgspec.Struct, frozen=True):
    """The path of a value in a record, and all notes so far."""

    path: str
    notes: dict[str, None]  # in order, each sentence once

    def note(self, text: str) -> None:
        """Report something of this place."""
        self.add(f"{self.path}: {text}")

    def add(self, sentence: str) -> None:
        """Report a sentence that says its place itself."""
        if len(self.notes) < MOST_NOTES:
            self.notes[sentence] = None
        elif sentence not in self.notes:
            self.notes["and more of the kind"] = None

    def below(self, name: str) -> Spot:
        """Return the place of a field."""
        return Spot(f"{self.path}.{name}", self.notes)


def number(data: Any) -> Any:
    """Return a number as it is, an integer as an integer; ValueError for anything else."""
    if type(data) is not float and (type(data) is not int or abs(data) > LARGEST_WHOLE):
        raise ValueError(f"expected a number, found {shown(data)}")
    return data


def shown(data: Any) -> str:
    """Return data as a message shows them, in at most 60 characters."""
    text = ascii(data)
    return text if len(text) <= 60 else text[:57] + "..."
