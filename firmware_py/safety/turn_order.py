"""When the rudder commands a turn, and when the response to it is enough for a decision.

Numeric core: functions over floats, which the laboratory compiles as they stand (hil/lab/numeric_core.py); NaN is
absence.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import radians

FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)
MEMORY_S: Final = 120.0  # of the evidence, while nothing can be decided
# What a decision takes: time after the rudder went to one side, then time, the expected turn, and that by the
# uncertainty of the heading.
LATE_S: Final = 16.0
LEAST_S: Final = 20.0
LEAST_LAGS: Final = 3.0
LEAST_TURN_RAD: Final = radians(15.0)
LEAST_SPREADS: Final = 8.0
LEAST_WANDERS: Final = 3.5  # of the standard deviation by which the heading wanders meanwhile without any rudder


def ordered_s(before_s: float, over_rad: float, error_rad: float, step_s: float) -> float:
    """Return for how long the rudder has commanded a turn to one side, negative to port; 0 where it commands none."""
    if not is_order(over_rad, error_rad):
        return 0.0
    return math.copysign(step_s, over_rad) + (before_s if before_s * over_rad > 0.0 else 0.0)


def is_order(over_rad: float, error_rad: float) -> bool:
    """Return whether a rudder so far over commands a turn, not one that stops a turn; an error of NaN: by hand."""
    ordered = math.isnan(error_rad) or (abs(error_rad) >= FAR_OFF_RAD and error_rad * over_rad > 0.0)
    return ordered and abs(over_rad) >= FAR_RUDDER_RAD


def wander_rad(telling_s: float, diffusion_rad2_s: float) -> float:
    """Return the turn that the diffusion of the heading does not explain."""
    return LEAST_WANDERS * math.sqrt(diffusion_rad2_s * telling_s)


def is_enough(telling_s: float, expected_rad: float, heading_sd_rad: float, lag_s: float) -> bool:
    """Return whether the rudder has commanded a turn for long, and one that the heading would have shown."""
    return telling_s >= max(LEAST_S, LEAST_LAGS * lag_s) and expected_rad >= max(
        LEAST_TURN_RAD, LEAST_SPREADS * heading_sd_rad
    )
