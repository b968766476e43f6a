"""A pilot with knowledge that no boat has: its remaining error is the limit for a sea and its sensors.

Its boat is that of hil/ship on the same grid, in the same drawn seas, with the same noise of compass and receiver. A
Kalman filter of the very processes that made the sea, linearised where the boat truly is, estimates heading, yaw rate,
rudder bias, float, waves, and the unknown quantities of the water, the bias and the ship. The optimal regulator of the
K-T model steers by it, with a deadband of the rudder: gain and deadband weigh error against travel.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from firmware_py.common.angles import TWO_PI, clamp, radians, wrap_pi
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step
from hil.lab.compiled import compiled
from hil.lab.twin.devices import FIX_NUMBERS, NORTH_ERROR_M_S
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.drift import TIME_CONSTANT_S
from hil.ship.float_body import transition as float_transition
from hil.ship.waves import DAMPING
from hil.sim.goals import Goal
from hil.sim.truth import Truth

(HEADING, RATE, DRIFT, MEAN, FLOAT, FLOAT_RATE, WAVE, WAVE_RATE, LEEWAY, NORTH, EAST, SPEED) = range(12)
STATES = 12
GRID_S, STEPS_PER_ROW, STEP_S = 0.02, 5, 0.1
LIMIT_RAD, SLEW_RAD, COUNT_RAD = radians(30.0), radians(30.0) * GRID_S, TWO_PI / 4096
COMPASS_VARIANCE = radians(0.3) ** 2 + radians(0.1) ** 2 / 12.0
VELOCITY_VARIANCE = 0.03**2
# Prior standard deviations of the quantities that a boat does not know.
UNKNOWN = {MEAN: radians(4.5), LEEWAY: radians(5.0), NORTH: 0.2, EAST: 0.2, SPEED: 0.4}
EXPECTED = {SPEED: 0.5}
# Variance that they gain in a second where they are assumed to change.
WANDERING = {
    MEAN: 1e-4 * radians(1.0) ** 2,
    LEEWAY: 1e-7,
    NORTH: 5e-7,
    EAST: 5e-7,
    SPEED: 1e-5,
}


class Knowledge(NamedTuple):
    """Known to the pilot: transition, effect of the rudder and noise of a step, initial state, and the truth."""

    transition: Any
    by_rudder: Any
    noise: Any
    first: Any
    first_covariance: Any
    truth: Any  # all constants, in their places
    ability_1_s: float
    lag_s: float
    norrbin_s2: float
    has_float: bool
    follow: tuple[float, float, float, float]
    knows_drift: bool


class Drawn(NamedTuple):
    """What is random about a sea: at each grid step, at each sample of the compass and at each fix."""

    offset_rad: Any
    wave_rad: Any
    compass_deg: Any
    fix_m_s: Any
    compass_phase_s: float
    compass_period_s: float
    fix_phase_s: float
    fix_period_s: float


@compiled
def correct(x, p, shows, innovation, variance):
    """Take a scalar measurement in."""
    cross = p @ shows
    total = shows @ cross + variance
    for i in range(STATES):
        x[i] += cross[i] / total * innovation
        for k in range(STATES):
            p[i, k] -= cross[i] * cross[k] / total


@compiled
def predict(x, p, known, rudder_rad):
    """Predict state and covariance over a step."""
    cubic = known.norrbin_s2 * x[RATE] * x[RATE] * x[RATE] / known.ability_1_s
    x[:] = known.transition @ x + known.by_rudder * (rudder_rad - cubic)
    p[:] = known.transition @ p @ known.transition.T + known.noise


@compiled
def take_heading(x, p, known, message_rad):
    """Take in what the compass says."""
    shows = np.zeros(STATES)
    shows[FLOAT if known.has_float else HEADING] = shows[WAVE] = 1.0
    correct(x, p, shows, wrap_pi(message_rad - shows @ x), COMPASS_VARIANCE)


@compiled
def take_velocity(x, p, known, heading_rad, noise_m_s):
    """Take in what the receiver says of a boat that truly points to heading_rad."""
    truth = known.truth
    for axis in range(2):
        true_rad = heading_rad + truth[LEEWAY] - 0.5 * math.pi * axis
        way_rad, true_m_s = x[HEADING] + x[LEEWAY] - 0.5 * math.pi * axis, truth[SPEED] / math.cos(truth[LEEWAY])
        shows = np.zeros(STATES)
        shows[HEADING] = shows[LEEWAY] = -true_m_s * math.sin(true_rad)
        shows[SPEED], shows[NORTH + axis] = math.cos(true_rad), 1.0
        said_m_s = true_m_s * math.cos(true_rad) + truth[NORTH + axis] + noise_m_s[axis]
        expected_m_s = x[SPEED] / math.cos(x[LEEWAY]) * math.cos(way_rad) + x[NORTH + axis]
        correct(x, p, shows, said_m_s - expected_m_s, VELOCITY_VARIANCE)


@compiled
def steer(x, known, gain, band_rad, goal_rad, command_rad):
    """Return the next command."""
    by_rate_s = (math.sqrt(1.0 + 2.0 * known.ability_1_s * known.lag_s * gain) - 1.0) / known.ability_1_s
    demand_rad = gain * wrap_pi(goal_rad - x[HEADING]) - by_rate_s * x[RATE] + x[DRIFT] + x[MEAN]
    demand_rad = clamp(demand_rad, -LIMIT_RAD, LIMIT_RAD)
    return np.rint(clamp(command_rad, demand_rad - band_rad, demand_rad + band_rad) / COUNT_RAD) * COUNT_RAD


@compiled
def voyage(known, sea, gain, band_rad, goals, rows):
    """Sail a run; fill heading and rudder ten times a second. Ticks and fixes are with the samples of the compass."""
    x, p = known.first.copy(), known.first_covariance.copy()
    psi = r = floating = float_rate = shaft_rad = command_rad = 0.0
    sample = epoch = goal = 0
    for step in range(STEPS_PER_ROW * (rows.shape[1] - 1) + 1):
        offset_rad, now_s = sea.offset_rad[step], step * GRID_S
        if step % STEPS_PER_ROW == 0:
            rows[0, step // STEPS_PER_ROW], rows[1, step // STEPS_PER_ROW] = psi, shaft_rad
        if now_s >= sea.compass_phase_s + sample * sea.compass_period_s:
            while goal + 1 < goals.shape[0] and goals[goal + 1, 0] <= now_s:
                goal += 1
            predict(x, p, known, shaft_rad)
            shown_deg = math.degrees((floating if known.has_float else psi) + sea.wave_rad[step])
            take_heading(x, p, known, math.radians(np.rint((shown_deg + sea.compass_deg[sample]) * 10.0) / 10.0))
            if now_s >= sea.fix_phase_s + epoch * sea.fix_period_s:
                take_velocity(x, p, known, psi, sea.fix_m_s[epoch])
                epoch += 1
            if known.knows_drift:
                x[DRIFT] = offset_rad
            command_rad = steer(x, known, gain, band_rad, goals[goal, 1], command_rad)
            sample += 1
        before_rad, stood_rad = psi, shaft_rad
        shaft_rad += clamp(command_rad - shaft_rad, -SLEW_RAD, SLEW_RAD)
        rudder_rad, bias_rad = 0.5 * (stood_rad + shaft_rad), known.truth[MEAN] + offset_rad
        psi, r = rk4_step(psi, r, rudder_rad, GRID_S, known.ability_1_s, known.lag_s, known.norrbin_s2, bias_rad)
        middle_rad, (f00, f01, f10, f11) = 0.5 * (before_rad + psi), known.follow
        behind_rad, turns_rad_s = floating - middle_rad, float_rate
        floating = middle_rad + f00 * behind_rad + f01 * turns_rad_s
        float_rate = f10 * behind_rad + f11 * turns_rad_s


def processes(scenario, ship):
    """Return transition, effect of the rudder and noise of a step (Van Loan), and the frequency of the waves."""
    omega_rad_s = TWO_PI / scenario.wave_period_s / math.sqrt(1.0 - 2.0 * DAMPING**2)
    size, rudder = STATES + 1, STATES
    f, q = np.zeros((size, size)), np.zeros((size, size))
    f[HEADING, RATE], f[RATE, RATE] = 1.0, -1.0 / ship.turning_lag_s
    for place, sign in ((DRIFT, -1.0), (MEAN, -1.0), (rudder, 1.0)):
        f[RATE, place] = sign * ship.turning_ability_1_s / ship.turning_lag_s
    f[DRIFT, DRIFT] = -1.0 / TIME_CONSTANT_S
    if body := scenario.disturbances.float_body:
        square = body.own_frequency_rad_s**2
        f[FLOAT, FLOAT_RATE], f[FLOAT_RATE, HEADING], f[FLOAT_RATE, FLOAT] = 1.0, square, -square
        f[FLOAT_RATE, FLOAT_RATE] = -2.0 * body.damping * body.own_frequency_rad_s
    f[WAVE, WAVE_RATE], f[WAVE_RATE, WAVE] = 1.0, -(omega_rad_s**2)
    f[WAVE_RATE, WAVE_RATE] = -2.0 * DAMPING * omega_rad_s
    q[DRIFT, DRIFT] = 2.0 * radians(scenario.drift_deg) ** 2 / TIME_CONSTANT_S
    q[WAVE_RATE, WAVE_RATE] = 4.0 * DAMPING * omega_rad_s**3 * radians(scenario.wave_yaw_deg) ** 2
    both = np.block([[-f, q], [np.zeros((size, size)), f.T]])
    exponential = expm(both * STEP_S)
    transition = exponential[size:, size:].T
    noise = transition @ exponential[:size, size:]
    cut = slice(STATES), slice(STATES)
    return transition[cut].copy(), transition[:STATES, STATES].copy(), noise[cut].copy(), omega_rad_s


def knowledge_of(scenario, learns, *, knows_drift, wanders=False):
    """Return the pilot's knowledge of a sea: all but the constants that it learns; the bias from tick to tick, too.

    `wanders`: it does not know that they are constants.
    """
    ship, disturbances = OCEAN_RAMBLER.at_speed(scenario.speed_m_s), scenario.disturbances
    transition, by_rudder, noise, omega_rad_s = processes(scenario, ship)
    truth, spreads, toward_rad = np.zeros(STATES), np.zeros(STATES), radians(scenario.current_toward_deg)
    truth[[MEAN, SPEED]] = radians(scenario.bias_deg), scenario.speed_m_s
    truth[LEEWAY] = radians(disturbances.leeway.body_deg) if disturbances.leeway else 0.0
    truth[NORTH], truth[EAST] = (scenario.current_m_s * part(toward_rad) for part in (math.cos, math.sin))
    first, wave_rad = truth.copy(), radians(scenario.wave_yaw_deg)
    for place in learns:
        first[place], spreads[place] = EXPECTED.get(place, 0.0), UNKNOWN[place]
    spreads[[RATE, FLOAT_RATE, DRIFT]] = radians(1.0), radians(1.0), radians(scenario.drift_deg)
    spreads[[WAVE, WAVE_RATE]] = wave_rad, wave_rad * omega_rad_s
    covariance = np.diag(spreads**2)
    covariance[HEADING : FLOAT + 1 : FLOAT, HEADING : FLOAT + 1 : FLOAT] = radians(30.0) ** 2
    if wanders:
        for place in learns:
            noise[place, place] += WANDERING[place] * STEP_S
    if knows_drift:
        noise[: DRIFT + 1] = noise[:, : DRIFT + 1] = covariance[DRIFT, DRIFT] = 0.0
    body, follow = disturbances.float_body, ((0.0, 0.0), (0.0, 0.0))
    if body is not None:
        follow = float_transition(body.own_frequency_rad_s, body.damping, GRID_S)
    numbers = (ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2)
    arrays = (transition, by_rudder, noise, first, covariance, truth)
    return Knowledge(*arrays, *numbers, body is not None, (*follow[0], *follow[1]), knows_drift)


def drawn_of(scenario, seed, seconds):
    """Return the random processes of a sea for a seed."""
    ship, series, devices = drawn(scenario, seed, seconds)
    steps = int(seconds / GRID_S) + 2
    offset_rad = series[ship.offset_at :][:steps]
    fixes = series[devices.fix_at :][: FIX_NUMBERS * int(seconds)].reshape(-1, FIX_NUMBERS)
    fix_m_s = fixes[:, NORTH_ERROR_M_S : NORTH_ERROR_M_S + 2].copy()
    compass_deg, wave_rad = series[devices.compass_at :][: 10 * steps], series[ship.yaw_at :][: 2 * steps : 2].copy()
    when = (devices.compass_phase_s, devices.compass_period_s, devices.fix_phase_s, devices.fix_period_s)
    return Drawn(offset_rad, wave_rad, compass_deg, fix_m_s, *when)


def sail(known: Knowledge, sea: Drawn, law: tuple[float, float], goals: tuple[Goal, ...], seconds: float) -> Truth:
    """Sail a run by a law, gain and deadband [rad], and return its truth."""
    rows = np.zeros((2, round(10.0 * seconds) + 1))
    voyage(known, sea, *law, np.array([(goal.t_s, goal.heading_rad) for goal in goals]), rows)
    time_s, nothing, goal_rad = np.arange(rows.shape[1]) / 10.0, np.zeros(rows.shape[1]), np.full(rows.shape[1], np.nan)
    for goal in goals:
        goal_rad[time_s >= goal.t_s] = goal.heading_rad
    return Truth(time_s, rows[0], nothing, nothing, rows[1], nothing, goal_rad, nothing, nothing, nothing)
