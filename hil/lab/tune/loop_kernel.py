"""The closed loop of ship and autopilot, compiled: thousands of trial runs in the time that one takes otherwise.

The ship is the K-T equation of firmware_py/model/kt.py; the autopilot is made of the twins in
hil/lab/tune/twins.py. The whole loop is held against the firmware's own parts, to the last bit, by
tests/unit/hil/lab/tune/test_loop_kernel.py, and against the real autopilot on ptys by tests/process/test_tune.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import rk4_step
from hil.lab.compiled import compiled
from hil.lab.tune.twins import PILOT_STATES, Pilot, clamp, pilot_begins, pilot_steers, wrap_two_pi

Floats = NDArray[np.float64]

COUNT_RAD = 2.0 * math.pi / 4096.0  # the servo's encoder: 0.088 deg
RESOLUTION_RAD = math.pi / 1800.0  # the compass prints 0.1 deg

# Columns of the results: of a case, worst or mean over its legs as the name says.
ITAE, RMS, MEAN, TRAVEL, OVERSHOOT = range(5)
RESULTS = 5


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
