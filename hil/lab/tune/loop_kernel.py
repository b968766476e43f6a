"""Closed loop of ship and autopilot, compiled, for the trial runs of the tuner.

The ship is the K-T equation, the autopilot is made of the firmware's own functions (hil/lab/numeric_core.py): observer,
S-surface and rudder limits. It leaves out what a trial run never has: samples that are late, missing or not numbers.
tests/unit/hil/lab/tune/test_loop_kernel.py holds the loop against the firmware's tick by tick, to the last bit, and
tests/process/test_tune.py against the autopilot on ptys.

To follow a change of the firmware's control: keep its order of steps in `pilot_begins` and `pilot_steers`, and in a row
of `state` what lasts from tick to tick; name what is to be searched in cases.pilot_of, trials.Setting and
search.BOUNDS.
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

COUNT_RAD = 2.0 * math.pi / 4096.0  # the servo's encoder: 0.088 deg
RESOLUTION_RAD = math.pi / 1800.0  # the compass prints 0.1 deg

# Columns of the results: of a case, worst or mean over its legs as the name says.
ITAE, RMS, MEAN, TRAVEL, OVERSHOOT = range(5)
RESULTS = 5


# Columns of a setting, and of what the autopilot keeps from tick to tick.
K1, K2, TAU_S, DEADBAND_RAD = range(4)
HEADING_RAD, YAW_RATE_RAD_S, COMMAND_RAD, THETA, DECAY = range(5)
PILOT_STATES = 5


class Pilot(NamedTuple):
    """Settings of the autopilot; the searched parameters come separately.

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


class Task(NamedTuple):
    """What is steered: goals [rad], one leg after the other, each of the same number of ticks."""

    goals_rad: Floats
    leg_ticks: int
    steady_ticks: int
    step_s: float


class Seas(NamedTuple):
    """The ships and their disturbances, a row for each case.

    ships: K, T, alpha and how many Runge-Kutta steps a tick takes. compass_rad: what waves and noise
    add to the compass at each tick. offset_rad: the rudder angle at which the boat runs straight, at each tick.
    """

    ships: Floats
    compass_rad: Floats
    offset_rad: Floats


@compiled
def pilot_begins(state: Floats, setting: Floats, pilot: Pilot, measured_rad: float, step_s: float) -> None:
    """Fill the autopilot's state at its first sample, with the rudder amidships."""
    state[HEADING_RAD], state[YAW_RATE_RAD_S], state[COMMAND_RAD] = measured_rad, 0.0, 0.0
    state[THETA], state[DECAY] = math.exp(-step_s / setting[TAU_S]), decay_over(step_s, pilot.turning_lag_s)


@compiled
def pilot_steers(
    state: Floats,
    setting: Floats,
    pilot: Pilot,
    tick: int,
    goal_rad: float,
    measured_rad: float,
    rudder_rad: float,
    step_s: float,
) -> float:
    """Return the rudder command of a tick from compass and servo; the first sample is in the state already."""
    heading_rad, yaw_rate_rad_s = state[HEADING_RAD], state[YAW_RATE_RAD_S]
    if tick > 0:
        heading_rad, yaw_rate_rad_s = fixed_gain.predict(
            heading_rad,
            yaw_rate_rad_s,
            rudder_rad,
            step_s,
            state[DECAY],
            pilot.turning_ability_1_s,
            pilot.turning_lag_s,
        )
        heading_rad, yaw_rate_rad_s = fixed_gain.correct(
            heading_rad, yaw_rate_rad_s, measured_rad, step_s, state[THETA], pilot.rate_limit_rad_s
        )
        state[HEADING_RAD], state[YAW_RATE_RAD_S] = heading_rad, yaw_rate_rad_s
    gains = law.Gains(setting[K1], setting[K2], pilot.rudder_limit_rad, pilot.rate_max_rad_s, pilot.trim_rad)
    limits = rudder_limit.RudderLimits(pilot.rudder_limit_rad, pilot.rudder_slew_rad_s, setting[DEADBAND_RAD])
    demand_rad = law.s_surface(gains, wrap_pi(goal_rad - heading_rad), yaw_rate_rad_s)
    state[COMMAND_RAD] = rudder_limit.limited_command(limits, state[COMMAND_RAD], demand_rad, step_s)
    return float(state[COMMAND_RAD])


@compiled
def compass_reading(heading_rad: float) -> float:
    """Return a heading as the compass prints it, in [0, 2 pi)."""
    return wrap_two_pi(math.floor(heading_rad / RESOLUTION_RAD + 0.5) * RESOLUTION_RAD)


