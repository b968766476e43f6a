"""Synthetic recordings with the disturbances that were recorded at sea, to judge the heading filter.

In a recording a proportional controller steers the K-T boat with white yaw disturbance and a wandering rudder bias, and
the compass includes the yaw of the waves. The heading filter of the boat is compared with a Kalman filter that is given
all noise levels, which is the best that the same sensors allow, and with the best low-pass of the compass in hindsight.
Everything is drawn from a seed.
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
SETTLED_S, MARGIN_S = 900.0, 5.0  # what is judged begins after 15 minutes and ends before the last seconds
AHEAD_S = (10.0, 30.0, 60.0)
LOW_PASSES_S = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)


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
        """The boat, without the cubic term."""
        return KtModel(self.turning_ability_1_s, self.turning_lag_s, 0.0, 0.0, 0.5)


BIASES = {
    "2 deg, 900 s": Sea(bias_sd_deg=2.0),
    "5 deg, 900 s": Sea(),
    "12 deg, 3000 s": Sea(bias_sd_deg=12.0, bias_memory_s=3000.0),
}
DIFFUSIONS_DEG2_S = (0.0, 0.3, 1.0, 2.0, 4.0, 6.0)


def of_old(wave_deg: float, period_s: float, speed_m_s: float, mean_deg: float, sd_deg: float) -> Sea:
    """Return the waves, the bias and the boat of a scenario without yaw disturbance (docs/explanation/physics.md)."""
    ratio = speed_m_s / 0.4
    return Sea(0.0, wave_deg, period_s, 0.1, 0.3, mean_deg, sd_deg, 100.0, 10.0, 0.049 * ratio, 4.0 / ratio)


OLD_SEAS = {
    "tank": of_old(1.5, 2.53, 0.4, 0.0, 0.0),
    "sea": of_old(4.0, 6.0, 0.9, 5.0, 2.0),
    "swell": of_old(20.0, 8.0, 0.7, 5.0, 2.0),
    "weak": of_old(10.0, 4.0, 0.2, 3.0, 2.0),
    "storm": of_old(30.0, 7.0, 0.5, 8.0, 4.0),
}


class Recording(NamedTuple):
    """Columns of a recording. rudder_rad[k] holds from t_s[k] to t_s[k + 1]; true_rad is the heading without waves."""

    t_s: Any
    compass_rad: Any
    rudder_rad: Any
    true_rad: Any


class Estimates(NamedTuple):
    """Columns of an estimate: the states, of which the heading is the first, and its standard deviation."""

    states: Any
    heading_sd_rad: Any


class Scores(NamedTuple):
    """Error of the heading [deg], its square by the claimed variance, and R2 of the heading 10, 30 and 60 s ahead."""

    error_deg: float
    nees: float
    r2: tuple[float, ...]


class Comparison(NamedTuple):
    """Means over the seeds: the heading filter, the filter that is given all levels, the best low-pass in hindsight."""

    learned: Scores
    informed: Scores
    low_pass_deg: float


@compiled
def oscillation(first, noise, ww, wv, vw, vv, l00, l10, l11):
    """Draw a second-order noise with the transition and the root of the noise covariance of a step."""
    x, v = first
    out = np.empty(noise.shape[0])
    for i in range(noise.shape[0]):
        x, v = (
            ww * x + wv * v + l00 * noise[i, 0],
            vw * x + vv * v + l10 * noise[i, 0] + l11 * noise[i, 1],
        )
        out[i] = x
    return out


@compiled
def decayed(values, keep, before):
    """Return y[n] = values[n] + keep * y[n - 1] from y[-1] = before (scipy.signal takes a second to import)."""
    out = np.empty(values.size)
    for i in range(values.size):
        before = values[i] + keep * before
        out[i] = before
    return out


@compiled
def sail(
    every, steer_every, model, kick, wave_rad, bias_rad, noise_rad, trim_rad, t_s, compass_rad, rudder_rad, true_rad
):
    """Steer the boat by a proportional controller, whose goal turns by 90 deg every 15 minutes; fill the columns."""
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


def discrete(drift, noise, step_s: float):
    """Return transition and noise covariance of a step, exactly (Van Loan, IEEE Trans. Automatic Control 23, 1978)."""
    n = drift.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -drift, noise, drift.T
    whole = expm(block * step_s)
    transition = whole[n:, n:].T
    covariance = transition @ whole[:n, n:]
    return transition, 0.5 * (covariance + covariance.T)


def recorded(sea: Sea, seed: int, seconds: float = 5400.0) -> Recording:
    """Draw a recording."""
    numbers, n = np.random.default_rng(seed), round(seconds / GRID_S)
    (step, wave_noise), sd_rad = discrete(*wave_matrices(sea), GRID_S), radians(sea.wave_deg)
    root = np.linalg.cholesky(wave_noise)
    first = numbers.standard_normal(2) * (sd_rad, sd_rad * 2.0 * math.pi / sea.wave_period_s)
    wave_rad = oscillation(
        tuple(first), numbers.standard_normal((n, 2)), *step.ravel(), root[0, 0], root[1, 0], root[1, 1]
    )
    keep = math.exp(-GRID_S / sea.bias_memory_s)
    steps = math.sqrt(1.0 - keep * keep) * numbers.standard_normal(n)
    steps[0] = numbers.standard_normal()
    bias_rad = radians(sea.bias_mean_deg) + radians(sea.bias_sd_deg) * decayed(steps, keep, 0.0)
    kick = radians(math.sqrt(sea.diffusion_deg2_s * GRID_S)) / sea.turning_lag_s * numbers.standard_normal(n)
    noise_rad = radians(sea.compass_noise_deg) * numbers.standard_normal(n)
    every = round(1.0 / sea.compass_hz / GRID_S)
    columns = Recording(*(np.empty(-(-n // every)) for _ in range(4)))
    sail(
        every, round(STEER_S / GRID_S), sea.model, kick, wave_rad, bias_rad, noise_rad, radians(sea.bias_mean_deg),
        *columns,
    )  # fmt: skip
    return columns


def with_turn(recording: Recording, rate_deg_s: float) -> Recording:
    """Return a recording in which something else than the rudder turns the boat by 90 deg from 1200 s on."""
    turn_rad = radians(rate_deg_s) * np.clip(recording.t_s - 1200.0, 0.0, 90.0 / rate_deg_s)
    compass_rad = (recording.compass_rad + turn_rad) % (2.0 * math.pi)
    return recording._replace(compass_rad=compass_rad, true_rad=recording.true_rad + turn_rad)


@compiled
def informed_rows(compass_rad, steered_rad, transition, by_rudder, noise, compass_variance, first, out):
    """Run the Kalman filter with constant matrices; fill its state and the standard deviation of the heading."""
    p, x, a = first.copy(), np.zeros(STATES), np.empty((STATES, STATES))
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
            y[i] = by_rudder[i] * steered_rad[row]
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


def informed_drift(sea: Sea):
    """Return the drift matrix of heading, yaw rate, deviation of the rudder bias from its mean, and wave yaw."""
    drift = np.zeros((STATES, STATES))
    drift[0, 1] = 1.0
    drift[1, 1:3] = -1.0 / sea.turning_lag_s, -sea.turning_ability_1_s / sea.turning_lag_s
    drift[2, 2] = -1.0 / sea.bias_memory_s
    drift[3:, 3:] = wave_matrices(sea)[0]
    return drift


def informed(sea: Sea, recording: Recording, *, rudder_known: bool = True) -> Estimates:
    """Estimate with the true levels; an unknown rudder counts as one at the mean of its bias."""
    drift, noise, step_s = informed_drift(sea), np.zeros((STATES, STATES)), recording.t_s[1] - recording.t_s[0]
    bias_sd_rad, wave_rad = radians(sea.bias_sd_deg), radians(sea.wave_deg)
    noise[1, 1] = radians(math.sqrt(sea.diffusion_deg2_s)) ** 2 / sea.turning_lag_s**2
    noise[2, 2] = 2.0 * bias_sd_rad**2 / sea.bias_memory_s
    noise[3:, 3:] = wave_matrices(sea)[1]
    transition, covariance = discrete(drift, noise, step_s)
    # A rudder angle acts as a bias that stays, with the other sign.
    constant = drift.copy()
    constant[2, 2] = 0.0
    by_rudder = -expm(constant * step_s)[:, 2] * (1.0, 1.0, 0.0, 1.0, 1.0)
    omega = 2.0 * math.pi / sea.wave_period_s
    first = np.diag([0.1, 0.01, bias_sd_rad**2, wave_rad**2, (omega * wave_rad) ** 2])
    steered_rad = (recording.rudder_rad - radians(sea.bias_mean_deg)) * rudder_known
    out = np.empty((recording.t_s.size, STATES + 1))
    variance = radians(sea.compass_noise_deg) ** 2
    informed_rows(recording.compass_rad, steered_rad, transition, by_rudder, covariance, variance, first, out)
    return Estimates(out[:, :STATES], out[:, STATES])


@compiled
def learned_rows(t_s, compass_rad, rudder_rad, model):
    """Run the heading filter of the boat; return it as it is at the end, and its numbers at each row."""
    f, rows = begin(t_s[0], compass_rad[0]), np.empty((t_s.size, ROW_LENGTH))
    for row in range(t_s.size):
        f = update(f, model, t_s[row], compass_rad[row], rudder_rad[row - 1] if row else 0.0)
        write_row(rows[row], f.motion)
    return f, rows


def estimated(rows) -> Estimates:
    """Return the columns of rows of the heading filter."""
    return Estimates(rows[:, : heading_model.STATES], np.sqrt(rows[:, Motion._fields.index("p00")]))


def learned(sea: Sea, recording: Recording, *, rudder_known: bool = True) -> tuple[Estimates, HeadingFilter]:
    """Estimate with the heading filter of the boat, and return it as it is at the end."""
    rudder_rad = recording.rudder_rad if rudder_known else np.full(recording.t_s.size, math.nan)
    f, rows = learned_rows(recording.t_s, recording.compass_rad, rudder_rad, sea.model)
    return estimated(rows), f


def wrapped(angle_rad):
    """Wrap angles to the half turns."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def settled(recording: Recording):
    """Return which rows are judged."""
    return (recording.t_s > SETTLED_S) & (recording.t_s < recording.t_s[-1] - MARGIN_S)


