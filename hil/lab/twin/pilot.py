"""A tick of the autopilot: goals, heading source, estimate, limit cycle detection and heading controller."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from hil.lab.compiled import compiled
from hil.lab.numeric_core import oscillation, rudder_limit
from hil.lab.twin import helm, intake, kalman, sources, wave_filter
from hil.lab.twin.autopilot import Autopilot, Task
from hil.lab.twin.devices import THERE_S
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
    me, boat = a.state, a.boat
    a.filter.w[WATER_SPEED] = boat.cruise_speed_m_s
    forget(a.filter)
    sources.begin(me.source)
    me.helm[helm.REF_HEADING] = me.helm[helm.FOLLOWED_BIAS] = np.nan
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
def update(
    a: Autopilot, task: Task, at: Plant, cycle: oscillation.OscillationState, now_s: float
) -> oscillation.OscillationState:
    """Do a tick: afterwards the state has the rudder command."""
    take_goals(a, task, now_s)
    headings = intake.judge_sources(a, at, now_s)
    fixes = intake.count_fixes(at, now_s)
    intake.estimate(a, at, headings if a.state.source[sources.IN_USE] == sources.COMPASS else 0, fixes)
    settle(a, at, headings, fixes, now_s)
    return steer(a, cycle, now_s)


@compiled
def settle(a: Autopilot, at: Plant, headings: int, fixes: int, now_s: float) -> None:
    """Drop the samples of a tick, and propagate the heading to it."""
    me, f, s, boat = a.state, a.filter, a.state.source, a.boat
    for fix in range(fixes):
        sources.learn_interval(
            s, sources.FIX_TOLD, sources.FIX_INTERVAL, at.fixes[fix, THERE_S], boat.position_timeout_s
        )
    at.heading_count -= headings
    at.fix_count -= fixes
    intake.drop(at.headings, headings, at.heading_count)
    intake.drop(at.fixes, fixes, at.fix_count)
    f.w[RUDDER] = boat.servo_sign * at.feedback_rad
    if f.w[STARTED] > 0.0:
        me.heading_rad, me.rate_rad_s = wave_filter.predict_heading(f, boat.model, now_s)
        if s[sources.IN_USE] == sources.COURSE:
            me.sample_s = now_s
        elif not me.sample_s > f.w[SAMPLE_T]:
            me.sample_s = f.w[SAMPLE_T]
        me.steered_s = now_s


@compiled
def know(a: Autopilot) -> None:
    """Fill what the controller knows of an estimate that has begun."""
    me, x, p, e = a.state, a.filter.x, a.covariance.p, a.state.known
    e[helm.E_HEADING], e[helm.E_RATE] = me.heading_rad, me.rate_rad_s
    e[helm.E_CORRECTION] = max(2.0 * p[kalman.HEADING, kalman.RATE], 0.0)
    e[helm.E_HEADING_SD] = math.sqrt(p[kalman.HEADING, kalman.HEADING])
    e[helm.E_BIAS], e[helm.E_BIAS_MEAN] = x[kalman.BIAS], x[kalman.BIAS_MEAN]
    e[helm.E_SPEED] = x[kalman.SPEED]
    e[helm.E_SPEED_SD] = math.sqrt(p[kalman.SPEED, kalman.SPEED])
    e[helm.E_FACTOR] = x[kalman.FACTOR]


@compiled
def steer(a: Autopilot, cycle: oscillation.OscillationState, now_s: float) -> oscillation.OscillationState:
    """Detect a limit cycle and set the next rudder command."""
    me, f, boat = a.state, a.filter, a.boat
    step_s = 0.0 if math.isnan(me.before_s) else min(max(0.0, now_s - me.before_s), LONGEST_STEP_S)
    begun, armed = f.w[STARTED] > 0.0, is_armed(now_s)
    lost_after_s = sources.timeout_s(me.source[sources.INTERVAL], boat.compass_timeout_s)
    steered = armed and now_s - me.sample_s <= lost_after_s and not math.isnan(me.goal_rad)
    me.error_rad = wrap_pi(me.goal_rad - me.heading_rad) if steered else np.nan
    if begun:
        know(a)
    trim_rad = f.x[kalman.BIAS_MEAN]
    seen = oscillation.OscillationInput(
        me.error_rad if begun else np.nan,
        me.goal_rad,
        me.known[helm.E_HEADING_SD],
        me.command_rad,
        trim_rad,
        me.known[helm.E_BIAS] - trim_rad,
        me.known[helm.E_SPEED],
        2.0 * math.pi / math.exp(f.n[LOG_OMEGA]),
    )
    cycle = oscillation.update(a.law.model, cycle, seen, now_s)
    demand_rad = me.command_rad if armed else 0.0
    if steered and begun:
        gain_reduction = cycle.gain_reduction
        demand_rad = helm.steer(a.law, me.helm, me.known, me.error_rad, me.command_rad, step_s, gain_reduction)
    else:
        me.helm[helm.REF_HEADING] = me.helm[helm.FOLLOWED_BIAS] = np.nan
    limits = rudder_limit.RudderLimits(boat.limit_rad, boat.slew_rad_s, boat.deadband_rad)
    me.command_rad = rudder_limit.limited_command(limits, me.command_rad, demand_rad, step_s)
    me.before_s = now_s
    return cycle


@compiled
def next_deadline(deadline_s: float, newest_s: float) -> float:
    """Return when the next tick is due: the ticks draw near to the compass (firmware_py/system/clock.py)."""
    if math.isnan(newest_s):
        return deadline_s + PERIOD_S
    ahead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    off_s = ahead_s - PERIOD_S * math.floor(ahead_s / PERIOD_S + 0.5)
    return deadline_s + (PERIOD_S + clamp(-LOCK_GAIN * off_s, -LOCK_SLEW * PERIOD_S, LOCK_SLEW * PERIOD_S))