@compiled
def counted(angle_rad: float) -> float:
    """Return an angle as the servo's encoder counts it."""
    return math.floor(angle_rad / COUNT_RAD + 0.5) * COUNT_RAD


@compiled
def closed_loop(
    setting: Floats,
    pilot: Pilot,
    task: Task,
    ship: Floats,
    compass_rad: Floats,
    offset_rad: Floats,
    heading_rad: Floats,
    rudder_rad: Floats,
) -> None:
    """Sail a case with a setting; fill the hull's heading [rad, unwrapped] and the rudder [rad] at each tick.

    In a tick the autopilot reads compass and servo, then moves the rudder; the ship sails on
    until the next. The servo's answer is that of the tick before, as on the boat.
    """
    step_s = task.step_s
    inner_steps = int(ship[3])
    inner_s = step_s / inner_steps
    reach_rad = pilot.servo_slew_rad_s * inner_s
    psi = r = angle = counted_rad = 0.0
    state = np.zeros(PILOT_STATES)
    pilot_begins(state, setting, pilot, compass_reading(compass_rad[0]), step_s)
    for tick in range(heading_rad.size):
        heading_rad[tick], rudder_rad[tick] = psi, angle
        goal_rad = task.goals_rad[tick // task.leg_ticks]
        measured_rad = compass_reading(psi + compass_rad[tick])
        command = pilot_steers(state, setting, pilot, tick, goal_rad, measured_rad, counted_rad, step_s)
        counted_rad = counted(angle)
        target = counted(command)
        for _ in range(inner_steps):
            after = angle + clamp(target - angle, -reach_rad, reach_rad)
            psi, r = rk4_step(psi, r, 0.5 * (angle + after), inner_s, ship[0], ship[1], ship[2], offset_rad[tick])
            angle = after


@compiled
def measure(task: Task, heading_rad: Floats, rudder_rad: Floats, results: Floats) -> None:
    """Fill the results of a run, headings less goal [rad].

    ITAE is the mean absolute error weighted by the time since the goal was given, RMS and TRAVEL
    [rad/s] are of the steady parts, MEAN is the largest mean error of a steady part,
    OVERSHOOT the largest of the legs' in parts of the step.
    """
    legs = task.goals_rad.size
    results[:] = 0.0
    start_rad = heading_rad[0]
    steady = legs * (task.leg_ticks - task.steady_ticks)
    for leg in range(legs):
        first = leg * task.leg_ticks
        goal_rad = task.goals_rad[leg]
        way_rad = start_rad - goal_rad
        side = 1.0 if way_rad > 0.0 else -1.0
        weighted = weights = mean = beyond = 0.0
        for tick in range(task.leg_ticks):
            error_rad = heading_rad[first + tick] - goal_rad
            weighted += tick * abs(error_rad)
            weights += tick
            if tick >= task.steady_ticks:
                results[RMS] += error_rad * error_rad
                mean += error_rad
                results[TRAVEL] += abs(rudder_rad[first + tick] - rudder_rad[first + tick - 1])
            else:
                beyond = max(beyond, -side * error_rad)
        results[ITAE] += weighted / weights / legs
        mean /= task.leg_ticks - task.steady_ticks
        if abs(mean) > abs(results[MEAN]):
            results[MEAN] = mean
        results[OVERSHOOT] = max(results[OVERSHOOT], beyond / max(abs(way_rad), 1e-9))
        start_rad = heading_rad[first + task.leg_ticks - 1]
    results[RMS] = math.sqrt(results[RMS] / steady)
    results[TRAVEL] /= steady * task.step_s


@compiled
def sail_all(settings: Floats, pilot: Pilot, task: Task, seas: Seas, results: Floats) -> None:
    """Fill the results (settings, cases, RESULTS) of every setting (k1, k2, tau [s], deadband [rad]) in every case."""
    ticks = task.goals_rad.size * task.leg_ticks
    heading_rad, rudder_rad = np.zeros(ticks), np.zeros(ticks)
    for number in range(settings.shape[0]):
        for case in range(seas.ships.shape[0]):
            closed_loop(
                settings[number],
                pilot,
                task,
                seas.ships[case],
                seas.compass_rad[case],
                seas.offset_rad[case],
                heading_rad,
                rudder_rad,
            )
            measure(task, heading_rad, rudder_rad, results[number, case])
