"""Twins of the firmware's heading control, for compiled code: all that the tuner knows of it.

    firmware_py/estimate/observer.py        observer_predict, observer_correct
    firmware_py/control/s_surface.py       rudder_demand
    firmware_py/control/rudder_limit.py    limited_command
    firmware_py/common/angles.py                  clamp, wrap_pi, wrap_two_pi (numba has no math.fmod)

The harness may not import the first three; tests/unit/hil/lab/tune/test_loop_kernel.py holds each twin
against its original, bit for bit. What the twins leave out is what a trial run never has:
samples that are late, missing or not numbers.

To follow a change of the firmware's control: bring the twin up to date until that test passes, keep in
`pilot_begins` and `pilot_steers` the firmware's order of things and in a row of `state` what lasts from tick to
tick, and name what is to be searched in cases.pilot_of, trials.Setting and search.BOUNDS. The ship, the
seas and the search know nothing of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import TWO_PI
from firmware_py.model.kt import decay_over, exact_step
from hil.lab.compiled import compiled

# Columns of a setting, and of what the autopilot keeps from tick to tick.
K1, K2, TAU_S, DEADBAND_RAD = range(4)
HEADING_RAD, YAW_RATE_RAD_S, COMMAND_RAD, THETA, DECAY = range(5)
PILOT_STATES = 5


class Pilot(NamedTuple):
    """What the autopilot knows and is built with; the searched parameters come separately.

    turning_ability_1_s and turning_lag_s are the observer's model (MDL_K, MDL_T_S), rate_limit_rad_s
    its bound on the yaw rate, rate_max_rad_s the yaw rate that normalises the controller's.
    """

    turning_ability_1_s: float
    turning_lag_s: float
    rate_limit_rad_s: float
    rate_max_rad_s: float
    rudder_limit_rad: float
    rudder_slew_rad_s: float
    trim_rad: float
    servo_slew_rad_s: float


@compiled
def clamp(value: float, low: float, high: float) -> float:
    """Limit a value to [low, high]."""
    if value < low:
        return low
    return high if value > high else value


@compiled
def within_a_turn(angle_rad: float) -> float:
    """Return fmod(angle, 2 pi); within two turns a subtraction gives it exactly (Sterbenz) and faster."""
    if abs(angle_rad) >= 2.0 * TWO_PI:
        angle_rad = np.fmod(angle_rad, TWO_PI)
    elif angle_rad >= TWO_PI:
        angle_rad -= TWO_PI
    elif angle_rad <= -TWO_PI:
        angle_rad += TWO_PI
    return angle_rad


@compiled
def wrap_pi(angle_rad: float) -> float:
    """Return the angle in [-pi, pi)."""
    wrapped_rad = within_a_turn(angle_rad + math.pi)
    if wrapped_rad < 0.0:
        wrapped_rad += TWO_PI
    result_rad = wrapped_rad - math.pi
    return -math.pi if result_rad >= math.pi else result_rad


@compiled
def wrap_two_pi(angle_rad: float) -> float:
    """Return the angle in [0, 2 pi)."""
    wrapped_rad = within_a_turn(angle_rad)
    if wrapped_rad < 0.0:
        wrapped_rad += TWO_PI
    return 0.0 if wrapped_rad >= TWO_PI else wrapped_rad


@compiled
def rudder_demand(
    heading_error_rad: float,
    yaw_rate_rad_s: float,
    k1: float,
    k2: float,
    rudder_limit_rad: float,
    rate_max_rad_s: float,
    trim_rad: float,
) -> float:
    """Return the S-surface's rudder angle (firmware_py.control.s_surface.rudder_demand)."""
    error = heading_error_rad / math.pi
    error_rate = -yaw_rate_rad_s / rate_max_rad_s
    surface = math.tanh(0.5 * (k1 * error + k2 * error_rate))
    return clamp(rudder_limit_rad * surface + trim_rad, -rudder_limit_rad, rudder_limit_rad)


