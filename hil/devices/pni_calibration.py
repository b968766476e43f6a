"""User calibration of a TCM (TCM User Manual, 7.3.10 to 7.3.18)."""

from __future__ import annotations

import math

# Full range, 2D, hard iron only, limited tilt, accelerometers only, accelerometers and magnetometers.
OPTIONS = frozenset({10, 20, 30, 40, 100, 110})
SAMPLE_INTERVAL_S = 0.1
SCORING_TIME_S = 2.0
ABORTED_SCORE = 179.8
_FULL_TURN_DEG = 360.0


class UserCalibration:
    """Takes `points` samples, evenly spaced over a full turn, then reports `final_score`."""

    def __init__(self, now_s: float, points: int, final_score: float) -> None:
        """Start without samples."""
        self.next_s = now_s + SAMPLE_INTERVAL_S
        self.count = 0
        self._points = points
        self._final_score = final_score
        self._spacing_deg = _FULL_TURN_DEG / points
        self._last_deg: float | None = None

    def update(self, heading_deg: float) -> tuple[int | None, float | None]:
        """Process a heading; return the number of a new sample, and the score after the last one."""
        if self.count == self._points:
            self.next_s = math.inf
            return None, self._final_score
        self.next_s += SAMPLE_INTERVAL_S
        turned_deg = (
            None if self._last_deg is None else abs(math.remainder(heading_deg - self._last_deg, _FULL_TURN_DEG))
        )
        if turned_deg is not None and turned_deg < self._spacing_deg:
            return None, None
        self._last_deg = heading_deg
        self.count += 1
        if self.count == self._points:
            self.next_s += SCORING_TIME_S
        return self.count, None
