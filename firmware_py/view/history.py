"""Data of the live page: rows and marks of a voyage of any length, in limited memory."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from firmware_py.view.model import DIGITS, PANELS, POSITION_DIGITS

MAX_ROWS: Final = 2400  # beyond this number every second row is deleted
MAX_MARKS: Final = 300
MAX_NUMBER: Final = 1e15
COLUMNS: Final = (
    "time_s",
    "lat_deg",
    "lon_deg",
    *dict.fromkeys(line.column for panel in PANELS for line in panel.lines),
)

Row = Mapping[str, float | None]
Mark = tuple[float, int, str]  # time in s, severity, text


class History:
    """Rows and marks of a voyage, and the present state.

    `epoch` changes when readers must reload all rows; `now` contains status, plans, target and other values.
    """

    def __init__(self) -> None:
        """Initialise without data."""
        self.epoch = 0
        self.now: dict[str, Any] = {}
        self._rows: list[list[float | None]] = []
        self._marks: deque[Mark] = deque(maxlen=MAX_MARKS)
        self._begin_s, self._last_s = math.inf, -math.inf  # times of the first and the last row
        self._interval_s = 0.0

    def restart(self) -> None:
        """Delete rows and marks of an earlier voyage."""
        self.epoch += 1
        self._rows.clear()
        self._marks.clear()
        self._begin_s, self._last_s = math.inf, -math.inf
        self._interval_s = 0.0

    def add(self, row: Row, marks: Sequence[Mark], now: Mapping[str, Any]) -> bytes:
        """Add a row, new marks and the present state; return the update for the readers as JSON."""
        self.now |= now
        self._marks.extend(marks)
        values = [_round_number(name, row.get(name)) for name in COLUMNS]
        time_s = values[0]
        rows: list[list[float | None]] = []
        if time_s is not None and time_s - self._last_s >= self._interval_s:
            self._rows.append(values)
            rows = [values]
            self._begin_s, self._last_s = min(self._begin_s, time_s), time_s
        if len(self._rows) > MAX_ROWS:
            self._rows = self._rows[::2]  # the first and the last row remain
            self._interval_s = (self._last_s - self._begin_s) / len(self._rows)
            self.epoch += 1
        return _encode_json({"rows": rows, "marks": [list(mark) for mark in marks], "now": now, "values": values})

    def all_data(self) -> bytes:
        """Return all data for a new reader as JSON."""
        return _encode_json(
            {
                "names": COLUMNS,
                "panels": [msgspec.to_builtins(panel) for panel in PANELS],
                "rows": self._rows,
                "marks": [list(mark) for mark in self._marks],
                "now": self.now,
            }
        )


def _round_number(name: str, value: float | None) -> float | None:
    if not isinstance(value, (int, float)) or not abs(value) <= MAX_NUMBER:  # also False for NaN
        return None
    return round(float(value), POSITION_DIGITS if name in ("lat_deg", "lon_deg") else DIGITS)


def _encode_json(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
