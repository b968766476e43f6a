"""Whether she comes to her heading: a rudder that is hard over for minutes while she comes no nearer is told.

That she answers is another matter, and judged by the turns she makes (steering_monitor.py): weed on the blade, a wind
or a tow may take as much as her whole rudder gives. Then she answers it, and heads where she did; so in a calm.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.common.angles import radians

HARD_OVER: Final = 0.95  # of the limit
FAR_RAD: Final = radians(15.0)
NEARER_RAD: Final = radians(5.0)
PATIENCE_S: Final = 300.0


class ComingRoundState(msgspec.Struct, frozen=True):
    """Since when, from what error, she has come no nearer with her rudder hard over, and whether that was told."""

    since_s: float
    error_rad: float
    told: bool = False


def update(
    state: ComingRoundState | None, error_rad: float | None, rudder_rad: float, limit_rad: float, now_s: float
) -> ComingRoundState | None:
    """Take a tick in, `error_rad` None while nobody steers for a heading; None while there is nothing to be told."""
    if error_rad is None or rudder_rad * error_rad <= 0.0:
        return None
    error_rad = abs(error_rad)
    if error_rad < FAR_RAD or abs(rudder_rad) < HARD_OVER * limit_rad:
        return None
    if state is None or error_rad < state.error_rad - NEARER_RAD:
        return ComingRoundState(now_s, error_rad)
    if state.told or now_s - state.since_s < PATIENCE_S:
        return state
    return ComingRoundState(state.since_s, state.error_rad, told=True)
