"""Twins of firmware_py/estimate/sources.py and stay.py, for one compass, and of common/silence.py.

The compass of the twin never stops measuring: that one stands still while she turns is not looked for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most, within, wrap_pi
from hil.lab.lanes import any_of, where

JUMP_RAD = radians(20.0)
JUMP_S, FIRST_JUMP_S = 1.5, 1.0
PROBATION_S, CONTRADICTED_S = 10.0, 60.0
STAYED_S, STAYED_RAD = 2.0, radians(15.0)
SPIN_RAD_S, SPIN_NOISE_RAD = radians(90.0), radians(3.0)
SLEW_RAD_S = radians(0.5)
SMOOTHING_S = 10.0
MISSED, SLOWEST, FORGOTTEN = 2.5, 2.0, 0.125
Lanes = Any  # or a number
Rows = Any  # side by side, or the numbers of one

COMPASS, COURSE, NOTHING = 0.0, 2.0, 3.0

# What is known of the compass, NaN for None, and the source in use.
# `SAID` is when the compass last spoke; `TOLD` and the rest are of how often what comes, which a new beginning keeps.
SAID, RAW, CHANGED, NEAR, SOUND_SINCE, DIFFERENCE, OFFSET, IN_USE, TOLD, INTERVAL, FIX_TOLD, FIX_INTERVAL = range(12)
STAYS_AROUND, STAYS_SINCE, TURNED = 12, 13, 14
SOURCE_STATES = 15


@compiled
def begin_anew(s: Rows) -> None:
    """Forget the compass, but not how often it speaks."""
    s[CHANGED] = s[NEAR] = s[DIFFERENCE] = s[OFFSET] = 0.0
    s[SAID] = s[RAW] = s[SOUND_SINCE] = s[STAYS_SINCE] = np.nan
    s[STAYS_AROUND] = s[TURNED] = 0.0
    s[IN_USE] = NOTHING


@compiled
def begin(s: Rows) -> None:
    """Be as before the first sample."""
    s[TOLD] = s[INTERVAL] = s[FIX_TOLD] = s[FIX_INTERVAL] = np.nan
    begin_anew(s)


@compiled
def learn_interval(s: Rows, said: int, interval: int, t_s: Lanes, shortest_s: Lanes) -> None:
    """Note a sample of a source and learn how far apart they come."""
    before_s = where(math.isnan(s[interval]), shortest_s, s[interval])
    step_s = t_s - s[said]
    learned_s = most(least(step_s, SLOWEST * shortest_s), (1.0 - FORGOTTEN) * before_s)
    after_s = where(step_s <= 0.0, before_s, learned_s)
    s[interval] = where(math.isnan(s[said]), s[interval], after_s)
    s[said] = t_s


@compiled
def timeout_s(interval_s: Lanes, shortest_s: Lanes) -> Lanes:
    """Return after what silence a source of this interval is lost."""
    known_s = where(math.isnan(interval_s), shortest_s, least(interval_s, SLOWEST * shortest_s))
    return most(shortest_s, MISSED * known_s)


@compiled
def decay_offset(s: Rows, step_s: Lanes) -> None:
    """Draw the offset toward zero."""
    off = s[OFFSET] != 0.0
    if any_of(off):
        rest_rad = most(abs(s[OFFSET]) - SLEW_RAD_S * step_s, 0.0)
        after_rad = where(rest_rad != 0.0, math.copysign(rest_rad, s[OFFSET]), 0.0)
        s[OFFSET] = where(off, after_rad, s[OFFSET])


@compiled
def stays(s: Rows, t_s: Lanes, heading_rad: Lanes) -> None:
    """Note around what a compass stays beyond the gate; RAW is still what it showed before."""
    left, stayed = s[NEAR] == s[SAID], fails(math.isnan(s[STAYS_SINCE]))
    reach_rad = least(SPIN_RAD_S * (t_s - s[SAID]) + SPIN_NOISE_RAD, JUMP_RAD)
    follows = abs(wrap_pi(heading_rad - s[RAW])) <= reach_rad
    on = stayed & fails(left) & follows & (abs(wrap_pi(heading_rad - s[STAYS_AROUND])) <= STAYED_RAD)
    turned = follows & (left | (stayed & (s[TURNED] > 0.0)))
    s[TURNED] = where(on, s[TURNED], where(turned, 1.0, 0.0))
    s[STAYS_AROUND] = where(on, s[STAYS_AROUND], heading_rad)
    s[STAYS_SINCE] = where(on, s[STAYS_SINCE], t_s)


@compiled
def add_sample(s: Rows, t_s: Lanes, heading_rad: Lanes, raw_rad: Lanes, expected_rad: Lanes) -> None:
    """Judge a sample; an expected heading of NaN: there is none yet."""
    last_s = s[SAID]
    difference_rad = where(math.isnan(expected_rad), 0.0, wrap_pi(heading_rad - expected_rad))
    first = math.isnan(last_s)
    agrees = abs(wrap_pi(difference_rad + s[OFFSET])) <= JUMP_RAD
    if any_of(fails(agrees)):
        stays(s, t_s, heading_rad)
    s[STAYS_SINCE] = where(agrees, np.nan, s[STAYS_SINCE])
    near = agrees | first
    far_s = where(s[NEAR] == last_s, most(s[NEAR], t_s - FIRST_JUMP_S), s[NEAR])
    s[NEAR] = where(near, t_s, far_s)
    step_s = where(first, SMOOTHING_S, within(t_s - last_s, 0.0, SMOOTHING_S))
    sound_s = where(math.isnan(s[SOUND_SINCE]), 0.0, t_s - s[SOUND_SINCE])
    part = where(sound_s <= step_s, 1.0, step_s / least(sound_s, SMOOTHING_S))
    s[CHANGED] = where(raw_rad != s[RAW], t_s, s[CHANGED])
    s[RAW], s[SAID] = raw_rad, t_s
    s[DIFFERENCE] = wrap_pi(s[DIFFERENCE] + part * wrap_pi(difference_rad - s[DIFFERENCE]))


@compiled
def contradicts(s: Rows, now_s: Lanes, lost_after_s: Lanes) -> Lanes:
    """Whether the compass contradicts the estimate and is worth more than it (needs_restart)."""
    said_s = s[SAID]
    varies, far = said_s == s[CHANGED], said_s - s[NEAR] > CONTRADICTED_S
    alone, stayed_s = s[IN_USE] == NOTHING, said_s - s[STAYS_SINCE]
    stayed = (stayed_s > STAYED_S) & ((s[TURNED] > 0.0) | (alone & (stayed_s > PROBATION_S)))
    believed = stayed | (alone & far)
    return (s[IN_USE] != COMPASS) & (now_s - said_s <= lost_after_s) & varies & believed


@compiled
def select(s: Rows, now_s: Lanes, lost_after_s: Lanes, frozen_s: Lanes, course_ok: Lanes) -> None:
    """Choose what is steered by."""
    said_s, before = s[SAID], s[IN_USE]
    speaks = now_s - said_s <= lost_after_s
    stood = (frozen_s != 0.0) & (said_s - s[CHANGED] > frozen_s)
    s[RAW] = where(
        speaks | stood, s[RAW], np.nan
    )  # it may come back with the same number, which has not stood meanwhile
    unsound = fails(speaks) | stood | (said_s - s[NEAR] > JUMP_S)
    sound_s = where(unsound, np.nan, where(math.isnan(s[SOUND_SINCE]), now_s, s[SOUND_SINCE]))
    s[SOUND_SINCE] = sound_s
    waits = (before == COMPASS) | (before == NOTHING) | (now_s - sound_s >= PROBATION_S)
    course = where(before != NOTHING, course_ok, False)
    after = where(fails(math.isnan(sound_s)) & waits, COMPASS, where(course, COURSE, NOTHING))
    anew = (after != before) & (after == COMPASS) & (before != NOTHING)
    s[OFFSET] = where(anew, wrap_pi(-s[DIFFERENCE]), s[OFFSET])
    s[NEAR] = where(anew, now_s, s[NEAR])
    s[IN_USE] = after
