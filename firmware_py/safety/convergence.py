"""Detect a heading that does not converge: the rudder at its limit for minutes while the error does not decrease.

Whether the boat responds to the rudder is tested by steering_monitor.py. With weed on the blade, in wind or in a tow,
all of the rudder may be needed to keep the heading: the boat responds, and does not converge.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import radians

LIMIT_SHARE: Final = 0.95  # of the rudder limit
MIN_ERROR_RAD: Final = radians(15.0)
DECREASE_RAD: Final = radians(5.0)
DETECTION_TIME_S: Final = 300.0


class ConvergenceState(NamedTuple):
    """Begin of the time at the rudder limit (NaN: none), heading error then, and the verdict."""

    since_s: float = math.nan
    error_rad: float = 0.0
    not_converging: bool = False


IDLE: Final = ConvergenceState()


def update(
    state: ConvergenceState, error_rad: float, rudder_rad: float, limit_rad: float, now_s: float
) -> ConvergenceState:
    """Return the state after a tick; an error of NaN: the boat does not steer for a heading."""
    if not rudder_rad * error_rad > 0.0:
        return IDLE
    error_rad = abs(error_rad)
    if error_rad < MIN_ERROR_RAD or abs(rudder_rad) < LIMIT_SHARE * limit_rad:
        return IDLE
    if math.isnan(state.since_s) or error_rad < state.error_rad - DECREASE_RAD:
        return ConvergenceState(now_s, error_rad, False)
    if now_s - state.since_s < DETECTION_TIME_S:
        return state
    return ConvergenceState(state.since_s, state.error_rad, True)
