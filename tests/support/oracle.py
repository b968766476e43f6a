"""Controller with full knowledge of the simulation: its error is the limit for a sea and its sensors.

The boat is that of hil/ship with the same grid, drawn seas, and noise of compass and receiver. A Kalman filter with the
processes of the simulation, linearised at the true state, estimates heading, yaw rate, rudder bias, float, waves, and
the unknown quantities of water, bias and ship. The optimal regulator of the K-T model steers by it, with a deadband;
gain and deadband determine the weight of error and rudder travel.
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
# Of the rudder: limit, largest change in a grid step, and resolution.
LIMIT_RAD, SLEW_RAD, COUNT_RAD = radians(30.0), radians(30.0) * GRID_S, TWO_PI / 4096
COMPASS_VARIANCE = radians(0.3) ** 2 + radians(0.1) ** 2 / 12.0  # [rad^2]: noise and resolution
VELOCITY_VARIANCE = 0.03**2  # [(m/s)^2]
# Prior standard deviations of the quantities that a boat does not know.
UNKNOWN = {MEAN: radians(4.5), LEEWAY: radians(5.0), NORTH: 0.2, EAST: 0.2, SPEED: 0.4}
EXPECTED = {SPEED: 0.5}
# Growth of their variance per second, if they are assumed to change.
RANDOM_WALKS = {
    MEAN: 1e-4 * radians(1.0) ** 2,
    LEEWAY: 1e-7,
    NORTH: 5e-7,
    EAST: 5e-7,
    SPEED: 1e-5,
}


class Knowledge(NamedTuple):
    """Knowledge of the controller: transition, rudder gain and noise of a step, initial state, and true constants."""

    transition: Any
    rudder_gain: Any
    noise: Any
    first: Any
    first_covariance: Any
    truth: Any  # constants, at the indices of the state
    ability_1_s: float
    lag_s: float
    norrbin_s2: float
    has_float: bool
    float_step: tuple[float, float, float, float]  # transition of the float in a grid step
    knows_drift: bool


class SeaDraws(NamedTuple):
    """Random values of a sea: for each grid step, each sample of the compass and each fix."""

    offset_rad: Any
    wave_rad: Any
    compass_deg: Any
    fix_m_s: Any
    compass_phase_s: float
    compass_period_s: float
    fix_phase_s: float
    fix_period_s: float


@compiled
def correct(x, p, measurement, innovation, variance):
    """Update state and covariance with a scalar measurement, in place."""
    cross = p @ measurement
    innovation_variance = measurement @ cross + variance
    for i in range(STATES):
        x[i] += cross[i] / innovation_variance * innovation
        for k in range(STATES):
            p[i, k] -= cross[i] * cross[k] / innovation_variance


@compiled
def predict(x, p, known, rudder_rad):
    """Predict state and covariance over a step, in place."""
    cubic = known.norrbin_s2 * x[RATE] * x[RATE] * x[RATE] / known.ability_1_s
    x[:] = known.transition @ x + known.rudder_gain * (rudder_rad - cubic)
    p[:] = known.transition @ p @ known.transition.T + known.noise


@compiled
def take_heading(x, p, known, message_rad):
    """Update state and covariance with a heading of the compass, in place."""
    measurement = np.zeros(STATES)
    measurement[FLOAT if known.has_float else HEADING] = measurement[WAVE] = 1.0
    correct(x, p, measurement, wrap_pi(message_rad - measurement @ x), COMPASS_VARIANCE)


@compiled
def take_velocity(x, p, known, heading_rad, noise_m_s):
    """Update state and covariance with a velocity of the receiver, at the true heading."""
    truth = known.truth
    for axis in range(2):
        true_rad = heading_rad + truth[LEEWAY] - 0.5 * math.pi * axis
        course_rad, true_m_s = x[HEADING] + x[LEEWAY] - 0.5 * math.pi * axis, truth[SPEED] / math.cos(truth[LEEWAY])
        measurement = np.zeros(STATES)
        measurement[HEADING] = measurement[LEEWAY] = -true_m_s * math.sin(true_rad)
        measurement[SPEED], measurement[NORTH + axis] = math.cos(true_rad), 1.0
        measured_m_s = true_m_s * math.cos(true_rad) + truth[NORTH + axis] + noise_m_s[axis]
        expected_m_s = x[SPEED] / math.cos(x[LEEWAY]) * math.cos(course_rad) + x[NORTH + axis]
        correct(x, p, measurement, measured_m_s - expected_m_s, VELOCITY_VARIANCE)


@compiled
def steer(x, known, gain, deadband_rad, goal_rad, command_rad):
    """Return the next rudder command."""
    rate_gain_s = (math.sqrt(1.0 + 2.0 * known.ability_1_s * known.lag_s * gain) - 1.0) / known.ability_1_s
    demand_rad = gain * wrap_pi(goal_rad - x[HEADING]) - rate_gain_s * x[RATE] + x[DRIFT] + x[MEAN]
    demand_rad = clamp(demand_rad, -LIMIT_RAD, LIMIT_RAD)
    return np.rint(clamp(command_rad, demand_rad - deadband_rad, demand_rad + deadband_rad) / COUNT_RAD) * COUNT_RAD


@compiled
def voyage(known, sea, gain, deadband_rad, goals, rows):
    """Simulate a run; fill heading and rudder at 10 Hz. Ticks and fixes are at the samples of the compass."""
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
            compass_deg = math.degrees((floating if known.has_float else psi) + sea.wave_rad[step])
            take_heading(x, p, known, math.radians(np.rint((compass_deg + sea.compass_deg[sample]) * 10.0) / 10.0))
            if now_s >= sea.fix_phase_s + epoch * sea.fix_period_s:
                take_velocity(x, p, known, psi, sea.fix_m_s[epoch])
                epoch += 1
            if known.knows_drift:
                x[DRIFT] = offset_rad
            command_rad = steer(x, known, gain, deadband_rad, goals[goal, 1], command_rad)
            sample += 1
        previous_rad, previous_shaft_rad = psi, shaft_rad
        shaft_rad += clamp(command_rad - shaft_rad, -SLEW_RAD, SLEW_RAD)
        rudder_rad, bias_rad = 0.5 * (previous_shaft_rad + shaft_rad), known.truth[MEAN] + offset_rad
        psi, r = rk4_step(psi, r, rudder_rad, GRID_S, known.ability_1_s, known.lag_s, known.norrbin_s2, bias_rad)
        middle_rad, (f00, f01, f10, f11) = 0.5 * (previous_rad + psi), known.float_step
        difference_rad, rate_rad_s = floating - middle_rad, float_rate
        floating = middle_rad + f00 * difference_rad + f01 * rate_rad_s
        float_rate = f10 * difference_rad + f11 * rate_rad_s


def processes(scenario, ship):
    """Return transition, rudder gain and noise of a step (Van Loan's method), and the frequency of the waves."""
    omega_rad_s = TWO_PI / scenario.wave_period_s / math.sqrt(1.0 - 2.0 * DAMPING**2)
    size, rudder = STATES + 1, STATES
    f, q = np.zeros((size, size)), np.zeros((size, size))
    f[HEADING, RATE], f[RATE, RATE] = 1.0, -1.0 / ship.turning_lag_s
    for index, sign in ((DRIFT, -1.0), (MEAN, -1.0), (rudder, 1.0)):
        f[RATE, index] = sign * ship.turning_ability_1_s / ship.turning_lag_s
    f[DRIFT, DRIFT] = -1.0 / TIME_CONSTANT_S
    if body := scenario.disturbances.float_body:
        square = body.own_frequency_rad_s**2
        f[FLOAT, FLOAT_RATE], f[FLOAT_RATE, HEADING], f[FLOAT_RATE, FLOAT] = 1.0, square, -square
        f[FLOAT_RATE, FLOAT_RATE] = -2.0 * body.damping * body.own_frequency_rad_s
    f[WAVE, WAVE_RATE], f[WAVE_RATE, WAVE] = 1.0, -(omega_rad_s**2)
    f[WAVE_RATE, WAVE_RATE] = -2.0 * DAMPING * omega_rad_s
    q[DRIFT, DRIFT] = 2.0 * radians(scenario.drift_deg) ** 2 / TIME_CONSTANT_S
    q[WAVE_RATE, WAVE_RATE] = 4.0 * DAMPING * omega_rad_s**3 * radians(scenario.wave_yaw_deg) ** 2
    block = np.block([[-f, q], [np.zeros((size, size)), f.T]])
    exponential = expm(block * STEP_S)
    transition = exponential[size:, size:].T
    noise = transition @ exponential[:size, size:]
    states = slice(STATES), slice(STATES)
    return transition[states].copy(), transition[:STATES, STATES].copy(), noise[states].copy(), omega_rad_s


def knowledge_of(scenario, learns, *, knows_drift, is_walking=False):
    """Return the knowledge of a sea: all but the constants in `learns`. `knows_drift`: also the bias of each tick.

    `is_walking`: the constants are estimated as random walks.
    """
    ship, disturbances = OCEAN_RAMBLER.at_speed(scenario.speed_m_s), scenario.disturbances
    transition, rudder_gain, noise, omega_rad_s = processes(scenario, ship)
    truth, sds, direction_rad = np.zeros(STATES), np.zeros(STATES), radians(scenario.current_toward_deg)
    truth[[MEAN, SPEED]] = radians(scenario.bias_deg), scenario.speed_m_s
    truth[LEEWAY] = radians(disturbances.leeway.body_deg) if disturbances.leeway else 0.0
    truth[NORTH], truth[EAST] = (scenario.current_m_s * component(direction_rad) for component in (math.cos, math.sin))
    initial, wave_rad = truth.copy(), radians(scenario.wave_yaw_deg)
    for index in learns:
        initial[index], sds[index] = EXPECTED.get(index, 0.0), UNKNOWN[index]
    sds[[RATE, FLOAT_RATE, DRIFT]] = radians(1.0), radians(1.0), radians(scenario.drift_deg)
    sds[[WAVE, WAVE_RATE]] = wave_rad, wave_rad * omega_rad_s
    covariance = np.diag(sds**2)
    covariance[HEADING : FLOAT + 1 : FLOAT, HEADING : FLOAT + 1 : FLOAT] = radians(30.0) ** 2
    if is_walking:
        for index in learns:
            noise[index, index] += RANDOM_WALKS[index] * STEP_S
    if knows_drift:
        noise[: DRIFT + 1] = noise[:, : DRIFT + 1] = covariance[DRIFT, DRIFT] = 0.0
    body, float_step = disturbances.float_body, ((0.0, 0.0), (0.0, 0.0))
    if body is not None:
        float_step = float_transition(body.own_frequency_rad_s, body.damping, GRID_S)
    numbers = (ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2)
    arrays = (transition, rudder_gain, noise, initial, covariance, truth)
    return Knowledge(*arrays, *numbers, body is not None, (*float_step[0], *float_step[1]), knows_drift)


def drawn_of(scenario, seed, seconds):
    """Return the random values of a sea for a seed."""
    ship, series, devices = drawn(scenario, seed, seconds)
    steps = int(seconds / GRID_S) + 2
    offset_rad = series[ship.offset_at :][:steps]
    fixes = series[devices.fix_at :][: FIX_NUMBERS * int(seconds)].reshape(-1, FIX_NUMBERS)
    fix_m_s = fixes[:, NORTH_ERROR_M_S : NORTH_ERROR_M_S + 2].copy()
    compass_deg, wave_rad = series[devices.compass_at :][: 10 * steps], series[ship.yaw_at :][: 2 * steps : 2].copy()
    when = (devices.compass_phase_s, devices.compass_period_s, devices.fix_phase_s, devices.fix_period_s)
    return SeaDraws(offset_rad, wave_rad, compass_deg, fix_m_s, *when)


def sail(known: Knowledge, sea: SeaDraws, law: tuple[float, float], goals: tuple[Goal, ...], seconds: float) -> Truth:
    """Simulate a run with a law of gain and deadband [rad]; return its truth."""
    rows = np.zeros((2, round(10.0 * seconds) + 1))
    voyage(known, sea, *law, np.array([(goal.t_s, goal.heading_rad) for goal in goals]), rows)
    time_s, zeros, goal_rad = np.arange(rows.shape[1]) / 10.0, np.zeros(rows.shape[1]), np.full(rows.shape[1], np.nan)
    for goal in goals:
        goal_rad[time_s >= goal.t_s] = goal.heading_rad
    return Truth(time_s, rows[0], zeros, zeros, rows[1], zeros, goal_rad, zeros, zeros, zeros)
