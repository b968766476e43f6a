"""What the autopilot takes in at a tick: sentences that are there, the heading source, the estimate's samples."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians
from hil.lab.compiled import compiled
from hil.lab.numeric_core import silence, sources
from hil.lab.twin import kalman, over_ground, wave_filter
from hil.lab.twin.autopilot import Autopilot, Intake
from hil.lab.twin.devices import LOST, SAID_RAD, THERE_S
from hil.lab.twin.kalman import Floats
from hil.lab.twin.plant import Plant
from hil.lab.twin.wave_filter_state import FIX_T, STARTED, restart

EPOCH_ENDS_AFTER_S = 0.5
WIDEST_COURSE_RAD = radians(20.0)


@compiled
def judge_sources(a: Autopilot, at: Plant, before: Intake, now_s: float) -> tuple[Intake, int]:
    """Take the headings that are there and choose the source; return the state and how many there are."""
    me, f, boat, state = a.state, a.filter, a.boat, before.sources
    heading_s, interval_s = before.heading_s, before.heading_interval_s
    lost_after_s = silence.timeout_s(interval_s, boat.compass_timeout_s)
    fix_lost_after_s = silence.timeout_s(before.fix_interval_s, boat.position_timeout_s)
    if sources.needs_restart(state, now_s, (lost_after_s, lost_after_s)):
        restart(f)
        state = sources.START
    state = sources.decay_offsets(state, clamp(now_s - me.steered_s, 0.0, 1.0))
    begun = f.w[STARTED] > 0.0
    expected_rad = f.x[kalman.FLOAT] + f.x[kalman.WAVE] if begun else np.nan
    me.newest_s, there = np.nan, 0
    while there < at.heading_count and at.headings[there, THERE_S] <= now_s:
        t_s, said_rad = at.headings[there, THERE_S], at.headings[there, SAID_RAD]
        state = sources.add_sample(state, sources.TrueHeadingSample(t_s, said_rad, said_rad, 0), expected_rad)
        interval_s = silence.learn_interval_s(interval_s, t_s - heading_s, boat.compass_timeout_s)
        me.newest_s = heading_s = t_s
        there += 1
    course_ok = (
        begun
        and now_s - f.w[FIX_T] <= fix_lost_after_s
        and math.sqrt(a.covariance.p[kalman.HEADING, kalman.HEADING]) <= WIDEST_COURSE_RAD
        and f.x[kalman.SPEED] >= boat.course_speed_m_s
    )
    state = sources.select(state, now_s, boat.frozen_s, (lost_after_s, lost_after_s), course_ok)
    return Intake(state, heading_s, interval_s, before.fix_s, before.fix_interval_s), there


@compiled
def learn_fixes(a: Autopilot, at: Plant, before: Intake, fixes: int) -> Intake:
    """Return the state with the interval of the fixes after so many of them."""
    fix_s, interval_s = before.fix_s, before.fix_interval_s
    for fix in range(fixes):
        t_s = at.fixes[fix, THERE_S]
        interval_s = silence.learn_interval_s(interval_s, t_s - fix_s, a.boat.position_timeout_s)
        fix_s = t_s
    return Intake(before.sources, before.heading_s, before.heading_interval_s, fix_s, interval_s)


@compiled
def count_fixes(at: Plant, now_s: float) -> int:
    """Return how many fixes are there; the first epoch is given when nothing has followed it for a while."""
    if not (at.first_given or now_s - at.first_fix_s > EPOCH_ENDS_AFTER_S):
        return 0
    count = 0
    while count < at.fix_count and at.fixes[count, THERE_S] <= now_s:
        at.first_given = True
        count += 1
    return count


@compiled
def estimate(a: Autopilot, at: Plant, offset_rad: float, headings: int, fixes: int) -> None:
    """Take so many headings and fixes in, in order of their times, a heading first."""
    f, c, model = a.filter, a.covariance, a.boat.model
    heading = fix = 0
    while heading < headings or fix < fixes:
        there = at.headings[heading]
        if heading < headings and (fix == fixes or there[THERE_S] <= at.fixes[fix, THERE_S]):
            said_rad = there[SAID_RAD] + offset_rad
            wave_filter.correct_heading(f, c, model, there[THERE_S], said_rad)
            heading += 1
        else:
            if at.fixes[fix, LOST] == 0.0:
                over_ground.correct_velocity(f, c, model, at.fixes[fix])
            fix += 1


@compiled
def drop(queue: Floats, gone: int, left: int) -> None:
    """Remove the first sentences of a queue, of which so many are left."""
    for place in range(left):
        for field in range(queue.shape[1]):
            queue[place, field] = queue[gone + place, field]
