"""Maximum a posteriori fit: Fisher scoring with bounds, from several starts; and an output-error fit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from hil.lab.identify.filter import (
    ALPHA,
    COMPASS,
    DAMPING,
    DELAY,
    DIFFUSION,
    EXPONENT,
    GYRO,
    LAG,
    LN_K,
    LN_T,
    OFFSET,
    OUTLIER_SQUARE,
    PERIOD,
    UNKNOWN_COUNT,
    WALK,
    WAVE,
    add_derivatives,
    innovations,
    model_of,
    simulate,
)
from hil.lab.identify.mend import replace_spikes
from hil.lab.identify.prior import LOW, Prior
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretches import Columns, Data, Stretch, excerpt

START_LAGS_S = (0.3, 1.0, 4.0, 12.0, 50.0)
START_GAIN_LAG = 0.3  # initial product K T
START_ROWS, START_ITERATIONS = 1500, 10
MAX_ITERATIONS, CONVERGED_CHANGE = 60, 1e-3  # change of the cost
NULL_CONVERGED_CHANGE = 0.5  # the same for the fit without rudder effect
ROWS_PER_LAG, ROWS_PER_WAVE = 12.0, 8.0  # after averaging
SIGN_COST = 6.0  # added to minus the log density of a reversed rudder, which is unlikely
MAX_LOG_STEP = 1.5  # of an unknown that is a logarithm
MIN_SPEED_SPREAD = 0.005  # relative; a smaller variation has no effect
NOISE_LEVELS = (DIFFUSION, WAVE, PERIOD, DAMPING, WALK)
DIFFERENCE = 1e-4  # step of finite differences
CUBIC_DIFFERENCE = 5e-6  # the same of alpha K^2

Report = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Fit:
    """The unknowns at the maximum, the sign of K, the indices of the free unknowns and their covariance.

    prior_fraction: part of the information that comes from the prior. gain: log-likelihood minus that of a boat without
    rudder effect. is_likeliest: whether the values are those of the maximum, and not those that predict the recording
    better (find_best_prediction).
    """

    values: Floats
    sign: float
    free: tuple[int, ...]
    covariance: Floats
    prior_fraction: Floats
    gain: float
    outliers: int
    evaluations: int
    is_likeliest: bool

    def spread(self, index: int) -> float:
        """Return the standard deviation of an unknown, 0 for a fixed one."""
        if index not in self.free:
            return 0.0
        position = self.free.index(index)
        return math.sqrt(max(float(self.covariance[position, position]), 0.0))

    def prior_fraction_of(self, index: int) -> float:
        """Return the fraction of the information on an unknown that comes from the prior."""
        return float(self.prior_fraction[self.free.index(index)]) if index in self.free else 1.0

    def per_unit(self, size: float) -> Fit:
        """Return the same fit for a rudder column divided by `size`."""
        values, scaling = self.values.copy(), np.eye(len(self.free))
        values[LN_K] += math.log(size)
        values[OFFSET] /= size
        position = self.free.index(OFFSET)
        scaling[position, position] = 1.0 / size
        return replace(self, values=values, covariance=scaling @ self.covariance @ scaling)

    def model(self) -> Floats:
        """Return K, T, alpha, delta0 and the exponent of the speed."""
        return model_of(self.values, self.sign)


class Posterior:
    """Posterior density of the unknowns for given columns."""

    def __init__(self, columns: Columns, prior: Prior, pool: ThreadPoolExecutor) -> None:
        """Store measurements, prior and thread pool."""
        self._columns, self.prior, self._pool = columns, prior, pool
        self.evaluations = 0

    def innovations(self, values: Floats, sign: float) -> Floats:
        """Return innovations and their variances, (2, rows), and count the evaluation."""
        columns, out = self._columns, np.empty((2, self._columns.step_s.size))
        rudder = columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
        self.evaluations += 1
        innovations(
            values, sign, columns.step_s, columns.is_first, columns.measured, rudder, columns.speed_ratio,
            columns.uses_headings, out,
        )  # fmt: skip
        return out

    def cost(self, values: Floats, innovations_and_variances: Floats) -> float:
        """Return minus the log density up to a constant; infinite if the filter fails."""
        innovation, variance = innovations_and_variances
        if not np.all(variance > 0.0):
            return math.inf
        likelihood = 0.5 * float(np.sum(np.log(variance) + np.minimum(innovation**2 / variance, OUTLIER_SQUARE)))
        cost = likelihood + self.prior.cost(values)
        return cost if math.isfinite(cost) else math.inf

    def derivatives(
        self, values: Floats, sign: float, free: Sequence[int], base: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return gradient, Fisher information of the likelihood and curvature of the prior."""
        by = np.array([_difference(values, index) for index in free])

        def difference_of(position: int) -> Floats:
            changed = values.copy()
            changed[free[position]] += by[position]
            return self.innovations(changed, sign)

        results = np.array(list(self._pool.map(difference_of, range(len(free)))))
        gradient, information = np.zeros(len(free)), np.zeros((len(free), len(free)))
        add_derivatives(base, results, by, gradient, information)
        information += np.tril(information, -1).T
        slope, curvature = self.prior.derivatives(values)
        free_indices = np.array(free)
        return gradient + slope[free_indices], information, curvature[np.ix_(free_indices, free_indices)]

    def climb(
        self,
        values: Floats,
        sign: float,
        free: Sequence[int],
        report: Report,
        max_iterations: int = MAX_ITERATIONS,
        converged_change: float = CONVERGED_CHANGE,
    ) -> tuple[Floats, float]:
        """Return the maximum reached from the start `values` by damped Fisher scoring, and its cost."""
        free_indices, low, high = np.array(free), self.prior.low, self.prior.high
        values = np.clip(values, low, high)
        base = self.innovations(values, sign)
        cost, damping = self.cost(values, base), 1e-2
        max_step = np.array([{OFFSET: 0.3, ALPHA: math.inf}.get(index, MAX_LOG_STEP) for index in free])
        for _ in range(max_iterations):
            report()
            gradient, information, curvature = self.derivatives(values, sign, free, base)
            hessian = information + curvature
            is_at_bound = ((values[free_indices] <= low[free_indices] + 1e-12) & (gradient > 0.0)) | (
                (values[free_indices] >= high[free_indices] - 1e-12) & (gradient < 0.0)
            )
            inner_unknowns = np.flatnonzero(~is_at_bound)
            trial_cost = math.inf
            while damping < 1e6 and not trial_cost < cost:
                matrix = hessian[np.ix_(inner_unknowns, inner_unknowns)]
                step = np.zeros(len(free))
                step[inner_unknowns] = -np.linalg.solve(
                    matrix + damping * np.diag(np.diag(matrix)), gradient[inner_unknowns]
                )
                step *= min(1.0, float(np.min(max_step / np.maximum(np.abs(step), 1e-300))))
                trial = values.copy()
                trial[free_indices] += step
                trial = np.clip(trial, low, high)
                results = self.innovations(trial, sign)
                trial_cost = self.cost(trial, results)
                damping *= 1.0 if trial_cost < cost else 5.0
            if not trial_cost < cost:
                return values, cost
            decrease = cost - trial_cost
            values, cost, base, damping = trial, trial_cost, results, max(damping / 5.0, 1e-6)
            if decrease < converged_change and damping < 1.0:
                break
        return values, cost


