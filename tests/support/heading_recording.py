"""Synthetic recordings with the disturbances of recorded seas, and comparison of the heading filter with references.

In a recording a proportional controller steers the K-T boat with white yaw disturbance and a rudder bias that varies
slowly, and the compass heading contains wave yaw. The heading filter is compared with two references: a Kalman filter
with the true noise levels, which is the optimum for these sensors, and the low-pass filter of the compass with the time
constant that is best for the recording.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_filter import PRIOR, HeadingFilter, begin, update
from firmware_py.estimate.heading_model import ROW_LENGTH, Motion, write_row
from firmware_py.model.kt import KtModel
from hil.lab.compiled import compiled

GRID_S, STEER_S, GOAL_S, RUDDER_LIMIT_RAD, GAIN = 0.05, 0.5, 900.0, radians(30.0), 1.15
STATES = 5
SETTLING_S, MARGIN_S = 900.0, 5.0  # at the start and the end of a recording; not evaluated
HORIZONS_S = (10.0, 30.0, 60.0)
LOW_PASS_TIME_CONSTANTS_S = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)


class Sea(NamedTuple):
    """Noise levels of a sea, angles in degrees; the defaults are typical of the recordings."""

    diffusion_deg2_s: float = 2.0
    wave_deg: float = 1.1
    wave_period_s: float = 2.5
    wave_damping: float = 0.18
    compass_noise_deg: float = 0.05
    bias_mean_deg: float = 5.0
    bias_sd_deg: float = 5.0
    bias_memory_s: float = 900.0
    compass_hz: float = 2.0
    turning_ability_1_s: float = 0.049
    turning_lag_s: float = 4.0

    @property
    def model(self) -> KtModel:
        """K-T model of the boat, without the cubic term."""
        return KtModel(self.turning_ability_1_s, self.turning_lag_s, 0.0, 0.0, 0.5)


BIASES = {
    "2 deg, 900 s": Sea(bias_sd_deg=2.0),
    "5 deg, 900 s": Sea(),
    "12 deg, 3000 s": Sea(bias_sd_deg=12.0, bias_memory_s=3000.0),
}
DIFFUSIONS_DEG2_S = (0.0, 0.3, 1.0, 2.0, 4.0, 6.0)


def undisturbed_sea(wave_deg: float, period_s: float, speed_m_s: float, mean_deg: float, sd_deg: float) -> Sea:
    """Return the sea of a scenario without yaw disturbance (docs/explanation/physics.md)."""
    ratio = speed_m_s / 0.4
    return Sea(0.0, wave_deg, period_s, 0.1, 0.3, mean_deg, sd_deg, 100.0, 10.0, 0.049 * ratio, 4.0 / ratio)


UNDISTURBED_SEAS = {
    "tank": undisturbed_sea(1.5, 2.53, 0.4, 0.0, 0.0),
    "sea": undisturbed_sea(4.0, 6.0, 0.9, 5.0, 2.0),
    "swell": undisturbed_sea(20.0, 8.0, 0.7, 5.0, 2.0),
    "weak": undisturbed_sea(10.0, 4.0, 0.2, 3.0, 2.0),
    "storm": undisturbed_sea(30.0, 7.0, 0.5, 8.0, 4.0),
}


class Recording(NamedTuple):
    """Columns of a recording. rudder_rad[k] applies from t_s[k] to t_s[k + 1]; true_rad is without waves."""

    t_s: Any
    compass_rad: Any
    rudder_rad: Any
    true_rad: Any


class Estimates(NamedTuple):
    """Columns of an estimate: states, with the heading first, and standard deviation of the heading."""

    states: Any
    heading_sd_rad: Any


class Scores(NamedTuple):
    """Rms error of the heading [deg], NEES, and R2 of the heading predicted over each of HORIZONS_S."""

    error_deg: float
    nees: float
    r2: tuple[float, ...]


class Comparison(NamedTuple):
    """Means over the seeds: heading filter, reference filter with the true levels, best low-pass filter."""

    learning: Scores
    reference: Scores
    low_pass_deg: float


@compiled
def draw_oscillation(initial, noise, ww, wv, vw, vv, l00, l10, l11):
    """Draw a second-order process from the transition matrix and the Cholesky factor of the noise of a step."""
    x, v = initial
    out = np.empty(noise.shape[0])
    for i in range(noise.shape[0]):
        x, v = (
            ww * x + wv * v + l00 * noise[i, 0],
            vw * x + vv * v + l10 * noise[i, 0] + l11 * noise[i, 1],
        )
        out[i] = x
    return out


@compiled
def filter_first_order(values, keep, initial):
    """Return y[n] = values[n] + keep * y[n - 1] with y[-1] = initial (scipy.signal takes a second to import)."""
    out = np.empty(values.size)
    y = initial
    for i in range(values.size):
        y = values[i] + keep * y
        out[i] = y
    return out


@compiled
def simulate(
    every, steer_every, model, kick, wave_rad, bias_rad, noise_rad, trim_rad, t_s, compass_rad, rudder_rad, true_rad
):
    """Simulate a boat with a proportional controller, whose goal turns by 90 deg every 15 minutes; fill the columns."""
    psi = r = rudder = 0.0
    row = 0
    for i in range(kick.size):
        if i % steer_every == 0:
            goal = 0.5 * math.pi * math.floor(i * GRID_S / GOAL_S)
            error = (goal - psi - wave_rad[i] + math.pi) % (2.0 * math.pi) - math.pi
            rudder = max(-RUDDER_LIMIT_RAD, min(RUDDER_LIMIT_RAD, GAIN * error + trim_rad))
        if i % every == 0:
            t_s[row], rudder_rad[row], true_rad[row] = i * GRID_S, rudder, psi
            compass_rad[row] = (psi + wave_rad[i] + noise_rad[i]) % (2.0 * math.pi)
            row += 1
        drive = model.turning_ability_1_s * (rudder - bias_rad[i]) - r
        r += GRID_S * drive / model.turning_lag_s + kick[i]
        psi += GRID_S * r


def wave_matrices(sea: Sea):
    """Return drift and noise matrix of the wave yaw in continuous time."""
    omega, sd_rad = 2.0 * math.pi / sea.wave_period_s, radians(sea.wave_deg)
    drift = np.array([[0.0, 1.0], [-omega * omega, -2.0 * sea.wave_damping * omega]])
    return drift, np.diag([0.0, 4.0 * sea.wave_damping * omega**3 * sd_rad**2])


def discretize(drift, noise, step_s: float):
    """Return transition and noise covariance of a step, exactly (Van Loan, IEEE Trans. Automatic Control 23, 1978)."""
    n = drift.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -drift, noise, drift.T
    exponential = expm(block * step_s)
    transition = exponential[n:, n:].T
    covariance = transition @ exponential[:n, n:]
    return transition, 0.5 * (covariance + covariance.T)


def draw_recording(sea: Sea, seed: int, seconds: float = 5400.0) -> Recording:
    """Draw a recording of a sea."""
    rng, n = np.random.default_rng(seed), round(seconds / GRID_S)
    (step, wave_noise), sd_rad = discretize(*wave_matrices(sea), GRID_S), radians(sea.wave_deg)
    root = np.linalg.cholesky(wave_noise)
    initial = rng.standard_normal(2) * (sd_rad, sd_rad * 2.0 * math.pi / sea.wave_period_s)
    wave_rad = draw_oscillation(
        tuple(initial), rng.standard_normal((n, 2)), *step.ravel(), root[0, 0], root[1, 0], root[1, 1]
    )
    keep = math.exp(-GRID_S / sea.bias_memory_s)
    steps = math.sqrt(1.0 - keep * keep) * rng.standard_normal(n)
    steps[0] = rng.standard_normal()
    bias_rad = radians(sea.bias_mean_deg) + radians(sea.bias_sd_deg) * filter_first_order(steps, keep, 0.0)
    kick = radians(math.sqrt(sea.diffusion_deg2_s * GRID_S)) / sea.turning_lag_s * rng.standard_normal(n)
    noise_rad = radians(sea.compass_noise_deg) * rng.standard_normal(n)
    every = round(1.0 / sea.compass_hz / GRID_S)
    columns = Recording(*(np.empty(-(-n // every)) for _ in range(4)))
    simulate(
        every, round(STEER_S / GRID_S), sea.model, kick, wave_rad, bias_rad, noise_rad, radians(sea.bias_mean_deg),
        *columns,
    )  # fmt: skip
    return columns


def with_turn(recording: Recording, rate_deg_s: float) -> Recording:
    """Return the recording with a turn of 90 deg at 1200 s that is not caused by the rudder."""
    turn_rad = radians(rate_deg_s) * np.clip(recording.t_s - 1200.0, 0.0, 90.0 / rate_deg_s)
    compass_rad = (recording.compass_rad + turn_rad) % (2.0 * math.pi)
    return recording._replace(compass_rad=compass_rad, true_rad=recording.true_rad + turn_rad)


@compiled
def run_reference_filter(compass_rad, steered_rad, transition, rudder_gain, noise, compass_variance, initial_p, out):
    """Run the Kalman filter with constant matrices; fill its state and the standard deviation of the heading."""
    p, x, a = initial_p.copy(), np.zeros(STATES), np.empty((STATES, STATES))
    gain, y = np.empty(STATES), np.empty(STATES)
    x[0] = compass_rad[0]
    for row in range(compass_rad.size):
        innovation = (compass_rad[row] - x[0] - x[3] + math.pi) % (2.0 * math.pi) - math.pi
        variance = p[0, 0] + 2.0 * p[0, 3] + p[3, 3] + compass_variance
        for i in range(STATES):
            gain[i] = p[i, 0] + p[i, 3]
        for i in range(STATES):
            x[i] += gain[i] * innovation / variance
            for j in range(STATES):
                p[i, j] -= gain[i] * gain[j] / variance
        out[row, STATES] = math.sqrt(p[0, 0])
        for i in range(STATES):  # numba takes seconds to compile the checks of a slice assignment
            out[row, i] = x[i]
        for i in range(STATES):
            y[i] = rudder_gain[i] * steered_rad[row]
            for j in range(STATES):
                y[i] += transition[i, j] * x[j]
                a[i, j] = 0.0
                for k in range(STATES):
                    a[i, j] += transition[i, k] * p[k, j]
        for i in range(STATES):
            x[i] = y[i]
            for j in range(STATES):
                p[i, j] = noise[i, j]
                for k in range(STATES):
                    p[i, j] += a[i, k] * transition[j, k]


def reference_drift(sea: Sea):
    """Return the drift matrix of heading, yaw rate, deviation of the rudder bias from its mean, and wave yaw."""
    drift = np.zeros((STATES, STATES))
    drift[0, 1] = 1.0
    drift[1, 1:3] = -1.0 / sea.turning_lag_s, -sea.turning_ability_1_s / sea.turning_lag_s
    drift[2, 2] = -1.0 / sea.bias_memory_s
    drift[3:, 3:] = wave_matrices(sea)[0]
    return drift


def run_reference(sea: Sea, recording: Recording, *, rudder_known: bool = True) -> Estimates:
    """Run the reference filter with the true levels; an unknown rudder counts as constant at the mean of its bias."""
    drift, noise, step_s = reference_drift(sea), np.zeros((STATES, STATES)), recording.t_s[1] - recording.t_s[0]
    bias_sd_rad, wave_rad = radians(sea.bias_sd_deg), radians(sea.wave_deg)
    noise[1, 1] = radians(math.sqrt(sea.diffusion_deg2_s)) ** 2 / sea.turning_lag_s**2
    noise[2, 2] = 2.0 * bias_sd_rad**2 / sea.bias_memory_s
    noise[3:, 3:] = wave_matrices(sea)[1]
    transition, covariance = discretize(drift, noise, step_s)
    # A rudder angle acts as a constant bias of the opposite sign.
    constant = drift.copy()
    constant[2, 2] = 0.0
    rudder_gain = -expm(constant * step_s)[:, 2] * (1.0, 1.0, 0.0, 1.0, 1.0)
    omega = 2.0 * math.pi / sea.wave_period_s
    initial_p = np.diag([0.1, 0.01, bias_sd_rad**2, wave_rad**2, (omega * wave_rad) ** 2])
    steered_rad = (recording.rudder_rad - radians(sea.bias_mean_deg)) * rudder_known
    out = np.empty((recording.t_s.size, STATES + 1))
    variance = radians(sea.compass_noise_deg) ** 2
    run_reference_filter(
        recording.compass_rad, steered_rad, transition, rudder_gain, covariance, variance, initial_p, out
    )
    return Estimates(out[:, :STATES], out[:, STATES])


@compiled
def filter_rows(t_s, compass_rad, rudder_rad, model):
    """Run the heading filter of the boat; return it after the last row, and its state at each row."""
    f, rows = begin(t_s[0], compass_rad[0]), np.empty((t_s.size, ROW_LENGTH))
    for row in range(t_s.size):
        f = update(f, model, t_s[row], compass_rad[row], rudder_rad[row - 1] if row else 0.0)
        write_row(rows[row], f.motion)
    return f, rows


def to_estimates(rows) -> Estimates:
    """Return the estimates of the rows of the heading filter."""
    return Estimates(rows[:, : heading_model.STATES], np.sqrt(rows[:, Motion._fields.index("p00")]))


def run_filter(sea: Sea, recording: Recording, *, rudder_known: bool = True) -> tuple[Estimates, HeadingFilter]:
    """Run the heading filter of the boat; return its estimates, and the filter after the last row."""
    rudder_rad = recording.rudder_rad if rudder_known else np.full(recording.t_s.size, math.nan)
    f, rows = filter_rows(recording.t_s, recording.compass_rad, rudder_rad, sea.model)
    return to_estimates(rows), f


def wrap(angle_rad):
    """Wrap angles to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def evaluated_rows(recording: Recording):
    """Return a mask of the rows that are evaluated."""
    return (recording.t_s > SETTLING_S) & (recording.t_s < recording.t_s[-1] - MARGIN_S)