def best_low_pass_deg(recording: Recording) -> float:
    """Return the error of the best first-order low-pass of the compass, its time constant chosen in hindsight."""
    swing_rad, step_s, min_rad = (
        wrapped(recording.compass_rad - recording.true_rad),
        np.diff(recording.t_s)[0],
        math.inf,
    )
    compass_rad, rows = swing_rad + recording.true_rad, settled(recording)
    for constant_s in LOW_PASSES_S:
        keep = math.exp(-step_s / constant_s) if constant_s else 0.0
        smooth_rad = decayed((1.0 - keep) * compass_rad, keep, compass_rad[0])
        min_rad = min(min_rad, float(np.sqrt(np.mean((smooth_rad - recording.true_rad)[rows] ** 2))))
    return math.degrees(min_rad)


def learned_ahead(sea: Sea, ahead_s: float):
    """Return the heading ahead_s later by each state of the heading filter: the first row of its transition."""
    ends = (
        heading_model.predict(Motion(*state), PRIOR, sea.model, 0.0, ahead_s) for state in np.eye(heading_model.STATES)
    )
    return np.array([end.heading_rad for end in ends])


def informed_ahead(sea: Sea, ahead_s: float):
    """Return the heading ahead_s later by each state of the filter that is given all levels."""
    return expm(informed_drift(sea) * ahead_s)[0]


