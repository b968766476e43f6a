"""Detect a heading that does not converge: the rudder is at its limit for minutes and the error does not decrease.

With weed on the rudder, in wind or in tow, the boat may respond to its rudder but not reach the goal. The response is
tested by steering_monitor.py.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import radians

LIMIT_SHARE: Final = 0.95  # share of the rudder limit from which on the rudder is at its limit
MIN_ERROR_RAD: Final = radians(15.0)
MIN_DECREASE_RAD: Final = radians(5.0)  # of the error, which restarts the time
DETECTION_TIME_S: Final = 300.0


class ConvergenceState(NamedTuple):
    """Start of the time at the rudder limit (NaN: not at the limit), heading error at the start, and the verdict."""

    since_s: float = math.nan
    error_rad: float = 0.0
    not_converging: bool = False


IDLE: Final = ConvergenceState()


def update(
    state: ConvergenceState, error_rad: float, rudder_rad: float, limit_rad: float, now_s: float
) -> ConvergenceState:
    """Return the state after a tick; `error_rad` is NaN while the boat does not steer to a heading."""
    if not rudder_rad * error_rad > 0.0:
        return IDLE
    error_rad = abs(error_rad)
    if error_rad < MIN_ERROR_RAD or abs(rudder_rad) < LIMIT_SHARE * limit_rad:
        return IDLE
    if math.isnan(state.since_s) or error_rad < state.error_rad - MIN_DECREASE_RAD:
        return ConvergenceState(now_s, error_rad, False)
    if now_s - state.since_s < DETECTION_TIME_S:
        return state
    return ConvergenceState(state.since_s, state.error_rad, True)