def best_low_pass_deg(recording: Recording) -> float:
    """Return the smallest rms error of a first-order low-pass filter of the compass [deg]."""
    compass_rad = wrap(recording.compass_rad - recording.true_rad) + recording.true_rad
    step_s, min_rad, rows = np.diff(recording.t_s)[0], math.inf, evaluated_rows(recording)
    for constant_s in LOW_PASS_TIME_CONSTANTS_S:
        keep = math.exp(-step_s / constant_s) if constant_s else 0.0
        smooth_rad = filter_first_order((1.0 - keep) * compass_rad, keep, compass_rad[0])
        min_rad = min(min_rad, float(np.sqrt(np.mean((smooth_rad - recording.true_rad)[rows] ** 2))))
    return math.degrees(min_rad)


def filter_transition_row(sea: Sea, ahead_s: float):
    """Return the first row of the transition matrix of the heading filter over ahead_s."""
    ends = (
        heading_model.predict(Motion(*state), PRIOR, sea.model, 0.0, ahead_s) for state in np.eye(heading_model.STATES)
    )
    return np.array([end.heading_rad for end in ends])


def reference_transition_row(sea: Sea, ahead_s: float):
    """Return the first row of the transition matrix of the reference filter over ahead_s."""
    return expm(reference_drift(sea) * ahead_s)[0]


