"""Timing of the ticks: start, last tick, and skipped ticks."""

from __future__ import annotations

import msgspec

from firmware_py.common.records import Tick

MAX_STEP_S = 1.0


class TickTiming(msgspec.Struct, frozen=True):
    """Times of the first and the last tick, number of skipped ticks, and time of the last skipped tick."""

    started_s: float | None = None
    t_s: float = 0.0
    skipped_total: int = 0
    skipped_t_s: float | None = None

    def step_s(self, now_s: float) -> float:
        """Return the time since the last tick, at most MAX_STEP_S; 0 before the first tick."""
        return min(max(0.0, now_s - self.t_s), MAX_STEP_S) if self.started_s is not None else 0.0


def update(state: TickTiming, tick: Tick) -> TickTiming:
    """Return the timing after a tick."""
    return TickTiming(
        started_s=tick.t_s if state.started_s is None else state.started_s,
        t_s=tick.t_s,
        skipped_total=state.skipped_total + tick.skipped,
        skipped_t_s=tick.t_s if tick.skipped else state.skipped_t_s,
    )
