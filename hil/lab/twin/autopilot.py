"""The autopilot of the compiled loop: parameters, state, and control with the firmware's own functions."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from hil.lab.numeric_core import (
    LawSettings,
    heading_estimate,
    heading_tick,
    inner,
    law,
    oscillation,
    rudder_limit,
    sample_timeout,
    steering_monitor,
    water,
)
from hil.lab.twin.ship import Floats


class Boat(NamedTuple):
    """Parameters of the autopilot; `fixed_gains` are used while the estimator is not trusted."""

    heading: heading_tick.HeadingSettings
    fixed_gains: law.Gains
    limit_rad: float
    slew_rad_s: float
    deadband_rad: float
    compass_timeout_s: float
    position_timeout_s: float
    cruise_speed_m_s: float
    servo_sign: float


class Task(NamedTuple):
    """Times of the goals, and their headings as rounded by the operator's message."""

    times_s: Floats
    goals_rad: Floats


# Other state of the autopilot; NaN is an absent value. Times: before_s of the previous tick, steered_s of the last tick
# with a heading, sample_s of the newest heading used, newest_s of the newest compass message in this tick.
# `goals` is the number of goals received.
STATE = np.dtype(
    [
        *(
            (name, np.float64)
            for name in (
                "before_s", "command_rad", "heading_rad", "heading_sd_rad", "rate_rad_s", "steered_s", "sample_s",
                "goal_rad", "newest_s", "error_rad",
            )
        ),
        ("goals", np.int64),
    ]
)  # fmt: skip


class EstimatorState(NamedTuple):
    """State of the estimators; times and intervals of the newest heading and fix."""

    heading: heading_tick.HeadingTick
    water: water.WaterState
    heading_s: float
    heading_interval_s: float
    fix_s: float
    fix_interval_s: float


class TickEstimate(NamedTuple):
    """Results of the estimators at a tick for control law, monitors and record.

    `disturbance`: learned diffusion [rad^2/s] and rudder bias [rad] (heading_tick.learned_disturbance).
    It is a separate record because functions with `EstimatorState`, which has hundreds of numbers, compile slowly.
    """

    started: bool
    trusted: bool
    estimate: heading_estimate.HeadingEstimate
    heading_sd_rad: float
    wave_period_s: float
    delay_log_ratio: float
    disturbance: tuple[float, float]
    rudder_rad: float
    compass_rad: float
    heading_interval_s: float
    inconsistent: bool
    current_strong: float


class ControlState(NamedTuple):
    """State of control law and monitors."""

    law: law.LawState
    oscillation: oscillation.OscillationState
    steering: steering_monitor.SteeringMonitorState


def initial_state(boat: Boat) -> tuple[EstimatorState, ControlState]:
    """Return the states before the first tick."""
    water_state = water.initial_state(0.0, 0.0, boat.cruise_speed_m_s)
    estimators = EstimatorState(heading_tick.START, water_state, np.nan, np.nan, np.nan, np.nan)
    return estimators, ControlState(law.IDLE, oscillation.START, steering_monitor.START)


class Autopilot(NamedTuple):
    """Parameters of a run, a record of STATE, and the settings of the control law."""

    boat: Boat
    state: Any
    law: LawSettings


ARMED_S = 0.28  # time of arming and mode change
GUARD_S = 0.003  # messages within GUARD_S before a tick are received at the next tick
LOCK_MARGIN_S, MAX_PHASE_STEP, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
MAX_STEP_S = 1.0


@inner
def begin(a: Autopilot) -> None:
    """Initialise the state before the first tick."""
    a.state.before_s = a.state.sample_s = a.state.goal_rad = np.nan


@inner
def is_armed(now_s: float) -> bool:
    """Return whether the boat is armed and in mode GUIDED at a tick."""
    return now_s > ARMED_S + GUARD_S


@inner
def receive_goals(a: Autopilot, task: Task, now_s: float) -> None:
    """Store the newest goal received before the tick; without any goal, the present heading becomes the goal."""
    state = a.state
    if not is_armed(now_s):
        return
    while state.goals < task.times_s.size:
        times_s = task.times_s[state.goals]
        if not (times_s <= ARMED_S or times_s < now_s - GUARD_S):
            break
        state.goal_rad = wrap_two_pi(task.goals_rad[state.goals])
        state.goals += 1
    if math.isnan(state.goal_rad):
        state.goal_rad = state.heading_rad


@inner
def steer(a: Autopilot, control: ControlState, tick: TickEstimate, now_s: float) -> ControlState:
    """Update the limit-cycle and steering monitors, and compute the next rudder command."""
    state, boat, estimate = a.state, a.boat, tick.estimate
    step_s = 0.0 if math.isnan(state.before_s) else min(max(0.0, now_s - state.before_s), MAX_STEP_S)
    is_armed_now = is_armed(now_s)
    timeout_s = sample_timeout.timeout_s(tick.heading_interval_s, boat.compass_timeout_s)
    is_steering = is_armed_now and now_s - state.sample_s <= timeout_s and not math.isnan(state.goal_rad)
    state.error_rad = wrap_pi(state.goal_rad - state.heading_rad) if is_steering else np.nan
    state.heading_sd_rad = tick.heading_sd_rad
    oscillation_input = oscillation.OscillationInput(
        state.error_rad if tick.started else np.nan,
        state.goal_rad,
        state.heading_sd_rad,
        state.command_rad,
        estimate.bias_mean_rad,
        estimate.speed_m_s,
        tick.wave_period_s,
        tick.delay_log_ratio,
    )
    oscillation_state = oscillation.update(a.law.model, control.oscillation, oscillation_input, now_s)
    steering_input = steering_monitor.SteeringInput(
        tick.rudder_rad,
        state.heading_rad if is_steering else np.nan,
        state.heading_sd_rad,
        estimate.speed_m_s,
        state.error_rad,
        tick.compass_rad,
        tick.disturbance[0],
        tick.disturbance[1],
    )
    steering = steering_monitor.update(a.law.model, boat.servo_sign < 0.0, control.steering, steering_input, now_s)
    law_state, demand_rad = law.IDLE, state.command_rad if is_armed_now else 0.0
    if is_steering and tick.trusted:
        law_state, demand_rad = law.steer(
            a.law, control.law, estimate, state.error_rad, state.command_rad, step_s, oscillation_state.gain_reduction
        )
    elif is_steering and tick.started:
        demand_rad = law.s_surface(boat.fixed_gains, state.error_rad, state.rate_rad_s)
    limits = rudder_limit.RudderLimits(boat.limit_rad, boat.slew_rad_s, boat.deadband_rad)
    state.command_rad = rudder_limit.limit_command(limits, state.command_rad, demand_rad, step_s)
    state.before_s = now_s
    return ControlState(law_state, oscillation_state, steering)


@inner
def next_deadline(deadline_s: float, newest_s: float) -> float:
    """Return the time of the next tick; the ticks are synchronised to the compass (firmware_py/system/clock.py)."""
    if math.isnan(newest_s):
        return deadline_s + PERIOD_S
    lead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    phase_s = lead_s - PERIOD_S * math.floor(lead_s / PERIOD_S + 0.5)
    return deadline_s + (PERIOD_S + clamp(-LOCK_GAIN * phase_s, -MAX_PHASE_STEP * PERIOD_S, MAX_PHASE_STEP * PERIOD_S))