@compiled
def limited_command(
    command_rad: float, demand_rad: float, step_s: float, limit_rad: float, slew_rad_s: float, deadband_rad: float
) -> float:
    """Return the next rudder command (firmware_py.control.rudder_limit.limited_command)."""
    target_rad = clamp(demand_rad, -limit_rad, limit_rad)
    change_rad = target_rad - command_rad
    if abs(change_rad) < deadband_rad:
        return clamp(command_rad, -limit_rad, limit_rad)
    reach_rad = slew_rad_s * step_s
    return command_rad + clamp(change_rad, -reach_rad, reach_rad)


@compiled
def observer_predict(
    heading_rad: float,
    yaw_rate_rad_s: float,
    rudder_rad: float,
    step_s: float,
    decay: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
) -> tuple[float, float]:
    """Carry heading and yaw rate on (firmware_py.estimate.observer.predict); decay is decay_over(step, T)."""
    turned_rad, yaw_rate_rad_s = exact_step(
        yaw_rate_rad_s, turning_ability_1_s * rudder_rad, decay, step_s, turning_lag_s
    )
    return wrap_two_pi(heading_rad + turned_rad), yaw_rate_rad_s


@compiled
def observer_correct(
    heading_rad: float,
    yaw_rate_rad_s: float,
    measured_rad: float,
    step_s: float,
    theta: float,
    rate_limit_rad_s: float,
) -> tuple[float, float]:
    """Take a sample in (firmware_py.estimate.observer.correct); theta is exp(-step / tau)."""
    innovation_rad = wrap_pi(measured_rad - heading_rad)
    yaw_rate_rad_s += (1.0 - theta) * (1.0 - theta) * innovation_rad / step_s
    return (
        wrap_two_pi(heading_rad + (1.0 - theta * theta) * innovation_rad),
        clamp(yaw_rate_rad_s, -rate_limit_rad_s, rate_limit_rad_s),
    )


@compiled
def pilot_begins(state: np.ndarray, setting: np.ndarray, pilot: Pilot, measured_rad: float, step_s: float) -> None:
    """Fill the autopilot's state at its first sample, with the rudder amidships."""
    state[HEADING_RAD], state[YAW_RATE_RAD_S], state[COMMAND_RAD] = measured_rad, 0.0, 0.0
    state[THETA], state[DECAY] = math.exp(-step_s / setting[TAU_S]), decay_over(step_s, pilot.turning_lag_s)


@compiled
def pilot_steers(
    state: np.ndarray,
    setting: np.ndarray,
    pilot: Pilot,
    tick: int,
    goal_rad: float,
    measured_rad: float,
    rudder_rad: float,
    step_s: float,
) -> float:
    """Return the rudder command of a tick, from what compass and servo say; the first sample is known already."""
    heading_rad, yaw_rate_rad_s = state[HEADING_RAD], state[YAW_RATE_RAD_S]
    if tick > 0:
        heading_rad, yaw_rate_rad_s = observer_predict(
            heading_rad,
            yaw_rate_rad_s,
            rudder_rad,
            step_s,
            state[DECAY],
            pilot.turning_ability_1_s,
            pilot.turning_lag_s,
        )
        heading_rad, yaw_rate_rad_s = observer_correct(
            heading_rad, yaw_rate_rad_s, measured_rad, step_s, state[THETA], pilot.rate_limit_rad_s
        )
        state[HEADING_RAD], state[YAW_RATE_RAD_S] = heading_rad, yaw_rate_rad_s
    error_rad, limit_rad = wrap_pi(goal_rad - heading_rad), pilot.rudder_limit_rad
    demand_rad = rudder_demand(
        error_rad, yaw_rate_rad_s, setting[K1], setting[K2], limit_rad, pilot.rate_max_rad_s, pilot.trim_rad
    )
    state[COMMAND_RAD] = limited_command(
        state[COMMAND_RAD], demand_rad, step_s, limit_rad, pilot.rudder_slew_rad_s, setting[DEADBAND_RAD]
    )
    return float(state[COMMAND_RAD])
