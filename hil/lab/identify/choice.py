"""Which model the evidence is for: linear or cubic, and scaled to the measured speed or not, judged together.

All rivals are refined in one metric, so that they are compared by errors of the same channels. What alpha takes off
the cost is counted in the noise of the best rival, at the linear model: the test then holds where K, T and alpha are
known as ratios only, and a missing alpha does not pass for coloured noise. What is nearly even is left to prediction
of parts of the log that were not fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hil.lab.identify.accuracy import information
from hil.lab.identify.fit import CUBIC, LINEAR, Fit, Searched, best_start, first_guess, fit, likeliest
from hil.lab.identify.noise import NoiseModel
from hil.lab.identify.recording import LEAST_ROWS, Floats
from hil.lab.identify.refine import Problem, Refined, State, refine
from hil.lab.identify.stretch import Data, Stretch

# In -2 ln likelihood: 95 %, where alpha is zero at the edge of what it can be, and half of all logs of such a boat put
# it below (Self & Liang, J. Am. Stat. Assoc. 82, 1987, case 5).
NEEDED = 2.71
DECISIVE = 10.0  # beyond, a prediction need not be asked
EQUAL_LIKELIHOOD = 4.0  # a hull is believed to follow similarity unless a constant model is better by this
FEW_READINGS = 80.0
FOLDS, FOLD_LAGS = 4, 25.0
CERTAIN = 2.0  # standard errors, that one model must predict better by


@dataclass(frozen=True, slots=True)
class Rival:
    """A fit, whether its data follow the measured speed, and its state and cost in the metric of all rivals."""

    fit: Fit
    scaled: bool
    problem: Problem
    state: State
    cost: float

    @property
    def cubic(self) -> bool:
        """Whether alpha is free."""
        return self.fit.problem.free == CUBIC

    @property
    def stable(self) -> bool:
        """Whether it is a boat: with a negative alpha she would spin up without end."""
        return not (self.cubic and float(self.state.point.values[2]) <= 0.0)


@dataclass(frozen=True, slots=True)
class Chosen:
    """The fit taken, whether it is scaled, the reasons, and how many simulations it took."""

    fit: Fit
    scaled: bool
    model: str
    why: str
    speed_why: str
    evaluations: int


def choose(rivals_of: Sequence[tuple[Data, bool]], searched: Searched, model: str, tell: Callable[[], None]) -> Chosen:
    """Fit what was asked for to data scaled or not, and choose.

    rivals_of: the data, and whether they are scaled; one pair or, to be chosen from, two.
    """
    fits: list[tuple[Fit, bool]] = []
    for data, scaled in rivals_of:
        linear = fit(data, searched, LINEAR, best_start(searched), tell)
        fits.append((linear, scaled))
        if model != "linear":
            fits.append((fit(data, searched, CUBIC, searched.found.point, tell, linear), scaled))
    spent = sum(one.evaluations for one, _ in fits)
    if len(fits) == 1:
        return Chosen(fits[0][0], fits[0][1], "linear", "as asked for", "", spent)
    if len(rivals_of) == 1 and float(fits[-1][0].state.point.values[2]) <= 0.0:
        return Chosen(fits[0][0], fits[0][1], *_held_at_zero(model), "", spent)
    rivals, more = _in_one_metric(fits)
    best = {scaled: _best_of([one for one in rivals if one.scaled == scaled], model) for _, scaled in rivals_of}
    taken, speed_why = _scaled_or_not(best)
    name, why = _reason(taken.rival, taken.gain, taken.predicted, model)
    return Chosen(taken.rival.fit, taken.rival.scaled, name, why, speed_why, spent + more)


@dataclass(frozen=True, slots=True)
class _Best:
    """The rival taken of one scaling; what alpha gains there, what prediction said, and the readings' worth."""

    rival: Rival
    gain: float
    predicted: str
    inflation: float


def _in_one_metric(fits: Sequence[tuple[Fit, bool]]) -> tuple[list[Rival], int]:
    """Refine all fits with the weights of the likeliest.

    A linear fit whose missing alpha shows in the heading alone trusts it less, and would judge alpha without it.
    """
    weights = likeliest([one for one, _ in fits]).problem.weights
    rivals: list[Rival] = []
    spent = 0
    for one, scaled in fits:
        problem = replace(one.problem, weights=weights)
        ends = [refine(problem, one.state)]
        if rivals and rivals[-1].scaled == scaled:
            ends.append(refine(problem, State(rivals[-1].state.point, rivals[-1].state.starts)))
        spent += sum(end.evaluations for end in ends)
        end = min(ends, key=lambda found: found.cost)
        rivals.append(Rival(one, scaled, problem, end.state, end.cost))
    return rivals, spent


def _best_of(rivals: Sequence[Rival], model: str) -> _Best:
    """Choose between linear and cubic of one scaling."""
    linear, cubic = rivals[0], rivals[-1]
    noise = information(cubic.problem, cubic.state).noise
    by_alpha, by_gain = inflation(replace(linear.problem, free=CUBIC), linear.state, noise)
    if linear is cubic:
        return _Best(linear, 0.0, "", by_gain)
    gain = max(linear.cost - cubic.cost, 0.0) / by_alpha
    if not cubic.stable:
        return _Best(linear, -gain, "", by_gain)
    if model == "cubic":
        return _Best(cubic, gain, "", by_gain)
    if gain <= NEEDED or gain > DECISIVE:
        return _Best(cubic if gain > NEEDED else linear, gain, "", by_gain)
    differences = _predicted(linear, cubic)
    if differences is not None and _worse(differences):
        return _Best(linear, gain, "but predicts what it was not fitted to worse", by_gain)
    return _Best(cubic, gain, "", by_gain)


