"""When the autopilot began, when its last tick was due, and how many were skipped."""

from __future__ import annotations

import msgspec

from firmware_py.common.records import Tick

LONGEST_STEP_S = 1.0


class TickTiming(msgspec.Struct, frozen=True):
    """When the first and the newest tick were due, how many were skipped, and when that last happened."""

    started_s: float | None = None
    t_s: float = 0.0
    skipped_total: int = 0
    skipped_t_s: float | None = None

    def step_s(self, now_s: float) -> float:
        """Return how long it is since the last tick, 0 before the first, at most LONGEST_STEP_S."""
        return min(max(0.0, now_s - self.t_s), LONGEST_STEP_S) if self.started_s is not None else 0.0


def update(state: TickTiming, tick: Tick) -> TickTiming:
    """Count a tick."""
    return TickTiming(
        started_s=tick.t_s if state.started_s is None else state.started_s,
        t_s=tick.t_s,
        skipped_total=state.skipped_total + tick.skipped,
        skipped_t_s=tick.t_s if tick.skipped else state.skipped_t_s,
    )
