"""When a rudder orders a turn, and when what came of its orders is enough to tell whether she obeys."""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import radians

FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)
MEMORY_S: Final = 120.0  # for what was seen, while nothing can be told
# What it takes to tell: a rudder that has been over to one side for so long, then time, the turn expected in it, and
# that by the uncertainty of the heading.
LATE_S: Final = 16.0
LEAST_S: Final = 20.0
LEAST_LAGS: Final = 3.0
LEAST_TURN_RAD: Final = radians(15.0)
LEAST_SPREADS: Final = 8.0


def ordered_s(before_s: float, over_rad: float, error_rad: float | None, step_s: float) -> float:
    """Return for how long the rudder has ordered a turn to one side, negative to port; 0 where it orders none."""
    if not is_order(over_rad, error_rad):
        return 0.0
    return math.copysign(step_s, over_rad) + (before_s if before_s * over_rad > 0.0 else 0.0)


def is_order(over_rad: float, error_rad: float | None) -> bool:
    """Whether a rudder so far over is an order to turn; one that stops a turn is none."""
    ordered = error_rad is None or (abs(error_rad) >= FAR_OFF_RAD and error_rad * over_rad > 0.0)
    return ordered and abs(over_rad) >= FAR_RUDDER_RAD


def is_enough(telling_s: float, expected_rad: float, heading_sd_rad: float, lag_s: float) -> bool:
    """Whether the rudder has told for long, and of a turn that could not have been missed."""
    return telling_s >= max(LEAST_S, LEAST_LAGS * lag_s) and expected_rad >= max(
        LEAST_TURN_RAD, LEAST_SPREADS * heading_sd_rad
    )
