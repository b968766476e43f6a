"""Compiled closed loop of ship and autopilot for the trial runs of the tuner of fixed gains.

The ship is the K-T equation; the autopilot consists of the firmware's own functions (hil/lab/numeric_core.py):
observer, S-surface and rudder limits. Late, missing and invalid samples are not simulated.
tests/unit/hil/lab/tune/test_loop_kernel.py compares the loop with the firmware tick by tick, to the last bit, and
tests/process/test_tune.py with the autopilot on ptys.

After a change of the control law, adapt the steps in `start_autopilot` and `autopilot_command`, the columns of `state`,
and the searched parameters in cases.autopilot_of, trials.Setting and search.BOUNDS.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from firmware_py.model.kt import decay_over, rk4_step
from hil.lab.compiled import compiled
from hil.lab.numeric_core import fixed_gain, law, rudder_limit

Floats = NDArray[np.float64]

COUNT_RAD = 2.0 * math.pi / 4096.0  # step of the servo's encoder: 0.088 deg
RESOLUTION_RAD = math.pi / 1800.0  # step of the compass sentence: 0.1 deg

# Columns of the results of a case.
ITAE, RMS, MEAN, TRAVEL, OVERSHOOT = range(5)
RESULTS = 5


# Columns of a setting, and of the state of the autopilot. THETA is the decay of the observer's error in a tick, DECAY
# that of the yaw rate of the model.
K1, K2, TAU_S, DEADBAND_RAD = range(4)
HEADING_RAD, YAW_RATE_RAD_S, COMMAND_RAD, THETA, DECAY = range(5)
AUTOPILOT_STATES = 5


class Autopilot(NamedTuple):
    """Settings of the autopilot without the searched parameters.

    turning_ability_1_s, turning_lag_s: observer's model (MDL_K, MDL_T_S). rate_limit_rad_s: its limit of the yaw rate.
    rate_max_rad_s: the controller divides the yaw rate by it.
    """

    turning_ability_1_s: float
    turning_lag_s: float
    rate_limit_rad_s: float
    rate_max_rad_s: float
    rudder_limit_rad: float
    rudder_slew_rad_s: float
    trim_rad: float
    servo_slew_rad_s: float


class Task(NamedTuple):
    """The goals [rad] of consecutive legs of `leg_ticks` ticks each; the steady part starts after `steady_ticks`."""

    goals_rad: Floats
    leg_ticks: int
    steady_ticks: int
    step_s: float


class Seas(NamedTuple):
    """The ships and their disturbances, a row for each case.

    ships: K, T, alpha and the number of Runge-Kutta steps in a tick. compass_rad: waves and noise of the compass at
    each tick. offset_rad: the rudder angle at which the boat goes straight, at each tick.
    """

    ships: Floats
    compass_rad: Floats
    offset_rad: Floats


@compiled
def start_autopilot(state: Floats, setting: Floats, autopilot: Autopilot, measured_rad: float, step_s: float) -> None:
    """Initialise the autopilot's state with the first compass reading and a centred rudder."""
    state[HEADING_RAD], state[YAW_RATE_RAD_S], state[COMMAND_RAD] = measured_rad, 0.0, 0.0
    state[THETA], state[DECAY] = math.exp(-step_s / setting[TAU_S]), decay_over(step_s, autopilot.turning_lag_s)


@compiled
def autopilot_command(
    state: Floats,
    setting: Floats,
    autopilot: Autopilot,
    tick: int,
    goal_rad: float,
    measured_rad: float,
    rudder_rad: float,
    step_s: float,
) -> float:
    """Return the rudder command of a tick from compass and servo; at tick 0 the reading is already in the state."""
    heading_rad, yaw_rate_rad_s = state[HEADING_RAD], state[YAW_RATE_RAD_S]
    if tick > 0:
        heading_rad, yaw_rate_rad_s = fixed_gain.predict(
            heading_rad,
            yaw_rate_rad_s,
            rudder_rad,
            step_s,
            state[DECAY],
            autopilot.turning_ability_1_s,
            autopilot.turning_lag_s,
        )
        heading_rad, yaw_rate_rad_s = fixed_gain.correct(
            heading_rad, yaw_rate_rad_s, measured_rad, step_s, state[THETA], autopilot.rate_limit_rad_s
        )
        state[HEADING_RAD], state[YAW_RATE_RAD_S] = heading_rad, yaw_rate_rad_s
    gains = law.Gains(
        setting[K1], setting[K2], autopilot.rudder_limit_rad, autopilot.rate_max_rad_s, autopilot.trim_rad
    )
    limits = rudder_limit.RudderLimits(autopilot.rudder_limit_rad, autopilot.rudder_slew_rad_s, setting[DEADBAND_RAD])
    demand_rad = law.s_surface(gains, wrap_pi(goal_rad - heading_rad), yaw_rate_rad_s)
    state[COMMAND_RAD] = rudder_limit.limit_command(limits, state[COMMAND_RAD], demand_rad, step_s)
    return float(state[COMMAND_RAD])


