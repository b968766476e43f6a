"""The maximum a posteriori fit: Fisher scoring with bounds, from several starts."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

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
    OUTLIER,
    PERIOD,
    UNKNOWNS,
    WALK,
    WAVE,
    innovations,
    model_of,
    scores,
)
from hil.lab.identify.output_error import nearest
from hil.lab.identify.prior import LOW, Prior
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretches import Columns, Data, excerpt

START_LAGS_S = (0.3, 1.0, 4.0, 12.0, 50.0)
START_TURN = 0.3  # initial K T
START_ROWS, START_ITERATIONS = 1500, 10
MAX_ITERATIONS, CONVERGED = 60, 1e-3  # change of the cost
NULL_CONVERGED = 0.5
ROWS_PER_LAG, ROWS_PER_WAVE = 12.0, 8.0  # after averaging
SIGN_COST = 6.0  # a reversed rudder is unlikely
MAX_STEP = 1.5  # of a logarithm
SPEED_SPREAD = 0.005  # relative; a smaller variation has no effect
LEVELS = (DIFFUSION, WAVE, PERIOD, DAMPING, WALK)
STEP = 1e-4  # of finite differences
CUBIC_STEP = 5e-6  # of alpha K^2

Report = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Fit:
    """The unknowns at the maximum, the sign of K, which unknowns are free, their covariance and the prior's part in it.

    gain: difference of the log posterior density to that of a boat without rudder effect. likeliest: whether the values
    are those of the maximum, and not those that predict the recording better (output_error.py).
    """

    values: Floats
    sign: float
    free: tuple[int, ...]
    covariance: Floats
    prior_share: Floats
    gain: float
    outliers: int
    evaluations: int
    likeliest: bool

    def spread(self, place: int) -> float:
        """Return the standard deviation of an unknown, 0 for a fixed one."""
        if place not in self.free:
            return 0.0
        at = self.free.index(place)
        return math.sqrt(max(float(self.covariance[at, at]), 0.0))

    def share(self, place: int) -> float:
        """Return the share of the prior in the information on an unknown, from 0 to 1."""
        return float(self.prior_share[self.free.index(place)]) if place in self.free else 1.0

    def per_unit(self, size: float) -> Fit:
        """Return the fit for a rudder column that is 1 / size times as large."""
        values, turn = self.values.copy(), np.eye(len(self.free))
        values[LN_K] += math.log(size)
        values[OFFSET] /= size
        at = self.free.index(OFFSET)
        turn[at, at] = 1.0 / size
        return replace(self, values=values, covariance=turn @ self.covariance @ turn)

    def model(self) -> Floats:
        """Return K, T, alpha, delta0 and the exponent of the speed."""
        return model_of(self.values, self.sign)


class Posterior:
    """The posterior density of the unknowns, given columns."""

    def __init__(self, columns: Columns, prior: Prior, pool: ThreadPoolExecutor) -> None:
        """Store measurements, prior and thread pool."""
        self._columns, self.prior, self._pool = columns, prior, pool
        self.evaluations = 0

    def innovations(self, values: Floats, sign: float) -> Floats:
        """Return innovations and their variances, (2, rows)."""
        columns, out = self._columns, np.empty((2, self._columns.step_s.size))
        rudder = columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
        self.evaluations += 1
        innovations(
            values, sign, columns.step_s, columns.first, columns.measured, rudder, columns.speed_ratio,
            columns.headings, out,
        )  # fmt: skip
        return out

    def cost(self, values: Floats, found: Floats) -> float:
        """Return minus the log density up to a constant; infinite if the filter fails."""
        innovation, variance = found
        if not np.all(variance > 0.0):
            return math.inf
        likelihood = 0.5 * float(np.sum(np.log(variance) + np.minimum(innovation**2 / variance, OUTLIER)))
        cost = likelihood + self.prior.cost(values)
        return cost if math.isfinite(cost) else math.inf

    def derivatives(
        self, values: Floats, sign: float, free: Sequence[int], base: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return gradient, Fisher information of the likelihood and curvature of the prior."""
        by = np.array([_difference(values, place) for place in free])

        def moved(number: int) -> Floats:
            shifted = values.copy()
            shifted[free[number]] += by[number]
            return self.innovations(shifted, sign)

        found = np.array(list(self._pool.map(moved, range(len(free)))))
        gradient, information = np.zeros(len(free)), np.zeros((len(free), len(free)))
        scores(base, found, by, gradient, information)
        information += np.tril(information, -1).T
        slope, curvature = self.prior.derivatives(values)
        chosen = np.array(free)
        return gradient + slope[chosen], information, curvature[np.ix_(chosen, chosen)]

    def climb(
        self,
        values: Floats,
        sign: float,
        free: Sequence[int],
        report: Report,
        most: int = MAX_ITERATIONS,
        settled: float = CONVERGED,
    ) -> tuple[Floats, float]:
        """Return the maximum found from a start, and its cost."""
        chosen, low, high = np.array(free), self.prior.low, self.prior.high
        values = np.clip(values, low, high)
        base = self.innovations(values, sign)
        cost, damping = self.cost(values, base), 1e-2
        longest = np.array([{OFFSET: 0.3, ALPHA: math.inf}.get(place, MAX_STEP) for place in free])
        for _ in range(most):
            report()
            gradient, information, curvature = self.derivatives(values, sign, free, base)
            hessian = information + curvature
            pushed = ((values[chosen] <= low[chosen] + 1e-12) & (gradient > 0.0)) | (
                (values[chosen] >= high[chosen] - 1e-12) & (gradient < 0.0)
            )
            loose = np.flatnonzero(~pushed)
            better = math.inf
            while damping < 1e6 and not better < cost:
                matrix = hessian[np.ix_(loose, loose)]
                step = np.zeros(len(free))
                step[loose] = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient[loose])
                step *= min(1.0, float(np.min(longest / np.maximum(np.abs(step), 1e-300))))
                trial = values.copy()
                trial[chosen] += step
                trial = np.clip(trial, low, high)
                found = self.innovations(trial, sign)
                better = self.cost(trial, found)
                damping *= 1.0 if better < cost else 5.0
            if not better < cost:
                return values, cost
            gained = cost - better
            values, cost, base, damping = trial, better, found, max(damping / 5.0, 1e-6)
            if gained < settled and damping < 1.0:
                break
        return values, cost


