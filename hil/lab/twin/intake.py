"""The sentences that are there at a tick, and the estimates from them by the firmware's own functions."""

from __future__ import annotations

import math

import numpy as np

from hil.lab.numeric_core import heading_filter, heading_tick, inner, sample_timeout, sources, water
from hil.lab.twin.autopilot import Autopilot, Intake, Seen
from hil.lab.twin.devices import LATITUDE_RAD, LONGITUDE_RAD, LOST, SAID_RAD, THERE_S
from hil.lab.twin.plant import Plant
from hil.lab.twin.ship import Floats

EPOCH_ENDS_AFTER_S = 0.5


@inner
def update(a: Autopilot, at: Plant, before: Intake, now_s: float) -> tuple[Intake, Seen]:
    """Take in the headings and fixes that are there (heading_estimator.update).

    Afterwards the state has the heading to steer by. This is one function for the time of compilation (see Seen).
    """
    me, boat, s, fixes = a.state, a.boat, before.heading, count_fixes(at, now_s)
    model = water.model_at_speed(boat.heading.model, before.water)
    heading_s, interval_s = before.heading_s, before.heading_interval_s
    # As known before this tick: a gap must not excuse itself.
    lost_after_s = sample_timeout.timeout_s(interval_s, boat.compass_timeout_s)
    fix_lost_after_s = sample_timeout.timeout_s(before.fix_interval_s, boat.position_timeout_s)
    timeouts_s = (lost_after_s, lost_after_s)
    s = heading_tick.begin_tick(s, now_s, now_s - me.steered_s, timeouts_s)
    me.newest_s, headings = np.nan, 0
    while headings < at.heading_count and at.headings[headings, THERE_S] <= now_s:
        t_s, said_rad = at.headings[headings, THERE_S], at.headings[headings, SAID_RAD]
        s = heading_tick.add_sample(s, model, sources.TrueHeadingSample(t_s, said_rad, said_rad, 0))
        interval_s = sample_timeout.learn_interval_s(interval_s, t_s - heading_s, boat.compass_timeout_s)
        me.newest_s = heading_s = t_s
        headings += 1
    s = heading_tick.select(s, boat.heading, model, now_s, timeouts_s, before.water, fix_lost_after_s)
    if sources.uses_compass(s.sources):
        for heading in range(headings):
            t_s, said_rad = at.headings[heading, THERE_S], at.headings[heading, SAID_RAD]
            s = heading_tick.take_heading(s, boat.heading, model, t_s, said_rad, lost_after_s)
    known = before.water
    fix_s, fix_interval_s = before.fix_s, before.fix_interval_s
    for fix in range(fixes):
        t_s = at.fixes[fix, THERE_S]
        fix_interval_s = sample_timeout.learn_interval_s(fix_interval_s, t_s - fix_s, boat.position_timeout_s)
        fix_s = t_s
        if at.fixes[fix, LOST] == 0.0:
            latitude_rad, longitude_rad = at.fixes[fix, LATITUDE_RAD], at.fixes[fix, LONGITUDE_RAD]
            known, course_rad, sd_rad = water.take_position(known, t_s, latitude_rad, longitude_rad)
            s = heading_tick.take_course(s, boat.heading, t_s, course_rad, sd_rad)
    drop(at, headings, fixes)
    s = heading_tick.end_tick(s, boat.servo_sign * at.feedback_rad)
    f, compass = s.filter, sources.compass_in_use(s.sources)
    started, by_compass = heading_filter.has_started(f), sources.uses_compass(s.sources)
    if started:
        me.heading_rad, me.rate_rad_s = heading_tick.heading_at(s, model, now_s)
        if s.sources.in_use == sources.Source.COURSE:
            me.sample_s = now_s
        elif not me.sample_s > f.t_s:
            me.sample_s = f.t_s
        known = water.take_heading(known, me.heading_rad, by_compass, now_s - me.steered_s)
        me.steered_s = now_s
    known = water.update(known, now_s)
    seen = Seen(
        started,
        heading_tick.is_trusted(s),
        heading_tick.estimate_of(s, me.heading_rad, me.rate_rad_s, known),
        heading_tick.heading_sd(s),
        math.exp(f.levels.wave_period),
        s.delay.log_ratio,
        heading_tick.learned_disturbance(s),
        s.rudder_rad,
        compass.raw_rad,
        interval_s,
        s.check.is_rejected,
        known.verdict.too_strong,
    )
    return Intake(s, known, heading_s, interval_s, fix_s, fix_interval_s), seen


@inner
def count_fixes(at: Plant, now_s: float) -> int:
    """Return how many fixes are there; the first epoch is given when nothing has followed it for a while."""
    if not (at.first_given or now_s - at.first_fix_s > EPOCH_ENDS_AFTER_S):
        return 0
    count = 0
    while count < at.fix_count and at.fixes[count, THERE_S] <= now_s:
        at.first_given = True
        count += 1
    return count


@inner
def drop(at: Plant, headings: int, fixes: int) -> None:
    """Remove the sentences of a tick from the queues."""
    at.heading_count -= headings
    at.fix_count -= fixes
    shift(at.headings, headings, at.heading_count)
    shift(at.fixes, fixes, at.fix_count)


@inner
def shift(queue: Floats, gone: int, left: int) -> None:
    """Remove the first sentences of a queue, of which so many are left."""
    for place in range(left):
        for field in range(queue.shape[1]):
            queue[place, field] = queue[gone + place, field]
