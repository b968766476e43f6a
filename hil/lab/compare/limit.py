"""Lower limit of the heading error of any linear autopilot with full knowledge of the scenario.

The linear-quadratic-Gaussian regulator of the K-T equation in the waves and drift of a scenario. It knows the model,
the speed, period and spread of the waves, spread and time constant of the drift, and the mean bias; its cost weights
the square of the rudder rate. Error and rudder travel follow from Riccati and Lyapunov equations, without a run. The
receiver is the emulated one: a velocity error of 0.03 m/s in each axis every second, with known current.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov

from firmware_py.common.angles import degrees, radians
from firmware_py.model.kt import KtModel
from hil.ship.disturbances import NO_DISTURBANCES
from hil.ship.drift import TIME_CONSTANT_S
from hil.ship.scenarios import Scenario
from hil.ship.waves import DAMPING
from hil.sim.truth import Array

STEP_S = 0.1
COMPASS_VARIANCE = radians(0.3) ** 2 + radians(0.1) ** 2 / 12.0
VELOCITY_NOISE_M_S = 0.03
MIN_INTENSITY = 1e-14  # keeps the equations solvable without waves or without drift
TRAVEL_WEIGHTS = tuple(10.0 ** (0.1 * n) for n in range(-40, 41))  # of (rudder rate)^2 relative to error^2 [s^2]


@dataclass(frozen=True, slots=True)
class Limit:
    """A point of the optimal trade-off."""

    rms_deg: float
    travel_deg_per_h: float


def is_exact_for(scenario: Scenario) -> bool:
    """Return whether the scenario has only waves, drift and a steady current, without other disturbances."""
    return not scenario.gust_deg and not scenario.orbital_m_s and scenario.disturbances == NO_DISTURBANCES


def limits(scenario: Scenario, model: KtModel, *, receiver: bool) -> list[Limit]:
    """Return the trade-off between error and rudder travel, from much travel to little."""
    transition, push, noise = _plant(scenario, model)
    seen, variances = _sensors(scenario, receiver=receiver)
    before = solve_discrete_are(transition.T, seen.T, noise, variances)
    gain = before @ seen.T @ np.linalg.inv(seen @ before @ seen.T + variances)
    after = before - gain @ seen @ before
    # The ship with the rudder angle as a state; the waves affect the compass only.
    ship = np.zeros((4, 4))
    ship[:3, :3], ship[:3, 3], ship[3, 3] = transition[:3, :3], push[:3], 1.0
    moved = np.array([[0.0], [0.0], [0.0], [1.0]])
    weight = np.diag([1.0, 0.0, 0.0, 1e-9])
    learned = np.zeros((4, 4))
    learned[:3, :3] = (before - after)[:3, :3]
    return [_point(ship, moved, weight, price, learned, after[0, 0]) for price in TRAVEL_WEIGHTS]


def _point(ship: Array, moved: Array, weight: Array, price: float, learned: Array, unknown: float) -> Limit:
    cost = np.array([[price / STEP_S**2]])
    value = solve_discrete_are(ship, moved, weight, cost)
    gain = np.linalg.solve(cost + moved.T @ value @ moved, moved.T @ value @ ship)
    spread = solve_discrete_lyapunov(ship - moved @ gain, learned)
    rate_rad_s = math.sqrt(float((gain @ spread @ gain.T)[0, 0])) / STEP_S
    # The mean absolute value of a normal variable is sqrt(2 / pi) of its standard deviation.
    return Limit(degrees(math.sqrt(spread[0, 0] + unknown)), degrees(rate_rad_s) * math.sqrt(2.0 / math.pi) * 3600.0)


def at_travel(points: list[Limit], travel_deg_per_h: float) -> float:
    """Return the rms error [deg] of the optimal trade-off at a rudder travel."""
    ordered = sorted(points, key=lambda point: point.travel_deg_per_h)
    travels = [math.log(point.travel_deg_per_h + 1e-9) for point in ordered]
    return float(np.interp(math.log(travel_deg_per_h), travels, [point.rms_deg for point in ordered]))


def _plant(scenario: Scenario, model: KtModel) -> tuple[Array, Array, Array]:
    """Return transition, rudder input and noise of a step for heading, rate, drift, wave and wave rate."""
    ship = model.at_speed(scenario.speed_m_s)
    ability, lag = ship.turning_ability_1_s, ship.turning_lag_s
    period_s = scenario.wave_period_s or 5.0
    omega = 2.0 * math.pi / period_s / math.sqrt(1.0 - 2.0 * DAMPING**2)
    f, q = np.zeros((6, 6)), np.zeros((6, 6))
    f[0, 1], f[1, 1], f[1, 2], f[1, 5] = 1.0, -1.0 / lag, -ability / lag, ability / lag
    f[2, 2] = -1.0 / TIME_CONSTANT_S
    f[3, 4], f[4, 3], f[4, 4] = 1.0, -omega * omega, -2.0 * DAMPING * omega
    q[2, 2] = 2.0 * radians(scenario.drift_deg) ** 2 / TIME_CONSTANT_S + MIN_INTENSITY
    q[4, 4] = 4.0 * DAMPING * omega**3 * radians(scenario.wave_yaw_deg) ** 2 + MIN_INTENSITY
    # Van Loan: transition and noise of a step from one matrix exponential.
    both = np.zeros((12, 12))
    both[:6, :6], both[:6, 6:], both[6:, 6:] = -f, q, f.T
    exponential = expm(both * STEP_S)
    transition = exponential[6:, 6:].T
    noise = transition @ exponential[:6, 6:]
    return transition[:5, :5], transition[:5, 5], noise[:5, :5]


def _sensors(scenario: Scenario, *, receiver: bool) -> tuple[Array, Array]:
    seen, variances = [[1.0, 0.0, 0.0, 1.0, 0.0]], [COMPASS_VARIANCE]
    if receiver:
        # A course each second has the information of one with ten times the variance at each tick.
        seen.append([1.0, 0.0, 0.0, 0.0, 0.0])
        variances.append((VELOCITY_NOISE_M_S / scenario.speed_m_s) ** 2 / STEP_S)
    return np.array(seen), np.diag(variances)