def _difference(values: Floats, index: int) -> float:
    if index == ALPHA:
        return max(DIFFERENCE * float(values[ALPHA]), CUBIC_DIFFERENCE * math.exp(-2.0 * float(values[LN_K])))
    return {OFFSET: 1e-5, DELAY: 1e-3, LAG: 1e-3}.get(index, DIFFERENCE)


def fit(data: Data, *, cubic: bool, exponent: float | None, report: Report) -> Fit:
    """Fit the model to all stretches; `exponent` is the exponent of the speed, None to estimate it."""
    headings = all(stretch.heading_rad is not None for stretch in data.stretches)
    free = [LN_K, LN_T, *([ALPHA] if cubic else []), OFFSET, DELAY, LAG]
    speed_varies = float(np.std(np.concatenate([stretch.speed_ratio for stretch in data.stretches]))) > MIN_SPEED_SPREAD
    if exponent is None and speed_varies:
        free.append(EXPONENT)
    free += [*NOISE_LEVELS, COMPASS if headings else GYRO]
    start_exponent = 1.0 if exponent is None else exponent
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(free))) as pool:
        values, sign, evaluations = _find_start(data, free, start_exponent, pool, report)
        lag_s = math.exp(values[LN_T])
        every = max(1, int(min(lag_s / ROWS_PER_LAG, math.exp(values[PERIOD]) / ROWS_PER_WAVE) / data.median_step_s))
        columns = Columns(data, every)
        for _ in range(2):  # the scales of the prior depend on T
            posterior = Posterior(columns, _prior(data, math.exp(values[LN_T])), pool)
            values, cost = posterior.climb(values, sign, free, report)
            evaluations += posterior.evaluations
        base = posterior.innovations(values, sign)
        _, information, curvature = posterior.derivatives(values, sign, free, base)
        start_without_rudder = values.copy()
        start_without_rudder[LN_K], start_without_rudder[ALPHA] = LOW[LN_K], 0.0
        fit_without_rudder = posterior.climb(
            start_without_rudder, sign, free[-len(NOISE_LEVELS) - 1 :], report, START_ITERATIONS, NULL_CONVERGED_CHANGE
        )
        cost_without_rudder = fit_without_rudder[1] - posterior.prior.cost(fit_without_rudder[0])
        cost_with_rudder = cost - posterior.prior.cost(values)
    covariance: Floats = np.asarray(np.linalg.inv(information + curvature), dtype=np.float64)
    fraction = np.diag(covariance @ curvature @ covariance) / np.diag(covariance)
    outliers = int(np.count_nonzero(base[0] ** 2 > OUTLIER_SQUARE * base[1]))
    best = find_best_prediction(data, posterior.prior, values, sign, tuple(free))
    if best is not None:  # the model has an error, of which the distance of both solutions is a measure
        distance = (best - values)[free]
        covariance, values = covariance + np.outer(distance, distance), best
    return Fit(
        values, sign, tuple(free), covariance, fraction, cost_without_rudder - cost_with_rudder, outliers,
        evaluations + posterior.evaluations, best is None,
    )  # fmt: skip


