"""Twin of firmware_py/safety/late_answer.py: how late she answers the rudder, told by her turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.model.kt import decay_over
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, most, within, wrap_pi
from hil.lab.lanes import any_of, where
from hil.lab.twin.helm import E_HEADING_SD, E_SPEED, M_K, M_SPEED, M_T

SAMPLE_S, LATE_S, SPEED_MEMORY_S = 1.0, 12.0, 300.0
FAR_RAD = radians(8.0)
LEAST_GAIN, MOST_GAIN = 0.25, 4.0
OTHERS_RAD = radians(6.0)
UNSURE_S, ALIKE_S = 4.0, 4.0
LEAST, MOST = -4.0, 4.0

# What is remembered; there is no sample where its time is NaN.
(T, HEADING, RUDDER, SPEED, FIRST, SECOND, THIRD, AS_TOLD, LATE,
 SHOWN_AS_TOLD, FELT_AS_TOLD, SHOWN_LATE, FELT_LATE, EVIDENCE) = range(14)  # fmt: skip
LATE_STATES = 14
Lanes = Any  # or a number
Rows = Any  # side by side, or the numbers of one


@compiled
def begin_watch(s: Rows) -> None:
    """Be as before the first tick."""
    s[T] = np.nan


@compiled
def update(s: Rows, steers: Lanes, turns: Lanes, e: Rows, heading_rad: Lanes, rudder_rad: Lanes, now_s: Lanes) -> None:
    """Take samples in, once a second; begin anew, with the evidence there is, where nobody steers."""
    if any_of(fails(steers)):
        for number in range(EVIDENCE):
            s[number] = where(steers, s[number], 0.0)
        s[T] = where(steers, s[T], np.nan)
    first, sampled = steers & math.isnan(s[T]), steers & (now_s - s[T] >= SAMPLE_S)
    if any_of(sampled):
        feel(s, sampled, sampled & turns, e, heading_rad, now_s - s[T])
    s[SPEED] = where(first, e[E_SPEED], s[SPEED])
    comes = first | sampled
    s[T], s[HEADING] = where(comes, now_s, s[T]), where(comes, heading_rad, s[HEADING])
    s[RUDDER] = where(comes, rudder_rad, s[RUDDER])


@compiled
def feel(s: Rows, sampled: Lanes, turns: Lanes, e: Rows, heading_rad: Lanes, step_s: Lanes) -> None:
    """Carry what the two boats feel of the rudder on to a sample, and sum up what was turned."""
    slow_m_s = s[SPEED] + (1.0 - math.exp(-step_s / SPEED_MEMORY_S)) * (e[E_SPEED] - s[SPEED])
    s[SPEED] = where(sampled, slow_m_s, s[SPEED])
    ratio = most(s[SPEED] / e[M_SPEED], 0.1)
    gone = 1.0 - decay_over(step_s, e[M_T] / ratio)
    part = 1.0 - math.exp(-step_s / (LATE_S / 3.0))
    first_rad, second_rad, third_rad = s[FIRST], s[SECOND], s[THIRD]
    s[FIRST] = where(sampled, first_rad + part * (s[RUDDER] - first_rad), first_rad)
    s[SECOND] = where(sampled, second_rad + part * (first_rad - second_rad), second_rad)
    s[THIRD] = where(sampled, third_rad + part * (second_rad - third_rad), third_rad)
    as_told_rad = s[AS_TOLD] + gone * (s[RUDDER] - s[AS_TOLD])
    late_rad = s[LATE] + gone * (third_rad - s[LATE])
    s[AS_TOLD], s[LATE] = where(sampled, as_told_rad, s[AS_TOLD]), where(sampled, late_rad, s[LATE])
    shown_rad = wrap_pi(heading_rad - s[HEADING]) / (e[M_K] * ratio * step_s)
    s[SHOWN_AS_TOLD] = where(turns, s[SHOWN_AS_TOLD] + shown_rad * as_told_rad, s[SHOWN_AS_TOLD])
    s[FELT_AS_TOLD] = where(turns, s[FELT_AS_TOLD] + as_told_rad * as_told_rad, s[FELT_AS_TOLD])
    s[SHOWN_LATE] = where(turns, s[SHOWN_LATE] + shown_rad * late_rad, s[SHOWN_LATE])
    s[FELT_LATE] = where(turns, s[FELT_LATE] + late_rad * late_rad, s[FELT_LATE])


@compiled
def explained(shown: Lanes, felt: Lanes) -> Lanes:
    """Return how much less the squares sum up to once what she turned is explained by what the boat feels."""
    gain = within(shown / most(felt, 1e-9), LEAST_GAIN, MOST_GAIN)
    return gain * (2.0 * shown - gain * felt)


@compiled
def turned(s: Rows, over: Lanes, e: Rows) -> None:
    """End a stretch on one side of the goal: add the evidence of what was seen of a turn in it, and forget that."""
    told = over & (s[FELT_AS_TOLD] != 0.0)
    ratio = most(s[SPEED] / e[M_SPEED], 0.1)
    unsure_rad = 0.5 * e[E_HEADING_SD] / (UNSURE_S * e[M_K] * ratio)
    weight = SAMPLE_S / (2.0 * ALIKE_S * (OTHERS_RAD * OTHERS_RAD + unsure_rad * unsure_rad))
    late = explained(s[SHOWN_LATE], s[FELT_LATE]) - explained(s[SHOWN_AS_TOLD], s[FELT_AS_TOLD])
    s[EVIDENCE] = where(told, within(s[EVIDENCE] + weight * late, LEAST, MOST), s[EVIDENCE])
    for number in (SHOWN_AS_TOLD, FELT_AS_TOLD, SHOWN_LATE, FELT_LATE):
        s[number] = where(told, 0.0, s[number])