def prediction_r2(sea: Sea, recording: Recording, states, row, steered_rad, ahead_s: float) -> float:
    """Return R2 of the heading change over ahead_s, predicted with the recorded rudder and a row of the transition."""
    t_s, model = recording.t_s, sea.model
    step_s = t_s[1] - t_s[0]
    count, keep = round(ahead_s / step_s), math.exp(-step_s / model.turning_lag_s)
    # Response to the rudder from rest at the first row; the part in each interval follows by linearity.
    steady = model.turning_ability_1_s * steered_rad
    rate = np.concatenate([[0.0], filter_first_order((1.0 - keep) * steady[:-1], keep, 0.0)])
    reach_s = model.turning_lag_s * (1.0 - keep)
    turned = np.concatenate([[0.0], np.cumsum(steady * (step_s - reach_s) + rate * reach_s)[:-1]])
    reach_ahead_s = model.turning_lag_s * (1.0 - math.exp(-ahead_s / model.turning_lag_s))
    rudder_response = turned[count:] - turned[:-count] - rate[:-count] * reach_ahead_s
    rows = evaluated_rows(recording)[:-count]
    start, end = recording.true_rad[:-count][rows], recording.true_rad[count:][rows]
    predicted = (states[:-count] @ row + rudder_response)[rows]
    return 1.0 - float(np.sum(wrap(predicted - end) ** 2) / np.sum((end - start) ** 2))


