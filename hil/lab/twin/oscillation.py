"""Detection of a limit cycle and gain reduction (firmware_py/safety/oscillation.py) for compiled code."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from hil.lab.compiled import compiled
from hil.lab.twin import late_answer
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
PLAIN_PUSH_RAD = radians(3.0)
MOST_COUNT, ENOUGH = 4.0, 7.0
SOFTER, SOFTEST = 8.0, 16.0
QUIET_HALVES, PATIENT_HALVES = ALIKE_LENGTH, 2.0
HOLD_S, MOST_HOLD_S, AGAIN_HOLDS = 600.0, 86_400.0, 8.0
RELAX_S = 1200.0

# The state; a half swing that has not begun has the side 0.
(SIDE, BEGUN, GOAL, PEAK, BESIDE, PUSH, TURNED, LAST_GOAL, LENGTH, LAST_PEAK, HALVES, OSCILLATING, SOFTNESS, HOLD,
 SWUNG, UPDATED, SOFTENED) = range(17)  # fmt: skip
WATCH_STATES = 17


@compiled
def begin_half(s: Floats, now_s: float, side: float, goal_rad: float, turned: float) -> None:
    """Begin a half swing."""
    s[SIDE], s[BEGUN], s[GOAL], s[PEAK] = side, now_s, goal_rad, 0.0
    s[BESIDE], s[PUSH], s[TURNED] = -math.pi, -math.pi, turned


@compiled
def begin_watch(s: Floats) -> None:
    """Set the state before the first tick."""
    s[SOFTNESS], s[UPDATED], s[SOFTENED] = 1.0, np.nan, -math.inf


@compiled
def relax(s: Floats, now_s: float) -> None:
    """End an oscillation that has not been seen for a while, and raise the gain after it."""
    step_s = 0.0 if math.isnan(s[UPDATED]) else clamp(now_s - s[UPDATED], 0.0, 1.0)
    s[UPDATED] = now_s
    if s[SOFTNESS] == 1.0 and s[OSCILLATING] == 0.0:
        return
    quiet_s = now_s - s[SWUNG]
    if s[OSCILLATING] > 0.0 and not quiet_s < QUIET_HALVES * s[LENGTH]:
        s[OSCILLATING] = 0.0
    if quiet_s > s[HOLD]:
        s[SOFTNESS] = max(s[SOFTNESS] * math.exp(-step_s / RELAX_S), 1.0)


@compiled
def count_of(s: Floats, e: Floats, length_s: float, wave_period_s: float) -> float:
    """Return how much the half swing under way counts."""
    sd_rad, peak_rad = e[E_HEADING_SD], s[PEAK]
    lag_s = e[M_T] / (max(e[E_SPEED], 0.1 * e[M_SPEED]) / e[M_SPEED])
    shortest_s = max(SHORTEST_LAGS * lag_s, SHORTEST_WAVES * wave_period_s)
    counts = (
        s[TURNED] == 0.0
        and peak_rad >= max(LEAST_RAD, LEAST_SPREADS * sd_rad)
        and s[BESIDE] >= LEAST_RUDDER_RAD
        and s[PUSH] > 0.0
        and shortest_s <= length_s <= max(LONGEST_LAGS * lag_s, LONGEST_S)
    )
    if not counts:
        return 0.0
    size = min(peak_rad / max(PLAIN_SPREADS * sd_rad, LEAST_RAD), s[BESIDE] / PLAIN_RUDDER_RAD)
    size = min(size, s[PUSH] / PLAIN_PUSH_RAD)
    return float(min(size * size, MOST_COUNT))


@compiled
def count_half(s: Floats, late: Floats, over: bool, now_s: float, count: float) -> None:
    """Count a half swing that is over, or lasts, so far; reduce the gain by a step when that makes an oscillation."""
    length_s, peak_rad = now_s - s[BEGUN], s[PEAK]
    alike = (
        s[HALVES] > 0.0
        and length_s <= ALIKE_LENGTH * s[LENGTH]
        and (not over or s[LENGTH] <= ALIKE_LENGTH * length_s)
        and SHRUNK * s[LAST_PEAK] <= peak_rad <= GROWN * s[LAST_PEAK]
    )
    counts = (over or alike) and count != 0.0
    halves = s[HALVES] + count if alike else count
    if counts and halves + late[late_answer.EVIDENCE] >= ENOUGH:
        oscillate(s, now_s)
        late[late_answer.EVIDENCE] = 0.0
    if over:
        s[HALVES] = halves if counts else 0.0
        if counts:
            s[LENGTH], s[LAST_PEAK] = length_s, peak_rad


@compiled
def oscillate(s: Floats, now_s: float) -> None:
    """Note an oscillation; reduce the gain by a step, once in a while."""
    if s[SOFTNESS] < SOFTEST and s[BEGUN] - s[SOFTENED] > PATIENT_HALVES * s[LENGTH]:
        if s[OSCILLATING] == 0.0:
            again = now_s - s[SWUNG] < AGAIN_HOLDS * s[HOLD]
            s[HOLD] = min(2.0 * s[HOLD], MOST_HOLD_S) if again else HOLD_S
        s[SOFTNESS], s[SOFTENED] = min(s[SOFTNESS] * SOFTER, SOFTEST), now_s
    s[OSCILLATING], s[SWUNG] = 1.0, now_s


@compiled
def watch(
    s: Floats, late: Floats, now_s: float, error_rad: float, goal_rad: float, command_rad: float, trim_rad: float,
    e: Floats, wave_period_s: float,
) -> None:  # fmt: skip
    """Update by a tick; `e` is what the controller knows, an error of NaN stands for no heading to steer for."""
    relax(s, now_s)
    if not math.isfinite(error_rad + goal_rad + command_rad):
        s[SIDE] = s[HALVES] = s[OSCILLATING] = 0.0
        late_answer.restart(late)
        return
    side, rudder_rad = s[SIDE], command_rad - trim_rad
    turns = side != 0.0 and s[TURNED] > 0.0 and abs(error_rad) >= late_answer.FAR_RAD
    late_answer.update(late, turns, e, goal_rad - error_rad, rudder_rad, now_s)
    jumped = side != 0.0 and abs(wrap_pi(goal_rad - s[LAST_GOAL])) > LEAST_RAD
    s[LAST_GOAL] = goal_rad
    if side == 0.0:
        begin_half(s, now_s, 1.0 if error_rad >= 0.0 else -1.0, goal_rad, 1.0)
        return
    if not error_rad * side > -RETURN_SHARE * max(LEAST_RAD, LEAST_SPREADS * e[E_HEADING_SD]):
        count_half(s, late, True, now_s, count_of(s, e, now_s - s[BEGUN], wave_period_s))
        late_answer.turned(late, e)
        begin_half(s, now_s, -side, goal_rad, 1.0 if jumped else 0.0)
        return
    if abs(wrap_pi(goal_rad - s[GOAL])) > 0.5 * LEAST_RAD:
        s[TURNED] = 1.0
    s[PEAK] = max(s[PEAK], error_rad * side)
    s[BESIDE] = max(s[BESIDE], rudder_rad * side)
    s[PUSH] = max(s[PUSH], (e[E_BIAS] - trim_rad) * side)
    if s[HALVES] > 0.0 and s[TURNED] == 0.0:
        count_half(s, late, False, now_s, count_of(s, e, now_s - s[BEGUN], wave_period_s))
