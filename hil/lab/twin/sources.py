"""Twins of firmware_py/estimate/sources.py, for one compass, and of common/silence.py.

The compass of the twin never stops measuring: that one stands still while she turns is not looked for.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import clamp, wrap_pi
from hil.lab.twin.kalman import Floats

JUMP_RAD = radians(20.0)
JUMP_S, FIRST_JUMP_S = 1.5, 1.0
PROBATION_S, CONTRADICTED_S = 10.0, 60.0
SLEW_RAD_S = radians(0.5)
SMOOTHING_S = 10.0
MISSED, SLOWEST, FORGOTTEN = 2.5, 2.0, 0.125
COMPASS, COURSE, NOTHING = 0.0, 2.0, 3.0

# What is known of the compass, NaN for None, and the source in use.
# `SAID` is when the compass last spoke; `TOLD` and the rest are of how often what comes, which a new beginning keeps.
SAID, RAW, CHANGED, NEAR, SOUND_SINCE, DIFFERENCE, OFFSET, IN_USE, TOLD, INTERVAL, FIX_TOLD, FIX_INTERVAL = range(12)
SOURCE_STATES = 12


@compiled
def begin_anew(s: Floats) -> None:
    """Forget the compass, but not how often it speaks."""
    s[CHANGED] = s[NEAR] = s[DIFFERENCE] = s[OFFSET] = 0.0
    s[SAID] = s[RAW] = s[SOUND_SINCE] = np.nan
    s[IN_USE] = NOTHING


@compiled
def begin(s: Floats) -> None:
    """Be as before the first sample."""
    s[TOLD] = s[INTERVAL] = s[FIX_TOLD] = s[FIX_INTERVAL] = np.nan
    begin_anew(s)


@compiled
def learn_interval(s: Floats, said: int, interval: int, t_s: float, shortest_s: float) -> None:
    """Note a sample of a source and learn how far apart they come."""
    if not math.isnan(s[said]):
        before_s = shortest_s if math.isnan(s[interval]) else s[interval]
        s[interval] = max(min(t_s - s[said], SLOWEST * shortest_s), (1.0 - FORGOTTEN) * before_s)
    s[said] = t_s


@compiled
def timeout_s(interval_s: float, shortest_s: float) -> float:
    """Return after what silence a source of this interval is lost."""
    known_s = shortest_s if math.isnan(interval_s) else min(interval_s, SLOWEST * shortest_s)
    return max(shortest_s, MISSED * known_s)


@compiled
def decay_offset(s: Floats, step_s: float) -> None:
    """Draw the offset toward zero."""
    if s[OFFSET] != 0.0:
        rest_rad = max(abs(s[OFFSET]) - SLEW_RAD_S * step_s, 0.0)
        s[OFFSET] = math.copysign(rest_rad, s[OFFSET]) if rest_rad != 0.0 else 0.0


@compiled
def add_sample(s: Floats, t_s: float, heading_rad: float, raw_rad: float, expected_rad: float) -> None:
    """Judge a sample; an expected heading of NaN: there is none yet."""
    last_s = s[SAID]
    difference_rad = 0.0 if math.isnan(expected_rad) else wrap_pi(heading_rad - expected_rad)
    near = abs(wrap_pi(difference_rad + s[OFFSET])) <= JUMP_RAD
    first = math.isnan(last_s)
    if near or first:
        s[NEAR] = t_s
    elif s[NEAR] == last_s:
        s[NEAR] = max(s[NEAR], t_s - FIRST_JUMP_S)
    step_s = SMOOTHING_S if first else clamp(t_s - last_s, 0.0, SMOOTHING_S)
    sound_s = 0.0 if math.isnan(s[SOUND_SINCE]) else t_s - s[SOUND_SINCE]
    part = 1.0 if sound_s <= step_s else step_s / min(sound_s, SMOOTHING_S)
    if math.isnan(s[RAW]) or raw_rad != s[RAW]:
        s[CHANGED] = t_s
    s[RAW], s[SAID] = raw_rad, t_s
    s[DIFFERENCE] = wrap_pi(s[DIFFERENCE] + part * wrap_pi(difference_rad - s[DIFFERENCE]))


@compiled
def contradicts(s: Floats, now_s: float, lost_after_s: float) -> bool:
    """Whether nothing is in use and the compass has contradicted the estimate for a minute (needs_restart)."""
    said_s = s[SAID]
    if s[IN_USE] != NOTHING or math.isnan(said_s):
        return False
    varies, far = said_s == s[CHANGED], said_s - s[NEAR] > CONTRADICTED_S
    return bool(now_s - said_s <= lost_after_s and varies and far)


@compiled
def select(s: Floats, now_s: float, lost_after_s: float, frozen_s: float, course_ok: bool) -> None:  # noqa: FBT001 - compiled
    """Choose what is steered by."""
    said_s = s[SAID]
    speaks = not math.isnan(said_s) and now_s - said_s <= lost_after_s
    stood = frozen_s != 0.0 and said_s - s[CHANGED] > frozen_s
    if not speaks and not stood:
        s[RAW] = np.nan  # it may come back with the same number, which has not stood meanwhile
    frozen = speaks and stood
    jumping = not math.isnan(said_s) and said_s - s[NEAR] > JUMP_S
    if not speaks or frozen or jumping:
        s[SOUND_SINCE] = np.nan
    elif math.isnan(s[SOUND_SINCE]):
        s[SOUND_SINCE] = now_s
    before = s[IN_USE]
    after = COURSE if course_ok and before != NOTHING else NOTHING
    if not math.isnan(s[SOUND_SINCE]) and (before in (COMPASS, NOTHING) or now_s - s[SOUND_SINCE] >= PROBATION_S):
        after = COMPASS
    if after == before:
        return
    if after == COMPASS and before != NOTHING:
        s[OFFSET], s[NEAR] = wrap_pi(-s[DIFFERENCE]), now_s
    s[IN_USE] = after
