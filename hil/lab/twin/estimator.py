"""The estimators of the compiled loop: reception of messages and the firmware's own estimation functions."""

from __future__ import annotations

import math

import numpy as np

from hil.lab.numeric_core import heading_filter, heading_tick, inner, sample_timeout, sources, water
from hil.lab.twin.autopilot import Autopilot, EstimatorState, TickEstimate
from hil.lab.twin.devices import ARRIVAL_S, LATITUDE_RAD, LONGITUDE_RAD, LOST, MESSAGE_RAD
from hil.lab.twin.plant import Plant
from hil.lab.twin.ship import Floats

EPOCH_TIMEOUT_S = 0.5


@inner
def update(
    a: Autopilot, plant_state: Plant, before: EstimatorState, now_s: float
) -> tuple[EstimatorState, TickEstimate]:
    """Update the estimators with the received headings and fixes, and set the heading to steer by.

    See heading_estimator.update. It is one function to keep the compilation short (see TickEstimate).
    """
    state, boat, s, fixes = a.state, a.boat, before.heading, count_fixes(plant_state, now_s)
    model = water.model_at_speed(boat.heading.model, before.water)
    heading_s, interval_s = before.heading_s, before.heading_interval_s
    # Timeouts are based on the intervals before this tick, because a gap must not extend its own timeout.
    lost_after_s = sample_timeout.timeout_s(interval_s, boat.compass_timeout_s)
    fix_lost_after_s = sample_timeout.timeout_s(before.fix_interval_s, boat.position_timeout_s)
    timeouts_s = (lost_after_s, lost_after_s)
    s = heading_tick.begin_tick(s, now_s, now_s - state.steered_s, timeouts_s)
    state.newest_s, headings = np.nan, 0
    while headings < plant_state.heading_count and plant_state.headings[headings, ARRIVAL_S] <= now_s:
        t_s, message_rad = plant_state.headings[headings, ARRIVAL_S], plant_state.headings[headings, MESSAGE_RAD]
        s = heading_tick.add_sample(s, model, sources.TrueHeadingSample(t_s, message_rad, message_rad, 0))
        interval_s = sample_timeout.learn_interval_s(interval_s, t_s - heading_s, boat.compass_timeout_s)
        state.newest_s = heading_s = t_s
        headings += 1
    s = heading_tick.select(s, boat.heading, model, now_s, timeouts_s, before.water, fix_lost_after_s)
    if sources.uses_compass(s.sources):
        for heading in range(headings):
            t_s, message_rad = plant_state.headings[heading, ARRIVAL_S], plant_state.headings[heading, MESSAGE_RAD]
            s = heading_tick.take_heading(s, boat.heading, model, t_s, message_rad, lost_after_s)
    water_state = before.water
    fix_s, fix_interval_s = before.fix_s, before.fix_interval_s
    for fix in range(fixes):
        t_s = plant_state.fixes[fix, ARRIVAL_S]
        fix_interval_s = sample_timeout.learn_interval_s(fix_interval_s, t_s - fix_s, boat.position_timeout_s)
        fix_s = t_s
        if plant_state.fixes[fix, LOST] == 0.0:
            latitude_rad, longitude_rad = plant_state.fixes[fix, LATITUDE_RAD], plant_state.fixes[fix, LONGITUDE_RAD]
            water_state, course_rad, sd_rad = water.take_position(water_state, t_s, latitude_rad, longitude_rad)
            s = heading_tick.take_course(s, boat.heading, t_s, course_rad, sd_rad)
    drop_messages(plant_state, headings, fixes)
    s = heading_tick.end_tick(s, boat.servo_sign * plant_state.feedback_rad)
    f, compass = s.filter, sources.compass_in_use(s.sources)
    has_started, is_by_compass = heading_filter.has_started(f), sources.uses_compass(s.sources)
    if has_started:
        state.heading_rad, state.rate_rad_s = heading_tick.heading_at(s, model, now_s)
        if s.sources.in_use == sources.Source.COURSE:
            state.sample_s = now_s
        elif not state.sample_s > f.t_s:
            state.sample_s = f.t_s
        water_state = water.take_heading(water_state, state.heading_rad, is_by_compass, now_s - state.steered_s)
        state.steered_s = now_s
    water_state = water.update(water_state, now_s)
    tick = TickEstimate(
        has_started, heading_tick.is_trusted(s),
        heading_tick.estimate_of(s, state.heading_rad, state.rate_rad_s, water_state), heading_tick.heading_sd(s),
        math.exp(f.levels.wave_period), s.delay.log_ratio, heading_tick.learned_disturbance(s), s.rudder_rad,
        compass.raw_rad, interval_s, s.check.is_rejected, water_state.verdict.too_strong,
    )  # fmt: skip
    return EstimatorState(s, water_state, heading_s, interval_s, fix_s, fix_interval_s), tick


@inner
def count_fixes(plant_state: Plant, now_s: float) -> int:
    """Return the number of received fixes; the first epoch is complete after EPOCH_TIMEOUT_S without sentences."""
    if not (plant_state.has_fixes or now_s - plant_state.first_fix_s > EPOCH_TIMEOUT_S):
        return 0
    count = 0
    while count < plant_state.fix_count and plant_state.fixes[count, ARRIVAL_S] <= now_s:
        plant_state.has_fixes = True
        count += 1
    return count


@inner
def drop_messages(plant_state: Plant, headings: int, fixes: int) -> None:
    """Remove the processed messages from the queues."""
    plant_state.heading_count -= headings
    plant_state.fix_count -= fixes
    shift_queue(plant_state.headings, headings, plant_state.heading_count)
    shift_queue(plant_state.fixes, fixes, plant_state.fix_count)


@inner
def shift_queue(queue: Floats, removed: int, remaining: int) -> None:
    """Remove the first `removed` messages of a queue; `remaining` messages remain."""
    for row in range(remaining):
        for field in range(queue.shape[1]):
            queue[row, field] = queue[removed + row, field]
