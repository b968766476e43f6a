"""Output-error fit (Ljung, System identification, 1999, 4.2): the model whose simulation is closest to the recording.

For a K-T boat in noise the likelihood (filter.py) is the better criterion, in open and closed loop. For another boat,
such as a hull with higher-order dynamics in calm water, the likelihood treats the model error as a disturbance, and its
parameters predict badly. Therefore the model with the best prediction replaces the likeliest one if its error is
smaller by more than noise and feedback explain.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from hil.lab.identify.filter import ALPHA, DELAY, EXPONENT, LAG, LN_K, LN_T, OFFSET, model_of, simulate
from hil.lab.identify.mend import without_spikes
from hil.lab.identify.prior import Prior
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretches import Columns, Data, Stretch

MAX_ROWS = 6000
# Starts: changes of ln K and ln T of the likeliest model, and the scaled alpha (see _scale), None for that of the
# likeliest model. The last one is a hull that is almost unstable on course (KVLCC2).
STARTS = ((0.0, None), (-1.0, None), (1.0, 0.3), (3.0, 3.0))
MAX_EVALUATIONS, PASSES = 40, 2
RATE_STEP_RAD_S = 1e-5
# Accepted relative excess of the error variance of the likeliest model over the smallest one. Random K-T boats had up
# to 0.04 where the rudder explains 45 %, and 0.15 where it explains less, mostly in closed loop.
EXCESS, EXCESS_OF_UNEXPLAINED = 0.05, 0.3
# Largest unexplained share of the variance with which alpha is fitted: otherwise a large alpha explains waves that the
# rudder follows.
CUBIC_UNEXPLAINED = 0.1


class Simulation:
    """Simulated and recorded yaw rates; without yaw rates, heading changes within T."""

    def __init__(self, data: Data, values: Floats, sign: float) -> None:
        """Store rows of data, averaged if there are many; `values` are the likeliest unknowns."""
        rates = all(stretch.yaw_rate_rad_s is not None for stretch in data.stretches)
        data = replace(data, stretches=tuple(_plain(stretch, rates=rates) for stretch in data.stretches))
        lag_s = math.exp(values[LN_T])
        every = max(1, data.rows // MAX_ROWS)
        self._columns, self._sign, self._channel = Columns(data, every), sign, int(rates)
        self._rudder_rad = self._columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
        firsts = np.flatnonzero(self._columns.first)
        longest = int(np.max(np.diff(firsts, append=self._columns.first.size)))
        apart = 0 if rates else min(max(round(lag_s / data.usual_step_s / every), 1), max(longest // 4, 1))
        stretch = np.cumsum(self._columns.first) - 1
        rows = np.arange(stretch.size - apart)
        self._before = rows[stretch[rows] == stretch[rows + apart]]
        self._after, self._stretch = self._before + apart, stretch[self._before]
        self.measured = self._turns(self._columns.measured)
        self.starts_rad_s = np.zeros(firsts.size)

    def _turns(self, column: Floats) -> Floats:
        return column if self._channel else column[self._after] - column[self._before]

    def errors(self, values: Floats, starts_rad_s: Floats | None = None) -> Floats:
        """Return simulated minus recorded turns (rows,), rad/s or rad."""
        columns, out = self._columns, np.empty((2, self._columns.step_s.size))
        model = model_of(values, self._sign)
        starts = self.starts_rad_s if starts_rad_s is None else starts_rad_s
        simulate(model, starts, columns.step_s, columns.first, self._rudder_rad, columns.speed_ratio, out)
        return np.nan_to_num(self._turns(out[self._channel]) - self.measured, nan=1e3, posinf=1e3, neginf=-1e3)

    def start(self, values: Floats) -> float:
        """Fit the first yaw rate of each stretch, and return the mean square error."""
        for _ in range(PASSES):
            errors = self.errors(values)
            slope = (self.errors(values, self.starts_rad_s + RATE_STEP_RAD_S) - errors) / RATE_STEP_RAD_S
            power = np.bincount(self._stretch, slope * slope, self.starts_rad_s.size)
            correction = np.bincount(self._stretch, slope * errors, self.starts_rad_s.size)
            self.starts_rad_s = self.starts_rad_s - correction / np.maximum(power, 1e-12)
        return float(np.mean(self.errors(values) ** 2))


def _plain(stretch: Stretch, *, rates: bool) -> Stretch:
    """Return a stretch with yaw rates or headings only, without spikes."""
    measured, _ = without_spikes(stretch.measured(headings=not rates))
    return replace(stretch, heading_rad=None if rates else measured, yaw_rate_rad_s=measured if rates else None)


def _scale(values: Floats) -> float:
    """Return (K/T)^0.5 / T, the scale of alpha: hulls that are almost unstable on course differ little in it."""
    return math.exp(0.5 * float(values[LN_K]) - 1.5 * float(values[LN_T]))


def nearest(data: Data, prior: Prior, values: Floats, sign: float, free: tuple[int, ...]) -> Floats | None:
    """Return the unknowns of the model with the best prediction, None if the likeliest one is as good."""
    simulation = Simulation(data, values, sign)
    likeliest = max(simulation.start(values), 1e-24)
    power = max(float(np.var(simulation.measured)), 1e-30)
    chosen = [place for place in free if place in (LN_K, LN_T, OFFSET, EXPONENT)]
    if ALPHA in free and likeliest < CUBIC_UNEXPLAINED * power:
        chosen.append(ALPHA)
    low, high = prior.low[chosen], prior.high[chosen]
    spread, weight = math.sqrt(likeliest), math.sqrt(data.rows / simulation.measured.size)

    def unknowns(x: Floats) -> Floats:
        """Return all unknowns from the free ones, in which alpha is scaled."""
        found = values.copy()
        found[chosen] = x
        if ALPHA in chosen:
            found[ALPHA] /= _scale(found)
        return found

    def residuals(x: Floats) -> Floats:
        found = unknowns(x)
        return np.concatenate((weight / spread * simulation.errors(found), prior.residuals(found)))

    best, lowest, error = values, math.inf, likeliest
    for shift, scaled in STARTS:
        start = values.copy()
        start[[LN_K, LN_T]] += shift
        start[ALPHA] = values[ALPHA] * _scale(values) if scaled is None else scaled
        x, spread = start[chosen], math.sqrt(likeliest)
        simulation.start(values)
        for _ in range(PASSES):
            x = np.clip(x, low + 1e-9, high - 1e-9)
            x = least_squares(residuals, x, bounds=(low, high), x_scale="jac", max_nfev=MAX_EVALUATIONS).x
            square = max(simulation.start(unknowns(x)), 1e-24)
            spread = math.sqrt(square)
        off = prior.residuals(unknowns(x))
        cost = 0.5 * data.rows * math.log(square) + 0.5 * float(off @ off)
        if cost < lowest:
            best, lowest, error = unknowns(x), cost, square
    return best if likeliest > error * (1.0 + EXCESS + EXCESS_OF_UNEXPLAINED * error / power) else None
