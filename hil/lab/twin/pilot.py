"""A tick of the autopilot: goals, limit cycle detection, steering monitor and heading controller.

They are the firmware's own functions (hil/lab/numeric_core.py), as are those of the estimate (intake.py).
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from hil.lab.numeric_core import inner, law, oscillation, rudder_limit, sample_timeout, steering_monitor
from hil.lab.twin.autopilot import Autopilot, Helm, Seen, Task

ARMED_S, GUARD_S = 0.28, 0.003  # when the operator has armed and set the mode; before a tick the link waits
LOCK_MARGIN_S, LOCK_SLEW, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
LONGEST_STEP_S = 1.0


@inner
def begin(a: Autopilot) -> None:
    """Set the state before the first tick."""
    a.state.before_s = a.state.sample_s = a.state.goal_rad = np.nan


@inner
def is_armed(now_s: float) -> bool:
    """Whether the boat is armed and in GUIDED by a tick."""
    return now_s > ARMED_S + GUARD_S


@inner
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


@inner
def steer(a: Autopilot, helm: Helm, seen: Seen, now_s: float) -> Helm:
    """Update the monitors of limit cycle and steering, and set the next rudder command."""
    me, boat, known = a.state, a.boat, seen.estimate
    step_s = 0.0 if math.isnan(me.before_s) else min(max(0.0, now_s - me.before_s), LONGEST_STEP_S)
    armed = is_armed(now_s)
    lost_after_s = sample_timeout.timeout_s(seen.heading_interval_s, boat.compass_timeout_s)
    steered = armed and now_s - me.sample_s <= lost_after_s and not math.isnan(me.goal_rad)
    me.error_rad = wrap_pi(me.goal_rad - me.heading_rad) if steered else np.nan
    me.heading_sd_rad = seen.heading_sd_rad
    swing = oscillation.OscillationInput(
        me.error_rad if seen.started else np.nan,
        me.goal_rad,
        me.heading_sd_rad,
        me.command_rad,
        known.bias_mean_rad,
        known.speed_m_s,
        seen.wave_period_s,
        seen.delay_log_ratio,
    )
    cycle = oscillation.update(a.law.model, helm.oscillation, swing, now_s)
    given = steering_monitor.SteeringInput(
        seen.rudder_rad,
        me.heading_rad if steered else np.nan,
        me.heading_sd_rad,
        known.speed_m_s,
        me.error_rad,
        seen.shown_rad,
        seen.disturbance[0],
        seen.disturbance[1],
    )
    steering = steering_monitor.update(a.law.model, boat.servo_sign < 0.0, helm.steering, given, now_s)
    law_state, demand_rad = law.IDLE, me.command_rad if armed else 0.0
    if steered and seen.trusted:
        law_state, demand_rad = law.steer(
            a.law, helm.law, known, me.error_rad, me.command_rad, step_s, cycle.gain_reduction
        )
    elif steered and seen.started:
        demand_rad = law.s_surface(boat.stand_in, me.error_rad, me.rate_rad_s)
    limits = rudder_limit.RudderLimits(boat.limit_rad, boat.slew_rad_s, boat.deadband_rad)
    me.command_rad = rudder_limit.limited_command(limits, me.command_rad, demand_rad, step_s)
    me.before_s = now_s
    return Helm(law_state, cycle, steering)


@inner
def next_deadline(deadline_s: float, newest_s: float) -> float:
    """Return when the next tick is due: the ticks draw near to the compass (firmware_py/system/clock.py)."""
    if math.isnan(newest_s):
        return deadline_s + PERIOD_S
    ahead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    off_s = ahead_s - PERIOD_S * math.floor(ahead_s / PERIOD_S + 0.5)
    return deadline_s + (PERIOD_S + clamp(-LOCK_GAIN * off_s, -LOCK_SLEW * PERIOD_S, LOCK_SLEW * PERIOD_S))
