"""Lower limit of the heading error of a linear autopilot that knows the scenario completely.

It is that of the linear-quadratic-Gaussian regulator of the K-T equation in the waves and drift of a scenario, which
knows the model, the speed, the waves, the drift and the mean bias. Its cost is the square of the error plus a weight
times the square of the rudder rate. Error and rudder travel follow from Riccati and Lyapunov equations, without a run.
The receiver is the emulated one, with a velocity error of 0.03 m/s in each axis every second and a known current.
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
COMPASS_VARIANCE = radians(0.3) ** 2 + radians(0.1) ** 2 / 12.0  # [rad^2]: noise of 0.3 deg, resolution of 0.1 deg
VELOCITY_NOISE_M_S = 0.03
MIN_INTENSITY = 1e-14  # makes the equations solvable without waves or drift
TRAVEL_WEIGHTS = tuple(10.0 ** (0.1 * n) for n in range(-40, 41))  # of (rudder rate)^2 relative to error^2 [s^2]


@dataclass(frozen=True, slots=True)
class Limit:
    """A point of the optimal trade-off between error and rudder travel."""

    rms_deg: float
    travel_deg_per_h: float


def is_exact_for(scenario: Scenario) -> bool:
    """Return whether the scenario has no disturbances other than waves, drift and a steady current."""
    return not scenario.gust_deg and not scenario.orbital_m_s and scenario.disturbances == NO_DISTURBANCES


def limits(scenario: Scenario, model: KtModel, *, receiver: bool) -> list[Limit]:
    """Return the optimal trade-off between error and rudder travel, from large to small travel.

    `receiver`: the autopilot also measures the velocity.
    """
    transition, rudder_input, noise = _plant(scenario, model)
    measured, variances = _sensors(scenario, receiver=receiver)
    prior = solve_discrete_are(transition.T, measured.T, noise, variances)
    gain = prior @ measured.T @ np.linalg.inv(measured @ prior @ measured.T + variances)
    posterior = prior - gain @ measured @ prior
    # The rudder angle is a state of the ship; the waves affect only the compass.
    ship = np.zeros((4, 4))
    ship[:3, :3], ship[:3, 3], ship[3, 3] = transition[:3, :3], rudder_input[:3], 1.0
    rudder_change = np.array([[0.0], [0.0], [0.0], [1.0]])
    weight = np.diag([1.0, 0.0, 0.0, 1e-9])
    update_covariance = np.zeros((4, 4))
    update_covariance[:3, :3] = (prior - posterior)[:3, :3]
    return [
        _point(ship, rudder_change, weight, travel_weight, update_covariance, posterior[0, 0])
        for travel_weight in TRAVEL_WEIGHTS
    ]


def _point(
    ship: Array,
    rudder_change: Array,
    weight: Array,
    travel_weight: float,
    update_covariance: Array,
    error_variance: float,
) -> Limit:
    cost = np.array([[travel_weight / STEP_S**2]])
    riccati = solve_discrete_are(ship, rudder_change, weight, cost)
    gain = np.linalg.solve(cost + rudder_change.T @ riccati @ rudder_change, rudder_change.T @ riccati @ ship)
    covariance = solve_discrete_lyapunov(ship - rudder_change @ gain, update_covariance)
    rate_rad_s = math.sqrt(float((gain @ covariance @ gain.T)[0, 0])) / STEP_S
    # The mean absolute value of a normal variable is sqrt(2 / pi) of its standard deviation.
    return Limit(
        degrees(math.sqrt(covariance[0, 0] + error_variance)), degrees(rate_rad_s) * math.sqrt(2.0 / math.pi) * 3600.0
    )


def at_travel(points: list[Limit], travel_deg_per_h: float) -> float:
    """Return the rms error [deg] of the optimal trade-off at a rudder travel, by interpolation."""
    ordered = sorted(points, key=lambda point: point.travel_deg_per_h)
    travels = [math.log(point.travel_deg_per_h + 1e-9) for point in ordered]
    return float(np.interp(math.log(travel_deg_per_h), travels, [point.rms_deg for point in ordered]))


def _plant(scenario: Scenario, model: KtModel) -> tuple[Array, Array, Array]:
    """Return transition, rudder input and noise of one step for the states heading, rate, drift, wave and wave rate."""
    ship = model.at_speed(scenario.speed_m_s)
    ability, lag = ship.turning_ability_1_s, ship.turning_lag_s
    period_s = scenario.wave_period_s or 5.0  # any period for a scenario without waves
    omega = 2.0 * math.pi / period_s / math.sqrt(1.0 - 2.0 * DAMPING**2)
    f, q = np.zeros((6, 6)), np.zeros((6, 6))
    f[0, 1], f[1, 1], f[1, 2], f[1, 5] = 1.0, -1.0 / lag, -ability / lag, ability / lag
    f[2, 2] = -1.0 / TIME_CONSTANT_S
    f[3, 4], f[4, 3], f[4, 4] = 1.0, -omega * omega, -2.0 * DAMPING * omega
    q[2, 2] = 2.0 * radians(scenario.drift_deg) ** 2 / TIME_CONSTANT_S + MIN_INTENSITY
    q[4, 4] = 4.0 * DAMPING * omega**3 * radians(scenario.wave_yaw_deg) ** 2 + MIN_INTENSITY
    # Van Loan's method: transition and noise of a step from one matrix exponential.
    van_loan = np.zeros((12, 12))
    van_loan[:6, :6], van_loan[:6, 6:], van_loan[6:, 6:] = -f, q, f.T
    exponential = expm(van_loan * STEP_S)
    transition = exponential[6:, 6:].T
    noise = transition @ exponential[:6, 6:]
    return transition[:5, :5], transition[:5, 5], noise[:5, :5]


def _sensors(scenario: Scenario, *, receiver: bool) -> tuple[Array, Array]:
    measured, variances = [[1.0, 0.0, 0.0, 1.0, 0.0]], [COMPASS_VARIANCE]
    if receiver:
        # A course every second contains as much information as a course at each tick with ten times the variance.
        measured.append([1.0, 0.0, 0.0, 0.0, 0.0])
        variances.append((VELOCITY_NOISE_M_S / scenario.speed_m_s) ** 2 / STEP_S)
    return np.array(measured), np.diag(variances)