def _prior(data: Data, lag_s: float) -> Prior:
    return Prior.of(lag_s, data.median_step_s, float(np.std(data.rudder_rad)))


def _find_start(
    data: Data, free: Sequence[int], exponent: float, pool: ThreadPoolExecutor, report: Report
) -> tuple[Floats, float, int]:
    """Return unknowns, sign of K and number of evaluations of the best start.

    Starts are several T and both signs of K; each gets a few iterations on an excerpt.
    """
    max_step = max(1, int(0.4 / data.median_step_s))
    every = min(max(1, data.rows // START_ROWS), max_step)
    part = excerpt(data, START_ROWS * every)
    columns, evaluations = Columns(part, every), 0
    best: tuple[float, Floats, float] = (math.inf, np.zeros(UNKNOWN_COUNT), 1.0)
    lags = [lag_s for lag_s in START_LAGS_S if 0.3 * data.median_step_s <= lag_s <= 0.3 * part.duration_s] or [
        max(data.median_step_s, 0.1 * part.duration_s)
    ]

    def try_start(lag_s: float, sign: float) -> None:
        nonlocal best, evaluations
        posterior = Posterior(columns, _prior(data, lag_s), pool)
        start = posterior.prior.start(START_GAIN_LAG / lag_s, lag_s)
        start[EXPONENT] = exponent
        values, cost = posterior.climb(start, sign, free, report, START_ITERATIONS)
        cost += SIGN_COST * (sign < 0.0)
        evaluations += posterior.evaluations
        if cost < best[0]:
            best = (cost, values, sign)

    for lag_s in lags:
        try_start(lag_s, 1.0)
    for lag_s in {lags[0], min(lags, key=lambda lag: abs(math.log(lag) - best[1][LN_T]))}:
        try_start(lag_s, -1.0)
    return best[1], best[2], evaluations


# Output-error fit (Ljung, System identification, 1999, 4.2): the model whose simulation is closest to the recording.
# For a K-T boat in noise the likelihood (filter.py) is the better criterion, in open and closed loop. For other boats,
# such as a hull with higher-order dynamics in calm water, the likelihood treats the model error as a disturbance, and
# the parameters predict badly. Therefore the model with the best prediction replaces the likeliest one if its error is
# smaller by more than noise and feedback explain.
MAX_ROWS = 6000
# Starts: changes of ln K and ln T of the likeliest model, and the scaled alpha (see _alpha_scale), None for that of the
# likeliest model. The last one is a hull that is almost unstable on course (KVLCC2).
STARTS = ((0.0, None), (-1.0, None), (1.0, 0.3), (3.0, 3.0))
MAX_EVALUATIONS, PASSES = 40, 2
RATE_STEP_RAD_S = 1e-5
# Accepted relative excess of the error variance of the likeliest model over the smallest one. Random K-T boats had up
# to 0.04 where the rudder explains 45 %, and 0.15 where it explains less, mostly in closed loop.
MAX_EXCESS, MAX_EXCESS_OF_UNEXPLAINED = 0.05, 0.3
# Largest unexplained fraction of the variance with which alpha is fitted: otherwise a large alpha explains waves that
# the rudder follows.
MAX_UNEXPLAINED_WITH_CUBIC = 0.1


class Simulation:
    """Simulate a boat and compare yaw rates, or heading changes within T, with a recording."""

    def __init__(self, data: Data, values: Floats, sign: float) -> None:
        """Store the rows, averaged if there are many; `values` are the likeliest unknowns."""
        rates = all(stretch.yaw_rate_rad_s is not None for stretch in data.stretches)
        data = replace(data, stretches=tuple(_single_channel(stretch, rates=rates) for stretch in data.stretches))
        lag_s = math.exp(values[LN_T])
        every = max(1, data.rows // MAX_ROWS)
        self._columns, self._sign, self._channel = Columns(data, every), sign, int(rates)
        self._rudder_rad = self._columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
        firsts = np.flatnonzero(self._columns.is_first)
        max_rows = int(np.max(np.diff(firsts, append=self._columns.is_first.size)))
        distance = 0 if rates else min(max(round(lag_s / data.median_step_s / every), 1), max(max_rows // 4, 1))
        stretch = np.cumsum(self._columns.is_first) - 1
        rows = np.arange(stretch.size - distance)
        self._first_rows = rows[stretch[rows] == stretch[rows + distance]]
        self._last_rows, self._stretch = self._first_rows + distance, stretch[self._first_rows]
        self.measured = self._heading_changes(self._columns.measured)
        self.starts_rad_s = np.zeros(firsts.size)

    def _heading_changes(self, column: Floats) -> Floats:
        return column if self._channel else column[self._last_rows] - column[self._first_rows]

    def errors(self, values: Floats, starts_rad_s: Floats | None = None) -> Floats:
        """Return simulated minus recorded turns (rows,), rad/s or rad."""
        columns, out = self._columns, np.empty((2, self._columns.step_s.size))
        model = model_of(values, self._sign)
        starts = self.starts_rad_s if starts_rad_s is None else starts_rad_s
        simulate(model, starts, columns.step_s, columns.is_first, self._rudder_rad, columns.speed_ratio, out)
        return np.nan_to_num(
            self._heading_changes(out[self._channel]) - self.measured, nan=1e3, posinf=1e3, neginf=-1e3
        )

    def fit_starts(self, values: Floats) -> float:
        """Fit the first yaw rate of each stretch, and return the mean square error [(rad/s)^2 or rad^2]."""
        for _ in range(PASSES):
            errors = self.errors(values)
            slope = (self.errors(values, self.starts_rad_s + RATE_STEP_RAD_S) - errors) / RATE_STEP_RAD_S
            variance = np.bincount(self._stretch, slope * slope, self.starts_rad_s.size)
            correction = np.bincount(self._stretch, slope * errors, self.starts_rad_s.size)
            self.starts_rad_s = self.starts_rad_s - correction / np.maximum(variance, 1e-12)
        return float(np.mean(self.errors(values) ** 2))


def _single_channel(stretch: Stretch, *, rates: bool) -> Stretch:
    """Return a stretch with yaw rates or headings only, without spikes."""
    measured, _ = replace_spikes(stretch.measured(use_headings=not rates))
    return replace(stretch, heading_rad=None if rates else measured, yaw_rate_rad_s=measured if rates else None)


def _alpha_scale(values: Floats) -> float:
    """Return (K/T)^0.5 / T, the scale of alpha: hulls that are almost unstable on course differ little in it."""
    return math.exp(0.5 * float(values[LN_K]) - 1.5 * float(values[LN_T]))


def find_best_prediction(data: Data, prior: Prior, values: Floats, sign: float, free: tuple[int, ...]) -> Floats | None:
    """Return the unknowns of the model with the best prediction, None if the likeliest one is as good."""
    simulation = Simulation(data, values, sign)
    likeliest_square = max(simulation.fit_starts(values), 1e-24)
    variance = max(float(np.var(simulation.measured)), 1e-30)
    fitted = [index for index in free if index in (LN_K, LN_T, OFFSET, EXPONENT)]
    if ALPHA in free and likeliest_square < MAX_UNEXPLAINED_WITH_CUBIC * variance:
        fitted.append(ALPHA)
    low, high = prior.low[fitted], prior.high[fitted]
    spread, weight = math.sqrt(likeliest_square), math.sqrt(data.rows / simulation.measured.size)

    def unknowns(x: Floats) -> Floats:
        """Return all unknowns from the free ones, in which alpha is scaled."""
        candidate = values.copy()
        candidate[fitted] = x
        if ALPHA in fitted:
            candidate[ALPHA] /= _alpha_scale(candidate)
        return candidate

    def residuals(x: Floats) -> Floats:
        """Return the weighted errors and the residuals of the prior."""
        candidate = unknowns(x)
        return np.concatenate((weight / spread * simulation.errors(candidate), prior.residuals(candidate)))

    best, lowest, error = values, math.inf, likeliest_square
    for shift, scaled in STARTS:
        start = values.copy()
        start[[LN_K, LN_T]] += shift
        start[ALPHA] = values[ALPHA] * _alpha_scale(values) if scaled is None else scaled
        x, spread = start[fitted], math.sqrt(likeliest_square)
        simulation.fit_starts(values)
        for _ in range(PASSES):
            x = np.clip(x, low + 1e-9, high - 1e-9)
            x = least_squares(residuals, x, bounds=(low, high), x_scale="jac", max_nfev=MAX_EVALUATIONS).x
            square = max(simulation.fit_starts(unknowns(x)), 1e-24)
            spread = math.sqrt(square)
        residual = prior.residuals(unknowns(x))
        cost = 0.5 * data.rows * math.log(square) + 0.5 * float(residual @ residual)
        if cost < lowest:
            best, lowest, error = unknowns(x), cost, square
    return (
        best if likeliest_square > error * (1.0 + MAX_EXCESS + MAX_EXCESS_OF_UNEXPLAINED * error / variance) else None
    )