def inflation(problem: Problem, state: State, noise: NoiseModel) -> tuple[float, float]:
    """Return what one unit of -2 ln likelihood is in the cost: for alpha, and for K and T."""
    known = information(problem, state, noise)
    weights = problem.channel_weights()
    robust, plain = known.covariance(weights), known.inverse(weights)
    place, both = CUBIC.index(2), slice(0, 2)
    by_alpha = float(robust[place, place] / max(float(plain[place, place]), 1e-300))
    logs = np.linalg.slogdet(robust[both, both])[1] - np.linalg.slogdet(plain[both, both])[1]
    by_gain = math.exp(0.5 * float(logs)) if math.isfinite(float(logs)) else by_alpha
    return max(by_alpha, 1e-300), max(by_gain, 1e-300)


def _scaled_or_not(best: dict[bool, _Best]) -> tuple[_Best, str]:
    """Choose between following the measured speed and not.

    Similarity is what is to be expected of a hull, so a constant model must be better to be taken. But a log of few
    readings has seen one slowing down or two, which whatever else changes by the time is taken for, and a rudder
    behind a propeller loses less with her speed than similarity says: it is not carried to other speeds on trust.
    """
    if len(best) == 1:
        return next(iter(best.values())), ""
    scaled, constant = best[True], best[False]
    least = min(scaled, constant, key=lambda one: one.rival.cost)
    parameters = NEEDED * (constant.rival.cubic - scaled.rival.cubic)
    ratio = constant.rival.cost / max(scaled.rival.cost, 1e-300)
    gain = least.rival.cost * math.log(max(ratio, 1e-300)) / least.inflation + parameters
    against = f"against a model that does not change with the speed: {gain:+.0f} in -2 ln likelihood"
    readings = scaled.rival.fit.effective_rows
    if readings < FEW_READINGS:
        few = f"{readings:.0f} independent readings are too few to trust a scaling"
        return constant, f"not scaled: {few} ({gain:+.0f} in -2 ln likelihood)"
    if gain < -DECISIVE:
        return constant, f"not scaled ({against})"
    differences = _predicted(constant.rival, scaled.rival) if gain < DECISIVE else None
    if differences is not None and _worse(differences):
        return constant, f"not scaled: what was not fitted is predicted worse by a scaled model ({against})"
    if gain < -EQUAL_LIKELIHOOD and not (differences is not None and _worse(-differences)):
        return constant, f"not scaled ({against})"
    return scaled, f"scaled to the measured speed ({against})"


def _reason(rival: Rival, gain: float, predicted: str, model: str) -> tuple[str, str]:
    if model == "linear":
        return "linear", "as asked for"
    if model == "cubic" and rival.cubic:
        return "cubic", "as asked for"
    if model == "cubic" or gain < 0.0:
        return _held_at_zero(model)
    size = f"alpha takes {gain:.1f} off -2 ln likelihood; {NEEDED:g} are needed"
    if rival.cubic:
        return "cubic", size
    return "linear", f"{size}{', ' if predicted else ''}{predicted}; the errors of K and T allow for what does not show"


def _held_at_zero(model: str) -> tuple[str, str]:
    """Name and explain the model whose alpha would be below zero, against all that is known of hulls."""
    below = "alpha would be below zero"
    return ("cubic", f"as asked for; {below}, so it is held at zero") if model == "cubic" else ("linear", below)


def _worse(differences: Floats) -> bool:
    """Whether folds, of what one model costs more than another, say so for certain."""
    mean, spread = float(differences.mean()), float(differences.std(ddof=1)) / math.sqrt(differences.size)
    return mean > CERTAIN * spread


def _predicted(one: Rival, other: Rival) -> Floats | None:
    """Return what the other costs more in predicting each fold from a fit to the rest, None for too short a log."""
    data, lag_s = one.problem.data, math.exp(float(one.state.point.values[1]))
    if data.duration_s < FOLDS * FOLD_LAGS * lag_s or data.rows < 2 * FOLDS * LEAST_ROWS:
        return None
    costs = [_fold_costs(rival) for rival in (one, other)]
    return np.asarray(costs[1] - costs[0])


def _fold_costs(rival: Rival) -> Floats:
    data = rival.problem.data
    bounds = np.linspace(0, data.rows, FOLDS + 1).astype(int).tolist()
    costs = []
    for low, high in pairwise(bounds):
        seen = (*_rows_of(data, 0, low), *_rows_of(data, high, data.rows))
        unseen = _rows_of(data, low, high)
        found = _refined(rival.problem, seen, rival.state).state
        costs.append(_refined(replace(rival.problem, free=()), unseen, found).cost)
    return np.array(costs)


def _refined(problem: Problem, stretches: tuple[Stretch, ...], state: State) -> Refined:
    starts = tuple(first_guess(stretch) for stretch in stretches)
    return refine(replace(problem, data=replace(problem.data, stretches=stretches)), State(state.point, starts))


def _rows_of(data: Data, low: int, high: int) -> tuple[Stretch, ...]:
    """Return what stretches have of the rows from low to high, counted over all of them."""
    parts, first = [], 0
    for stretch in data.stretches:
        begin, end = max(low - first, 0), min(high - first, stretch.time_s.size)
        if end - begin >= LEAST_ROWS:
            parts.append(stretch.part(slice(begin, end)))
        first += stretch.time_s.size
    return tuple(parts)