def _difference(values: Floats, place: int) -> float:
    if place == ALPHA:
        return max(STEP * float(values[ALPHA]), CUBIC_STEP * math.exp(-2.0 * float(values[LN_K])))
    return {OFFSET: 1e-5, DELAY: 1e-3, LAG: 1e-3}.get(place, STEP)


def fit(data: Data, *, cubic: bool, exponent: float | None, report: Report) -> Fit:
    """Fit the model; `exponent` is that of the speed, None to estimate it."""
    headings = all(stretch.heading_rad is not None for stretch in data.stretches)
    free = [LN_K, LN_T, *([ALPHA] if cubic else []), OFFSET, DELAY, LAG]
    varies = float(np.std(np.concatenate([stretch.speed_ratio for stretch in data.stretches]))) > SPEED_SPREAD
    if exponent is None and varies:
        free.append(EXPONENT)
    free += [*LEVELS, COMPASS if headings else GYRO]
    held = 1.0 if exponent is None else exponent
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(free))) as pool:
        values, sign, spent = _started(data, free, held, pool, report)
        lag_s = math.exp(values[LN_T])
        every = max(1, int(min(lag_s / ROWS_PER_LAG, math.exp(values[PERIOD]) / ROWS_PER_WAVE) / data.usual_step_s))
        columns = Columns(data, every)
        for _ in range(2):  # the scales of the prior depend on T
            posterior = Posterior(columns, _prior(data, math.exp(values[LN_T])), pool)
            values, cost = posterior.climb(values, sign, free, report)
            spent += posterior.evaluations
        base = posterior.innovations(values, sign)
        _, information, curvature = posterior.derivatives(values, sign, free, base)
        still = values.copy()
        still[LN_K], still[ALPHA] = LOW[LN_K], 0.0
        null = posterior.climb(still, sign, free[-len(LEVELS) - 1 :], report, START_ITERATIONS, NULL_CONVERGED)
        without = null[1] - posterior.prior.cost(null[0])
        with_ = cost - posterior.prior.cost(values)
    covariance: Floats = np.asarray(np.linalg.inv(information + curvature), dtype=np.float64)
    share = np.diag(covariance @ curvature @ covariance) / np.diag(covariance)
    outliers = int(np.count_nonzero(base[0] ** 2 > OUTLIER * base[1]))
    best = nearest(data, posterior.prior, values, sign, tuple(free))
    if best is not None:  # model error: the distance of both solutions
        apart = (best - values)[free]
        covariance, values = covariance + np.outer(apart, apart), best
    return Fit(
        values, sign, tuple(free), covariance, share, without - with_, outliers,
        spent + posterior.evaluations, best is None,
    )  # fmt: skip


def _prior(data: Data, lag_s: float) -> Prior:
    return Prior.of(lag_s, data.usual_step_s, float(np.std(data.rudder_rad)))


def _started(
    data: Data, free: Sequence[int], exponent: float, pool: ThreadPoolExecutor, report: Report
) -> tuple[Floats, float, int]:
    """Return the best result of a few iterations on an excerpt from several T and both signs of K."""
    longest = max(1, int(0.4 / data.usual_step_s))
    every = min(max(1, data.rows // START_ROWS), longest)
    few = excerpt(data, START_ROWS * every)
    columns, spent = Columns(few, every), 0
    best: tuple[float, Floats, float] = (math.inf, np.zeros(UNKNOWNS), 1.0)
    lags = [lag_s for lag_s in START_LAGS_S if 0.3 * data.usual_step_s <= lag_s <= 0.3 * few.duration_s] or [
        max(data.usual_step_s, 0.1 * few.duration_s)
    ]

    def tried(lag_s: float, sign: float) -> None:
        nonlocal best, spent
        posterior = Posterior(columns, _prior(data, lag_s), pool)
        start = posterior.prior.start(START_TURN / lag_s, lag_s)
        start[EXPONENT] = exponent
        values, cost = posterior.climb(start, sign, free, report, START_ITERATIONS)
        cost += SIGN_COST * (sign < 0.0)
        spent += posterior.evaluations
        if cost < best[0]:
            best = (cost, values, sign)

    for lag_s in lags:
        tried(lag_s, 1.0)
    for lag_s in {lags[0], min(lags, key=lambda one: abs(math.log(one) - best[1][LN_T]))}:
        tried(lag_s, -1.0)
    return best[1], best[2], spent
