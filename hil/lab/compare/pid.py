"""A tuned PID controller with filtered derivative, in a compiled loop: what a good ordinary autopilot reaches.

It is told its heading by the same compass (noise 0.3 deg, resolution 0.1 deg) in the same waves and with
the same wandering of the rudder bias, seed by seed, as `rambler-hil run` makes them; only the noise of
the compass is drawn anew. Its five numbers were found by search over the four seas of physics.md at
once, on other seeds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import TWO_PI, clamp, radians, wrap_pi
from firmware_py.model.kt import KtModel, rk4_step
from hil.lab.compiled import compiled
from hil.lab.tune.loop_kernel import compass_reading, counted
from hil.ship.drift import RudderDrift
from hil.ship.gusts import Gusts
from hil.ship.hull import GRID_S
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.scenarios import Scenario
from hil.ship.waves import WaveYaw
from hil.sim.goals import Goal
from hil.sim.truth import Array, Truth

STEP_S = 0.1
STEPS_PER_TICK = round(STEP_S / GRID_S)
COMPASS_NOISE_RAD = radians(0.3)
LIMIT_RAD = radians(30.0)
SLEW_RAD_S = radians(30.0)


class Pid(NamedTuple):
    """Gains on error [rad/rad], its integral [1/s] and its rate [s]; filters of heading and rate [s]."""

    proportional: float
    integral_1_s: float
    derivative_s: float
    heading_filter_s: float
    rate_filter_s: float


TUNED = Pid(1.2, 0.0226, 1.18, 4.6, 8.0)


@compiled
def pid_loop(
    pid: Pid,
    ship: tuple[float, float, float],
    goal_rad: Array,
    compass_rad: Array,
    offset_rad: Array,
    heading_rad: Array,
    rudder_rad: Array,
) -> None:
    """Steer; compass_rad and offset_rad are what is added to heading and rudder bias at each tick, the last two filled.

    The integral stands still while the rudder is at its limit and the error would drive it farther.
    """
    kp, ki, kd, heading_filter_s, rate_filter_s = pid
    psi = r = angle = 0.0
    seen = compass_reading(compass_rad[0])
    rate = total = 0.0
    near = 1.0 - math.exp(-STEP_S / heading_filter_s)
    quick = 1.0 - math.exp(-STEP_S / rate_filter_s)
    reach_rad = SLEW_RAD_S * GRID_S
    for tick in range(heading_rad.size):
        heading_rad[tick], rudder_rad[tick] = psi, angle
        moved = near * wrap_pi(compass_reading(psi + compass_rad[tick]) - seen)
        seen = wrap_pi(seen + moved)
        rate += quick * (moved / STEP_S - rate)
        error = wrap_pi(goal_rad[tick] - seen)
        wanted = kp * error + total - kd * rate
        command = clamp(wanted, -LIMIT_RAD, LIMIT_RAD)
        if wanted == command or wanted * error < 0.0:
            total = clamp(total + ki * error * STEP_S, -LIMIT_RAD, LIMIT_RAD)
        target = counted(command)
        for _ in range(STEPS_PER_TICK):
            after = angle + clamp(target - angle, -reach_rad, reach_rad)
            psi, r = rk4_step(psi, r, 0.5 * (angle + after), GRID_S, ship[0], ship[1], ship[2], offset_rad[tick])
            angle = after


def sea_of(scenario: Scenario, seed: int, ticks: int) -> tuple[Array, Array]:
    """Return wave yaw with compass noise, and rudder bias, at each tick: those of the run of that seed."""
    numbers = NormalNumbers(generator(seed, Stream.WAVES))
    gusts = Gusts(radians(scenario.gust_deg), GRID_S, generator(seed, Stream.GUSTS))
    waves = WaveYaw(radians(scenario.wave_yaw_deg), scenario.wave_period_s, GRID_S, numbers)
    drift = RudderDrift(radians(scenario.drift_deg), GRID_S, NormalNumbers(generator(seed, Stream.DRIFT)))
    yaw_rad, offset_rad = np.zeros(ticks), np.zeros(ticks)
    for tick in range(ticks):
        yaw_rad[tick] = waves.angle_rad(0.0)
        offset_rad[tick] = radians(scenario.bias_deg) + drift.angle_rad + gusts.angle_rad
        for _ in range(STEPS_PER_TICK):
            waves.step()
            drift.step()
            gusts.step()
    noise_rad = COMPASS_NOISE_RAD * generator(seed, Stream.COMPASS).standard_normal(ticks)
    return yaw_rad + noise_rad, offset_rad


def sail(scenario: Scenario, seed: int, goals: tuple[Goal, ...], seconds: float, model: KtModel, pid: Pid) -> Truth:
    """Steer a scenario's task and return what happened, as a run's truth."""
    ticks = round(seconds / STEP_S) + 1
    time_s: Array = STEP_S * np.arange(ticks, dtype=np.float64)
    goal_rad = np.zeros(ticks)
    for goal in goals:
        goal_rad[time_s >= goal.t_s - 1e-9] = goal.heading_rad
    compass_rad, offset_rad = sea_of(scenario, seed, ticks)
    ship = model.at_speed(scenario.speed_m_s)
    heading_rad, rudder_rad = np.zeros(ticks), np.zeros(ticks)
    numbers = (ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2)
    pid_loop(pid, numbers, goal_rad, compass_rad, offset_rad, heading_rad, rudder_rad)
    # The goal on the turn nearest to the heading when it was given, as in a run's truth.
    starts = np.flatnonzero(np.diff(goal_rad, prepend=np.nan) != 0.0)
    for first, last in zip(starts, [*starts[1:], ticks], strict=True):
        goal_rad[first:last] += TWO_PI * np.round((heading_rad[first] - goal_rad[first]) / TWO_PI)
    nothing = np.zeros(ticks)
    return Truth(
        time_s,
        heading_rad,
        heading_rad + compass_rad,
        np.asarray(np.gradient(heading_rad, STEP_S), np.float64),
        rudder_rad,
        rudder_rad,
        goal_rad,
        nothing,
        nothing,
        np.full(ticks, scenario.speed_m_s),
    )
