"""Twin of firmware_py/safety/oscillation.py: whether the boat swings by herself, and how soft the helm is to be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most, within, wrap_pi
from hil.lab.lanes import any_of, where
from hil.lab.twin import late_answer
from hil.lab.twin.helm import E_BIAS, E_HEADING_SD, E_SPEED, M_SPEED, M_T

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

# What the watch over oscillation remembers; a half swing that has not begun has the side 0.
(SIDE, BEGUN, GOAL, PEAK, BESIDE, PUSH, TURNED, LAST_GOAL, LENGTH, LAST_PEAK, HALVES, OSCILLATING, SOFTNESS, HOLD,
 SWUNG, UPDATED, SOFTENED) = range(17)  # fmt: skip
WATCH_STATES = 17
Lanes = Any  # or a number
Rows = Any  # side by side, or the numbers of one


@compiled
def begin_half(s: Rows, begins: Lanes, now_s: Lanes, side: Lanes, goal_rad: Lanes, turned: Lanes) -> None:
    """Begin a half swing where one begins."""
    s[SIDE], s[BEGUN] = where(begins, side, s[SIDE]), where(begins, now_s, s[BEGUN])
    s[GOAL], s[PEAK] = where(begins, goal_rad, s[GOAL]), where(begins, 0.0, s[PEAK])
    s[BESIDE], s[PUSH] = where(begins, -math.pi, s[BESIDE]), where(begins, -math.pi, s[PUSH])
    s[TURNED] = where(begins, turned, s[TURNED])


@compiled
def begin_watch(s: Rows) -> None:
    """Be as before the first tick."""
    s[SOFTNESS], s[UPDATED], s[SOFTENED] = 1.0, np.nan, -math.inf


@compiled
def relax(s: Rows, now_s: Lanes) -> None:
    """End an oscillation that has not been seen for a while, and make the helm stiffer after it."""
    step_s = where(math.isnan(s[UPDATED]), 0.0, within(now_s - s[UPDATED], 0.0, 1.0))
    s[UPDATED] = now_s
    stirred = (s[SOFTNESS] != 1.0) | (s[OSCILLATING] != 0.0)
    if any_of(stirred):
        quiet_s = now_s - s[SWUNG]
        ends = stirred & (s[OSCILLATING] > 0.0) & fails(quiet_s < QUIET_HALVES * s[LENGTH])
        s[OSCILLATING] = where(ends, 0.0, s[OSCILLATING])
        stiffer = most(s[SOFTNESS] * math.exp(-step_s / RELAX_S), 1.0)
        s[SOFTNESS] = where(stirred & (quiet_s > s[HOLD]), stiffer, s[SOFTNESS])


@compiled
def count_of(s: Rows, e: Rows, length_s: Lanes, wave_period_s: Lanes) -> Lanes:
    """Return how much the half swings under way count."""
    sd_rad, peak_rad = e[E_HEADING_SD], s[PEAK]
    lag_s = e[M_T] / (most(e[E_SPEED], 0.1 * e[M_SPEED]) / e[M_SPEED])
    shortest_s = most(SHORTEST_LAGS * lag_s, SHORTEST_WAVES * wave_period_s)
    counts = (
        (s[TURNED] == 0.0)
        & (peak_rad >= most(LEAST_RAD, LEAST_SPREADS * sd_rad))
        & (s[BESIDE] >= LEAST_RUDDER_RAD)
        & (s[PUSH] > 0.0)
        & (shortest_s <= length_s)
        & (length_s <= most(LONGEST_LAGS * lag_s, LONGEST_S))
    )
    size = least(peak_rad / most(PLAIN_SPREADS * sd_rad, LEAST_RAD), s[BESIDE] / PLAIN_RUDDER_RAD)
    size = least(size, s[PUSH] / PLAIN_PUSH_RAD)
    return where(counts, least(size * size, MOST_COUNT), 0.0)


@compiled
def count_half(s: Rows, late: Rows, over: Lanes, lasts: Lanes, now_s: Lanes, count: Lanes) -> None:
    """Count half swings that are over, or last, so far; soften the helm by a step when that makes an oscillation."""
    length_s, peak_rad = now_s - s[BEGUN], s[PEAK]
    alike = (
        (s[HALVES] > 0.0)
        & (length_s <= ALIKE_LENGTH * s[LENGTH])
        & (lasts | (s[LENGTH] <= ALIKE_LENGTH * length_s))
        & (SHRUNK * s[LAST_PEAK] <= peak_rad)
        & (peak_rad <= GROWN * s[LAST_PEAK])
    )
    counts = (over | (lasts & alike)) & (count != 0.0)
    halves = where(alike, s[HALVES] + count, count)
    swings = counts & (halves + late[late_answer.EVIDENCE] >= ENOUGH)
    softer = swings & (s[SOFTNESS] < SOFTEST) & (s[BEGUN] - s[SOFTENED] > PATIENT_HALVES * s[LENGTH])
    again = now_s - s[SWUNG] < AGAIN_HOLDS * s[HOLD]
    held_s = where(again, least(2.0 * s[HOLD], MOST_HOLD_S), HOLD_S)
    s[HOLD] = where(softer & (s[OSCILLATING] == 0.0), held_s, s[HOLD])
    s[SOFTNESS] = where(softer, least(s[SOFTNESS] * SOFTER, SOFTEST), s[SOFTNESS])
    s[SOFTENED] = where(softer, now_s, s[SOFTENED])
    s[OSCILLATING], s[SWUNG] = where(swings, 1.0, s[OSCILLATING]), where(swings, now_s, s[SWUNG])
    late[late_answer.EVIDENCE] = where(swings, 0.0, late[late_answer.EVIDENCE])
    s[HALVES] = where(over, where(counts, halves, 0.0), s[HALVES])
    ends = over & counts
    s[LENGTH], s[LAST_PEAK] = where(ends, length_s, s[LENGTH]), where(ends, peak_rad, s[LAST_PEAK])


@compiled
def watch(
    s: Rows, late: Rows, now_s: Lanes, error_rad: Lanes, goal_rad: Lanes, command_rad: Lanes, trim_rad: Lanes,
    e: Rows, wave_period_s: Lanes,
) -> None:  # fmt: skip
    """Take a tick in, `e` of which is what the helm knows; an error of NaN is one in which nobody steers."""
    relax(s, now_s)
    steers, side = math.isfinite(error_rad + goal_rad + command_rad), s[SIDE]
    for number in (SIDE, HALVES, OSCILLATING):
        s[number] = where(steers, s[number], 0.0)
    rudder_rad = command_rad - trim_rad
    turns = (side != 0.0) & (s[TURNED] > 0.0) & (abs(error_rad) >= late_answer.FAR_RAD)
    late_answer.update(late, steers, turns, e, goal_rad - error_rad, rudder_rad, now_s)
    jumped = (side != 0.0) & (abs(wrap_pi(goal_rad - s[LAST_GOAL])) > LEAST_RAD)
    s[LAST_GOAL] = where(steers, goal_rad, s[LAST_GOAL])
    begins, swings = steers & (side == 0.0), steers & (side != 0.0)
    begin_half(s, begins, now_s, where(error_rad >= 0.0, 1.0, -1.0), goal_rad, 1.0)
    least_rad = most(LEAST_RAD, LEAST_SPREADS * e[E_HEADING_SD])
    lasts = swings & (error_rad * side > -RETURN_SHARE * least_rad)
    other = lasts & (abs(wrap_pi(goal_rad - s[GOAL])) > 0.5 * LEAST_RAD)
    s[TURNED] = where(other, 1.0, s[TURNED])
    s[PEAK] = where(lasts, most(s[PEAK], error_rad * side), s[PEAK])
    s[BESIDE] = where(lasts, most(s[BESIDE], rudder_rad * side), s[BESIDE])
    s[PUSH] = where(lasts, most(s[PUSH], (e[E_BIAS] - trim_rad) * side), s[PUSH])
    over, counted = swings & fails(lasts), lasts & (s[HALVES] > 0.0) & (s[TURNED] == 0.0)
    if any_of(over | counted):
        count_half(s, late, over, counted, now_s, count_of(s, e, now_s - s[BEGUN], wave_period_s))
    if any_of(over):
        late_answer.turned(late, over, e)
        begin_half(s, over, now_s, -side, goal_rad, where(jumped, 1.0, 0.0))