@compiled
def compass_reading(heading_rad: float) -> float:
    """Return a heading rounded as in the compass sentence, in [0, 2 pi)."""
    return wrap_two_pi(math.floor(heading_rad / RESOLUTION_RAD + 0.5) * RESOLUTION_RAD)


@compiled
def rounded_to_counts(angle_rad: float) -> float:
    """Return an angle rounded to counts of the servo's encoder."""
    return math.floor(angle_rad / COUNT_RAD + 0.5) * COUNT_RAD


@compiled
def closed_loop(
    setting: Floats,
    autopilot: Autopilot,
    task: Task,
    ship: Floats,
    compass_rad: Floats,
    offset_rad: Floats,
    heading_rad: Floats,
    rudder_rad: Floats,
) -> None:
    """Simulate a case; write the hull's heading [rad, unwrapped] and the rudder [rad] at each tick.

    In a tick the autopilot reads compass and servo and then commands the rudder. The servo angle is that of the
    previous tick, as on the boat.
    """
    step_s = task.step_s
    inner_steps = int(ship[3])
    inner_s = step_s / inner_steps
    max_change_rad = autopilot.servo_slew_rad_s * inner_s
    psi = r = angle = measured_rudder_rad = 0.0
    state = np.zeros(AUTOPILOT_STATES)
    start_autopilot(state, setting, autopilot, compass_reading(compass_rad[0]), step_s)
    for tick in range(heading_rad.size):
        heading_rad[tick], rudder_rad[tick] = psi, angle
        goal_rad = task.goals_rad[tick // task.leg_ticks]
        measured_rad = compass_reading(psi + compass_rad[tick])
        command = autopilot_command(
            state, setting, autopilot, tick, goal_rad, measured_rad, measured_rudder_rad, step_s
        )
        measured_rudder_rad = rounded_to_counts(angle)
        target = rounded_to_counts(command)
        for _ in range(inner_steps):
            next_angle = angle + clamp(target - angle, -max_change_rad, max_change_rad)
            psi, r = rk4_step(psi, r, 0.5 * (angle + next_angle), inner_s, ship[0], ship[1], ship[2], offset_rad[tick])
            angle = next_angle


@compiled
def measure(task: Task, heading_rad: Floats, rudder_rad: Floats, results: Floats) -> None:
    """Compute the results of a run; errors are heading minus goal [rad].

    ITAE: mean absolute error, weighted by the time since the goal. RMS and TRAVEL [rad/s]: over the steady parts. MEAN:
    largest mean error of a steady part. OVERSHOOT: the largest of all legs, relative to the step.
    """
    legs = task.goals_rad.size
    results[:] = 0.0
    start_rad = heading_rad[0]
    total_steady_ticks = legs * (task.leg_ticks - task.steady_ticks)
    for leg in range(legs):
        first = leg * task.leg_ticks
        goal_rad = task.goals_rad[leg]
        step_rad = start_rad - goal_rad
        side = 1.0 if step_rad > 0.0 else -1.0
        weighted_error = weight_sum = mean = overshoot_rad = 0.0
        for tick in range(task.leg_ticks):
            error_rad = heading_rad[first + tick] - goal_rad
            weighted_error += tick * abs(error_rad)
            weight_sum += tick
            if tick >= task.steady_ticks:
                results[RMS] += error_rad * error_rad
                mean += error_rad
                results[TRAVEL] += abs(rudder_rad[first + tick] - rudder_rad[first + tick - 1])
            else:
                overshoot_rad = max(overshoot_rad, -side * error_rad)
        results[ITAE] += weighted_error / weight_sum / legs
        mean /= task.leg_ticks - task.steady_ticks
        if abs(mean) > abs(results[MEAN]):
            results[MEAN] = mean
        results[OVERSHOOT] = max(results[OVERSHOOT], overshoot_rad / max(abs(step_rad), 1e-9))
        start_rad = heading_rad[first + task.leg_ticks - 1]
    results[RMS] = math.sqrt(results[RMS] / total_steady_ticks)
    results[TRAVEL] /= total_steady_ticks * task.step_s


@compiled
def run_all(settings: Floats, autopilot: Autopilot, task: Task, seas: Seas, results: Floats) -> None:
    """Compute the results (settings, cases, RESULTS); a setting is k1, k2, tau [s] and deadband [rad]."""
    ticks = task.goals_rad.size * task.leg_ticks
    heading_rad, rudder_rad = np.zeros(ticks), np.zeros(ticks)
    for number in range(settings.shape[0]):
        for case in range(seas.ships.shape[0]):
            closed_loop(
                settings[number],
                autopilot,
                task,
                seas.ships[case],
                seas.compass_rad[case],
                seas.offset_rad[case],
                heading_rad,
                rudder_rad,
            )
            measure(task, heading_rad, rudder_rad, results[number, case])
