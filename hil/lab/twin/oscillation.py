"""Twin of firmware_py/safety/oscillation.py: whether the boat swings by herself, and how soft the helm is to be."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import clamp, wrap_pi
from hil.lab.twin.helm import E_BIAS, E_HEADING_SD, E_SPEED, M_SPEED, M_T
from hil.lab.twin.kalman import Floats

LEAST_RAD = radians(1.5)
LEAST_SPREADS = 2.0
LEAST_RUDDER_RAD = radians(2.0)
RETURN_SHARE = 0.2
SHORTEST_LAGS, LONGEST_LAGS, LONGEST_S = 1.5, 16.0, 64.0
SHORTEST_WAVES = 0.75
ALIKE_LENGTH = 1.5
GROWN, SHRUNK = 2.0, 0.7
PLAIN_SPREADS = 2.5
PLAIN_RUDDER_RAD = radians(10.0)
MOST_COUNT, ENOUGH = 4.0, 5.0
SOFTER, SOFTEST = 4.0, 8.0
QUIET_HALVES = 2.0
HOLD_S, RELAX_S = 600.0, 1200.0

# What the watch over oscillation remembers; a half swing that has not begun has the side 0.
(SIDE, BEGUN, GOAL, PEAK, BESIDE, TURNED, LAST_GOAL, LENGTH, LAST_PEAK, HALVES, OSCILLATING, SOFTNESS, SWUNG,
 UPDATED) = range(14)  # fmt: skip
WATCH_STATES = 14


@compiled
def begin_half(s: Floats, now_s: float, side: float, goal_rad: float, turned: float) -> None:
    """Begin a half swing."""
    s[SIDE], s[BEGUN], s[GOAL], s[PEAK], s[BESIDE], s[TURNED] = side, now_s, goal_rad, 0.0, -math.pi, turned


@compiled
def begin_watch(s: Floats) -> None:
    """Be as before the first tick."""
    s[SOFTNESS], s[UPDATED] = 1.0, np.nan


@compiled
def relax(s: Floats, now_s: float) -> None:
    """End an oscillation that has not been seen for a while, and make the helm stiffer after it."""
    step_s = 0.0 if math.isnan(s[UPDATED]) else clamp(now_s - s[UPDATED], 0.0, 1.0)
    s[UPDATED] = now_s
    if not (s[SOFTNESS] == 1.0 and s[OSCILLATING] == 0.0):
        quiet_s = now_s - s[SWUNG]
        if s[OSCILLATING] > 0.0 and not quiet_s < QUIET_HALVES * s[LENGTH]:
            s[OSCILLATING] = 0.0
        if quiet_s > HOLD_S:
            s[SOFTNESS] = max(s[SOFTNESS] * math.exp(-step_s / RELAX_S), 1.0)


@compiled
def count_of(s: Floats, heading_sd_rad: float) -> float:
    """Return how much the half swing under way counts."""
    size = min(s[PEAK] / max(PLAIN_SPREADS * heading_sd_rad, LEAST_RAD), s[BESIDE] / PLAIN_RUDDER_RAD)
    return float(min(size * size, MOST_COUNT))


@compiled
def count_half(s: Floats, peak_rad: float, length_s: float, count: float, now_s: float) -> None:
    """Count a half swing that is over, and soften the helm when that makes an oscillation."""
    if count == 0.0:
        s[HALVES] = 0.0
        return
    alike = (
        s[HALVES] > 0.0
        and max(length_s, s[LENGTH]) <= ALIKE_LENGTH * min(length_s, s[LENGTH])
        and SHRUNK * s[LAST_PEAK] <= peak_rad <= GROWN * s[LAST_PEAK]
    )
    s[HALVES] = (s[HALVES] if alike else 0.0) + count
    s[LENGTH], s[LAST_PEAK] = length_s, peak_rad
    if s[HALVES] >= ENOUGH:
        s[OSCILLATING], s[SWUNG], s[SOFTNESS] = 1.0, now_s, min(s[SOFTNESS] * SOFTER, SOFTEST)


@compiled
def watch(
    s: Floats, now_s: float, error_rad: float, goal_rad: float, rudder_rad: float, e: Floats, wave_period_s: float
) -> None:
    """Take a tick in, `e` of which is what the helm knows; an error of NaN is one in which nobody steers."""
    relax(s, now_s)
    if not math.isfinite(error_rad + goal_rad + rudder_rad):
        s[SIDE], s[HALVES], s[OSCILLATING] = 0.0, 0.0, 0.0
        return
    least_rad = max(LEAST_RAD, LEAST_SPREADS * e[E_HEADING_SD])
    side = s[SIDE]
    jumped = side != 0.0 and abs(wrap_pi(goal_rad - s[LAST_GOAL])) > LEAST_RAD
    s[LAST_GOAL] = goal_rad
    if side == 0.0:
        begin_half(s, now_s, 1.0 if error_rad >= 0.0 else -1.0, goal_rad, 1.0)
        return
    if error_rad * side > -RETURN_SHARE * least_rad:
        if abs(wrap_pi(goal_rad - s[GOAL])) > 0.5 * LEAST_RAD:
            s[TURNED] = 1.0
        s[PEAK], s[BESIDE] = max(s[PEAK], error_rad * side), max(s[BESIDE], (rudder_rad - e[E_BIAS]) * side)
        return
    lag_s = e[M_T] / (max(e[E_SPEED], 0.1 * e[M_SPEED]) / e[M_SPEED])
    shortest_s = max(SHORTEST_LAGS * lag_s, SHORTEST_WAVES * wave_period_s)
    length_s, peak_rad = now_s - s[BEGUN], s[PEAK]
    counts = (
        s[TURNED] == 0.0
        and peak_rad >= least_rad
        and s[BESIDE] >= LEAST_RUDDER_RAD
        and shortest_s <= length_s <= max(LONGEST_LAGS * lag_s, LONGEST_S)
    )
    count_half(s, peak_rad, length_s, count_of(s, e[E_HEADING_SD]) if counts else 0.0, now_s)
    begin_half(s, now_s, -side, goal_rad, 1.0 if jumped else 0.0)