def score(sea: Sea, recording: Recording, estimates: Estimates, transition_row, steered_rad) -> Scores:
    """Score an estimate. `transition_row` gives the predictions; there are none if steered_rad is None."""
    error_rad, rows = wrap(estimates.states[:, 0] - recording.true_rad), evaluated_rows(recording)
    r2 = ()
    if steered_rad is not None:
        r2 = tuple(
            prediction_r2(sea, recording, estimates.states, transition_row(sea, ahead_s), steered_rad, ahead_s)
            for ahead_s in HORIZONS_S
        )
    nees = float(np.mean((error_rad / estimates.heading_sd_rad)[rows] ** 2))
    return Scores(math.degrees(math.sqrt(np.mean(error_rad[rows] ** 2))), nees, r2)


def mean_scores(all_scores: list[Scores]) -> Scores:
    """Return the means of the scores of several seeds."""
    error_deg, nees, r2 = zip(*all_scores, strict=True)
    return Scores(float(np.mean(error_deg)), float(np.mean(nees)), tuple(np.mean(r2, axis=0)))


def compare_filters(sea: Sea, seeds: range, *, rudder_known: bool = True, seconds: float = 5400.0) -> Comparison:
    """Return the mean scores of the heading filter and the references on the recordings of some seeds."""
    learning, reference, low_pass_deg = [], [], []
    for seed in seeds:
        recording = draw_recording(sea, seed, seconds)
        steered_rad = recording.rudder_rad if rudder_known else None
        from_mean_rad = recording.rudder_rad - radians(sea.bias_mean_deg) if rudder_known else None
        estimates, _ = run_filter(sea, recording, rudder_known=rudder_known)
        learning.append(score(sea, recording, estimates, filter_transition_row, steered_rad))
        estimates = run_reference(sea, recording, rudder_known=rudder_known)
        reference.append(score(sea, recording, estimates, reference_transition_row, from_mean_rad))
        low_pass_deg.append(best_low_pass_deg(recording))
    return Comparison(mean_scores(learning), mean_scores(reference), float(np.mean(low_pass_deg)))
