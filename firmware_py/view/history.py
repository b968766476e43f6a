"""What a page under way has to show: rows of a voyage as they come, whole and bounded however long it takes."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from firmware_py.view.model import DIGITS, PANELS, PLACE_DIGITS

MOST_ROWS: Final = 2400  # then every other one is left out, and rows come half as often from then on
MOST_MARKS: Final = 300
MOST: Final = 1e15  # of a number that anybody could mean
COLUMNS: Final = ("time_s", "lat_deg", "lon_deg", *dict.fromkeys(line.column for one in PANELS for line in one.lines))

Row = Mapping[str, float | None]
Mark = tuple[float, int, str]


class History:
    """The rows and marks of a voyage and what is so now; `epoch` changes when what was told is not to be added to."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.epoch = 0
        self.now: dict[str, Any] = {}  # beside the columns: status, plans, target and so on
        self._rows: list[list[float | None]] = []
        self._marks: deque[Mark] = deque(maxlen=MOST_MARKS)
        self._least_s = 0.0

    def begin_anew(self) -> None:
        """Forget the rows and marks: of another voyage."""
        self.epoch += 1
        self._rows.clear()
        self._marks.clear()
        self._least_s = 0.0

    def add(self, row: Row, marks: Sequence[Mark], now: Mapping[str, Any]) -> bytes:
        """Take a row, new marks and what is so now; return what is to be told of it, as JSON."""
        self.now |= now
        self._marks.extend(marks)
        values = [_number(name, row.get(name)) for name in COLUMNS]
        time_s = values[0]
        told: list[list[float | None]] = []
        if time_s is not None and (not self._rows or time_s - (self._rows[-1][0] or 0.0) >= self._least_s):
            self._rows.append(values)
            told = [values]
        if len(self._rows) > MOST_ROWS:
            span_s = (self._rows[-1][0] or 0.0) - (self._rows[0][0] or 0.0)
            self._rows = self._rows[::2]
            self._least_s = span_s / len(self._rows)
            self.epoch += 1
        return _json({"rows": told, "marks": [list(mark) for mark in marks], "now": now, "values": values})

    def whole(self) -> bytes:
        """Return all of it, as JSON."""
        return _json(
            {
                "names": COLUMNS,
                "panels": [msgspec.to_builtins(panel) for panel in PANELS],
                "rows": self._rows,
                "marks": [list(mark) for mark in self._marks],
                "now": self.now,
            }
        )


def _number(name: str, value: float | None) -> float | None:
    if not isinstance(value, (int, float)) or not abs(value) <= MOST:  # NaN is no number either
        return None
    return round(float(value), PLACE_DIGITS if name in ("lat_deg", "lon_deg") else DIGITS)


def _json(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
