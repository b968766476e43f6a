"""A tick of the autopilot: goals, heading source, estimate, monitors and heading controller.

Sources, monitors and controller are the firmware's own functions (hil/lab/numeric_core.py).
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from hil.lab.compiled import compiled
from hil.lab.numeric_core import heading_estimate, law, oscillation, rudder_limit, silence, sources, steering_monitor
from hil.lab.twin import intake, kalman, wave_filter
from hil.lab.twin.autopilot import Autopilot, CoreState, Intake, Task
from hil.lab.twin.learning import LOG_OMEGA
from hil.lab.twin.plant import Plant
from hil.lab.twin.wave_filter_state import RUDDER, SAMPLE_T, STARTED, WATER_SPEED, forget

ARMED_S, GUARD_S = 0.28, 0.003  # when the operator has armed and set the mode; before a tick the link waits
LOCK_MARGIN_S, LOCK_SLEW, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
LONGEST_STEP_S = 1.0


@compiled
def begin(a: Autopilot) -> None:
    """Set the state before the first tick."""
    me = a.state
    a.filter.w[WATER_SPEED] = a.boat.cruise_speed_m_s
    forget(a.filter)
    me.before_s = me.sample_s = me.goal_rad = np.nan


@compiled
def is_armed(now_s: float) -> bool:
    """Whether the boat is armed and in GUIDED by a tick."""
    return now_s > ARMED_S + GUARD_S


@compiled
def take_goals(a: Autopilot, task: Task, now_s: float) -> None:
    """Take the goals that have come by the tick; without one, keep the heading."""
    me = a.state
    if not is_armed(now_s):
        return
    while me.goals < task.given_s.size:
        given_s = task.given_s[me.goals]
        if not (given_s <= ARMED_S or given_s < now_s - GUARD_S):
            break
        me.goal_rad = wrap_two_pi(task.goals_rad[me.goals])
        me.goals += 1
    if math.isnan(me.goal_rad):
        me.goal_rad = me.heading_rad


@compiled
def update(a: Autopilot, task: Task, at: Plant, core: CoreState, now_s: float) -> CoreState:
    """Do a tick: afterwards the state has the rudder command."""
    take_goals(a, task, now_s)
    taken, headings = intake.judge_sources(a, at, core.intake, now_s)
    fixes = intake.count_fixes(at, now_s)
    offset_rad = sources.compass_in_use(taken.sources).offset_rad
    intake.estimate(a, at, offset_rad, headings if sources.uses_compass(taken.sources) else 0, fixes)
    taken = intake.learn_fixes(a, at, taken, fixes)
    settle(a, at, taken.sources.in_use == sources.Source.COURSE, headings, fixes, now_s)
    return steer(a, core, taken, now_s)


@compiled
def settle(a: Autopilot, at: Plant, by_course: bool, headings: int, fixes: int, now_s: float) -> None:
    """Drop the samples of a tick, and propagate the heading to it."""
    me, f, boat = a.state, a.filter, a.boat
    at.heading_count -= headings
    at.fix_count -= fixes
    intake.drop(at.headings, headings, at.heading_count)
    intake.drop(at.fixes, fixes, at.fix_count)
    f.w[RUDDER] = boat.servo_sign * at.feedback_rad
    if f.w[STARTED] > 0.0:
        me.heading_rad, me.rate_rad_s = wave_filter.predict_heading(f, boat.model, now_s)
        if by_course:
            me.sample_s = now_s
        elif not me.sample_s > f.w[SAMPLE_T]:
            me.sample_s = f.w[SAMPLE_T]
        me.steered_s = now_s


@compiled
def heading_estimate_of(a: Autopilot) -> heading_estimate.HeadingEstimate:
    """Return the input of the control law."""
    me, x, p = a.state, a.filter.x, a.covariance.p
    return heading_estimate.HeadingEstimate(
        me.heading_rad,
        max(2.0 * p[kalman.HEADING, kalman.RATE], 0.0),
        me.rate_rad_s,
        x[kalman.BIAS],
        x[kalman.BIAS_MEAN],
        x[kalman.SPEED],
        math.sqrt(p[kalman.SPEED, kalman.SPEED]),
        x[kalman.FACTOR],
    )


@compiled
def steer(a: Autopilot, core: CoreState, taken: Intake, now_s: float) -> CoreState:
    """Update the monitors of limit cycle and steering, and set the next rudder command."""
    me, f, boat = a.state, a.filter, a.boat
    step_s = 0.0 if math.isnan(me.before_s) else min(max(0.0, now_s - me.before_s), LONGEST_STEP_S)
    begun, armed = f.w[STARTED] > 0.0, is_armed(now_s)
    lost_after_s = silence.timeout_s(taken.heading_interval_s, boat.compass_timeout_s)
    steered = armed and now_s - me.sample_s <= lost_after_s and not math.isnan(me.goal_rad)
    me.error_rad = wrap_pi(me.goal_rad - me.heading_rad) if steered else np.nan
    known = heading_estimate_of(a)
    me.heading_sd_rad = math.sqrt(a.covariance.p[kalman.HEADING, kalman.HEADING])
    seen = oscillation.OscillationInput(
        me.error_rad if begun else np.nan,
        me.goal_rad,
        me.heading_sd_rad,
        me.command_rad,
        known.bias_mean_rad,
        known.bias_rad - known.bias_mean_rad,
        known.speed_m_s,
        2.0 * math.pi / math.exp(f.n[LOG_OMEGA]),
    )
    cycle = oscillation.update(a.law.model, core.oscillation, seen, now_s)
    given = steering_monitor.SteeringInput(
        f.w[RUDDER],
        me.heading_rad if steered else np.nan,
        me.heading_sd_rad,
        known.speed_m_s if begun else a.law.model.speed_m_s,
        me.error_rad,
        sources.compass_in_use(taken.sources).raw_rad,
    )
    steering = steering_monitor.update(a.law.model, boat.servo_sign < 0.0, core.steering, given, now_s)
    law_state, demand_rad = law.IDLE, me.command_rad if armed else 0.0
    if steered and begun:
        law_state, demand_rad = law.steer(
            a.law, core.law, known, me.error_rad, me.command_rad, step_s, cycle.gain_reduction
        )
    limits = rudder_limit.RudderLimits(boat.limit_rad, boat.slew_rad_s, boat.deadband_rad)
    me.command_rad = rudder_limit.limited_command(limits, me.command_rad, demand_rad, step_s)
    me.before_s = now_s
    return CoreState(taken, law_state, cycle, steering)


@compiled
def next_deadline(deadline_s: float, newest_s: float) -> float:
    """Return when the next tick is due: the ticks draw near to the compass (firmware_py/system/clock.py)."""
    if math.isnan(newest_s):
        return deadline_s + PERIOD_S
    ahead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    off_s = ahead_s - PERIOD_S * math.floor(ahead_s / PERIOD_S + 0.5)
    return deadline_s + (PERIOD_S + clamp(-LOCK_GAIN * off_s, -LOCK_SLEW * PERIOD_S, LOCK_SLEW * PERIOD_S))