def prediction_r2(sea: Sea, recording: Recording, states, row, steered_rad, ahead_s: float) -> float:
    """Return R2 of the heading change ahead_s later, which the recorded rudder and row of a transition predict."""
    t_s, model = recording.t_s, sea.model
    step_s = t_s[1] - t_s[0]
    count, keep = round(ahead_s / step_s), math.exp(-step_s / model.turning_lag_s)
    # The response to the rudder from rest at the first row; what of it lies in the interval follows by linearity.
    steady = model.turning_ability_1_s * steered_rad
    rate = np.concatenate([[0.0], decayed((1.0 - keep) * steady[:-1], keep, 0.0)])
    reach_s = model.turning_lag_s * (1.0 - keep)
    moved = np.concatenate([[0.0], np.cumsum(steady * (step_s - reach_s) + rate * reach_s)[:-1]])
    far_s = model.turning_lag_s * (1.0 - math.exp(-ahead_s / model.turning_lag_s))
    by_rudder = moved[count:] - moved[:-count] - rate[:-count] * far_s
    rows = settled(recording)[:-count]
    before, after = recording.true_rad[:-count][rows], recording.true_rad[count:][rows]
    predicted = (states[:-count] @ row + by_rudder)[rows]
    return 1.0 - float(np.sum(wrapped(predicted - after) ** 2) / np.sum((after - before) ** 2))


def scores(sea: Sea, recording: Recording, estimates: Estimates, ahead, steered_rad) -> Scores:
    """Judge an estimate; predictions by `ahead` (`learned_ahead`, `informed_ahead`), none where steered_rad is None."""
    error_rad, rows = wrapped(estimates.states[:, 0] - recording.true_rad), settled(recording)
    r2 = ()
    if steered_rad is not None:
        r2 = tuple(
            prediction_r2(sea, recording, estimates.states, ahead(sea, ahead_s), steered_rad, ahead_s)
            for ahead_s in AHEAD_S
        )
    nees = float(np.mean((error_rad / estimates.heading_sd_rad)[rows] ** 2))
    return Scores(math.degrees(math.sqrt(np.mean(error_rad[rows] ** 2))), nees, r2)


def mean_scores(all_scores: list[Scores]) -> Scores:
    """Return the means of several seeds."""
    error_deg, nees, r2 = zip(*all_scores, strict=True)
    return Scores(float(np.mean(error_deg)), float(np.mean(nees)), tuple(np.mean(r2, axis=0)))


def compared(sea: Sea, seeds: range, *, rudder_known: bool = True, seconds: float = 5400.0) -> Comparison:
    """Judge the heading filter and the one with the true levels on the recordings of some seeds."""
    ours, best, low_pass_deg = [], [], []
    for seed in seeds:
        recording = recorded(sea, seed, seconds)
        steered_rad = recording.rudder_rad if rudder_known else None
        from_mean_rad = recording.rudder_rad - radians(sea.bias_mean_deg) if rudder_known else None
        estimates, _ = learned(sea, recording, rudder_known=rudder_known)
        ours.append(scores(sea, recording, estimates, learned_ahead, steered_rad))
        estimates = informed(sea, recording, rudder_known=rudder_known)
        best.append(scores(sea, recording, estimates, informed_ahead, from_mean_rad))
        low_pass_deg.append(best_low_pass_deg(recording))
    return Comparison(mean_scores(ours), mean_scores(best), float(np.mean(low_pass_deg)))
