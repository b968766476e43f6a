"""Choice of the heading source (firmware_py/estimate/sources.py, stay.py, common/silence.py) for compiled code.

There is one compass, and it never stops measuring: that one stands still while the boat turns is not looked for.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from hil.lab.compiled import compiled
from hil.lab.twin.kalman import Floats

JUMP_RAD = radians(20.0)
JUMP_S, FIRST_JUMP_S = 1.5, 1.0
PROBATION_S, CONTRADICTED_S = 10.0, 60.0
STAYED_S, STAYED_RAD = 2.0, radians(15.0)
SPIN_RAD_S, SPIN_NOISE_RAD = radians(90.0), radians(3.0)
SLEW_RAD_S = radians(0.5)
SMOOTHING_S = 10.0
MISSED, SLOWEST, FORGOTTEN = 2.5, 2.0, 0.125

COMPASS, COURSE, NOTHING = 0.0, 2.0, 3.0

# What is known of the compass, NaN for None, and the source in use.
# `SAID` is when the compass last spoke; `TOLD` and the rest are of how often what comes, which a new beginning keeps.
SAID, RAW, CHANGED, NEAR, SOUND_SINCE, DIFFERENCE, OFFSET, IN_USE, TOLD, INTERVAL, FIX_TOLD, FIX_INTERVAL = range(12)
STAYS_AROUND, STAYS_SINCE, TURNED = 12, 13, 14
SOURCE_STATES = 15


@compiled
def restart(s: Floats) -> None:
    """Forget the compass, but not how often it speaks."""
    s[CHANGED] = s[NEAR] = s[DIFFERENCE] = s[OFFSET] = 0.0
    s[SAID] = s[RAW] = s[SOUND_SINCE] = s[STAYS_SINCE] = np.nan
    s[STAYS_AROUND] = s[TURNED] = 0.0
    s[IN_USE] = NOTHING


@compiled
def begin(s: Floats) -> None:
    """Set the state before the first sample."""
    s[TOLD] = s[INTERVAL] = s[FIX_TOLD] = s[FIX_INTERVAL] = np.nan
    restart(s)


@compiled
def learn_interval(s: Floats, said: int, interval: int, t_s: float, shortest_s: float) -> None:
    """Note a sample of a source and learn how far apart they come."""
    if not math.isnan(s[said]):
        before_s = shortest_s if math.isnan(s[interval]) else s[interval]
        step_s = t_s - s[said]
        s[interval] = before_s
        if not step_s <= 0.0:
            s[interval] = max(min(step_s, SLOWEST * shortest_s), (1.0 - FORGOTTEN) * before_s)
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
def stays(s: Floats, t_s: float, heading_rad: float) -> None:
    """Note around what a compass stays beyond the gate; RAW is still what it showed before."""
    left, stayed = s[NEAR] == s[SAID], not math.isnan(s[STAYS_SINCE])
    reach_rad = min(SPIN_RAD_S * (t_s - s[SAID]) + SPIN_NOISE_RAD, JUMP_RAD)
    follows = abs(wrap_pi(heading_rad - s[RAW])) <= reach_rad
    if stayed and not left and follows and abs(wrap_pi(heading_rad - s[STAYS_AROUND])) <= STAYED_RAD:
        return
    s[TURNED] = 1.0 if follows and (left or (stayed and s[TURNED] > 0.0)) else 0.0
    s[STAYS_AROUND], s[STAYS_SINCE] = heading_rad, t_s


@compiled
def add_sample(s: Floats, t_s: float, heading_rad: float, raw_rad: float, expected_rad: float) -> None:
    """Judge a sample; an expected heading of NaN: there is none yet."""
    last_s, first = s[SAID], math.isnan(s[SAID])
    difference_rad = 0.0 if math.isnan(expected_rad) else wrap_pi(heading_rad - expected_rad)
    agrees = abs(wrap_pi(difference_rad + s[OFFSET])) <= JUMP_RAD
    if agrees:
        s[STAYS_SINCE] = np.nan
    else:
        stays(s, t_s, heading_rad)
    if agrees or first:
        s[NEAR] = t_s
    elif s[NEAR] == last_s:
        s[NEAR] = max(s[NEAR], t_s - FIRST_JUMP_S)
    step_s = SMOOTHING_S if first else clamp(t_s - last_s, 0.0, SMOOTHING_S)
    sound_s = 0.0 if math.isnan(s[SOUND_SINCE]) else t_s - s[SOUND_SINCE]
    part = 1.0 if sound_s <= step_s else step_s / min(sound_s, SMOOTHING_S)
    if raw_rad != s[RAW]:
        s[CHANGED] = t_s
    s[RAW], s[SAID] = raw_rad, t_s
    s[DIFFERENCE] = wrap_pi(s[DIFFERENCE] + part * wrap_pi(difference_rad - s[DIFFERENCE]))


@compiled
def contradicts(s: Floats, now_s: float, lost_after_s: float) -> bool:
    """Whether the compass contradicts the estimate and is worth more than it (needs_restart)."""
    said_s, alone = s[SAID], s[IN_USE] == NOTHING
    if s[IN_USE] == COMPASS or not now_s - said_s <= lost_after_s or said_s != s[CHANGED]:
        return False
    stayed_s = said_s - s[STAYS_SINCE]
    stayed = stayed_s > STAYED_S and (s[TURNED] > 0.0 or (alone and stayed_s > PROBATION_S))
    return bool(stayed or (alone and said_s - s[NEAR] > CONTRADICTED_S))


@compiled
def select(s: Floats, now_s: float, lost_after_s: float, frozen_s: float, course_ok: bool) -> None:
    """Choose what is steered by."""
    said_s, before = s[SAID], s[IN_USE]
    speaks = now_s - said_s <= lost_after_s
    stood = frozen_s != 0.0 and said_s - s[CHANGED] > frozen_s
    if not (speaks or stood):
        s[RAW] = np.nan  # it may come back with the same number, which has not stood meanwhile
    if not speaks or stood or said_s - s[NEAR] > JUMP_S:
        s[SOUND_SINCE] = np.nan
    elif math.isnan(s[SOUND_SINCE]):
        s[SOUND_SINCE] = now_s
    sound_s = s[SOUND_SINCE]
    waited = before != COURSE or now_s - sound_s >= PROBATION_S
    if not math.isnan(sound_s) and waited:
        s[IN_USE] = COMPASS
    else:
        s[IN_USE] = COURSE if before != NOTHING and course_ok else NOTHING
    if s[IN_USE] == COMPASS and before == COURSE:
        s[OFFSET], s[NEAR] = wrap_pi(-s[DIFFERENCE]), now_s
