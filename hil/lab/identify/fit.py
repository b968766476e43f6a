"""From prepared data to a fitted model: search, refine, weigh, choose."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.identify.accuracy import Information, best_weights, information
from hil.lab.identify.digest import Digest, digests
from hil.lab.identify.mend import without_spikes
from hil.lab.identify.noise import fit_noise
from hil.lab.identify.predict import Point, Start
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import Problem, State, Weights, refine
from hil.lab.identify.search import Box, Found, GlobalSearch, misfit, scan, swarm_search, with_scale_of
from hil.lab.identify.stretch import Data, Stretch, excerpt, thinned

LINEAR, CUBIC = (0, 1, 3), (0, 1, 2, 3)  # free ones of ln K, ln T, alpha, delta0
ROUNDS, FINE_ROUNDS = 5, 2
SETTLED = 0.05  # of a weight, relative
NO_LAGS = np.zeros(0)
FEW_ROWS, MOST_JUDGED_ROWS = 3000, 100_000
STEPS_PER_LAG = 4.0  # averages over more of T than this part of it do not show T
PARAMETERS = 5  # K, T, alpha, delta0 and where the boat starts
MOST_LAGS = 24  # of the filter that makes a heading's noise white; what colour is left the standard errors allow for


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model with what is known of its accuracy.

    `covariance` is of the free coordinates of Point; `spikes` counts the readings that stood out of
    their neighbours once the motion was taken away.
    """

    problem: Problem
    state: State
    cost: float
    covariance: Floats
    accuracy: Information
    spikes: int
    evaluations: int
    iterations: int
    converged: bool

    @property
    def physical(self) -> Floats:
        """K, T, alpha, delta0."""
        return self.state.point.physical(self.problem.scales)

    @property
    def outlasts_log(self) -> bool:
        """Whether T is longer than the log: one such T fits it nearly as well as the next, with K/T and alpha/T."""
        return float(self.physical[1]) > self.problem.data.duration_s

    @property
    def effective_rows(self) -> float:
        """How many independent readings the coloured ones are worth."""
        return self.accuracy.effective_rows(self.problem.channel_weights())

    def typical_rate_rad_s(self) -> float:
        """Return the yaw rate that the model hardly ever exceeds in this log."""
        parts = zip(self.problem.data.stretches, self.state.starts, strict=True)
        rates = [np.abs(self.problem.motion(stretch, self.state, start)[1]) for stretch, start in parts]
        return max(float(np.quantile(np.concatenate(rates), 0.95)), 1e-12)


@dataclass(frozen=True, slots=True)
class Searched:
    """What the global search brought."""

    record: Digest
    box: Box
    found: Found


def search(
    data: Data, seed: int, globally: GlobalSearch = swarm_search, *, cubic: bool, tell: Callable[[], None]
) -> Searched:
    """Search globally, where a scan predicts best, sample by sample; the sign of K is settled by that, too."""
    likely = [(record, scan(record)) for record in digests(data)]
    few = excerpt(data, MOST_JUDGED_ROWS)
    record, box = min(likely, key=lambda one: _surprise_of(few, *one)) if len(likely) > 1 else likely[0]
    record = with_scale_of(record, box)
    return Searched(record, box, globally(record, box, seed, cubic=cubic, tell=tell))


def _surprise_of(data: Data, record: Digest, box: Box) -> float:
    """Return minus twice the logarithm of the likelihood of data, of what a scan of a digest says of them."""
    starts = tuple(first_guess(stretch) for stretch in data.stretches)
    weights = Weights(1.0, 1.0, NO_LAGS)
    problem = Problem(data, record.scales, record.scales.largest_rate_rad_s, LINEAR, weights)
    return _surprise(problem, State(box.guess, starts))


def fit(
    data: Data,
    searched: Searched,
    free: tuple[int, ...],
    begin: Point,
    tell: Callable[[], None],
    simpler: Fit | None = None,
) -> Fit:
    """Refine from a point: first on averages, which is quick, then on every sample.

    simpler: a fit of a model that this one contains, to start the second part from if it is better.
    """
    scales = searched.record.scales
    values = begin.values.copy()
    if 2 not in free:
        values[2] = 0.0
    few = _few(data, math.exp(float(values[1])))
    rates = [stretch.yaw_rate_rad_s for stretch in few.stretches if stretch.yaw_rate_rad_s is not None]
    fastest = max((float(np.max(np.abs(rate))) for rate in rates), default=3.0 * scales.yaw_rate_rad_s)
    state = State(Point(values, begin.sign), tuple(first_guess(stretch) for stretch in few.stretches))
    roughs = [
        _settled(Problem(few, scales, fastest, free, weights), state, tell, ROUNDS) for weights in _first_weights(data)
    ]
    rough = likeliest(roughs)
    if few is data:
        if simpler is None or rough.cost <= rough.problem.cost(simpler.state):
            return rough
        return _settled(rough.problem, simpler.state, tell, FINE_ROUNDS)
    state = rough.state
    if len(few.stretches) != len(data.stretches):
        state = replace(state, starts=tuple(first_guess(stretch) for stretch in data.stretches))
    every_weight = rough.problem.weights
    if data.stretches[0].yaw_rate_rad_s is None:
        every_weight = _weights(replace(rough.problem, data=data), state, rough.accuracy)
    whole = replace(rough.problem, data=data, weights=every_weight)
    if simpler is not None and whole.cost(simpler.state) < whole.cost(state):
        state = simpler.state
    fine = _settled(whole, state, tell, FINE_ROUNDS)
    return replace(
        fine, evaluations=fine.evaluations + rough.evaluations, iterations=fine.iterations + rough.iterations
    )


def best_start(searched: Searched) -> Point:
    """Return the better of what scan and swarm say of a linear model."""
    guess, swarm = searched.box.guess, searched.found.point
    values = swarm.values.copy()
    values[2] = 0.0
    flat = Point(values, swarm.sign)
    both = misfit(searched.record, np.array([guess.values, flat.values]), guess.sign)
    return guess if both[0] <= both[1] else flat


def _first_weights(data: Data) -> tuple[Weights, ...]:
    """Return the weights to begin with.

    A heading alone is begun with as it is and by its differences: the former does well in waves,
    the latter where a drift adds up, and neither can be told before the fit. With a yaw rate beside it,
    each is begun with alone: what one leaves of the other looks coloured, and can stay so.
    """
    heading, rate = 1.0 / _power(data, 0), 1.0 / _power(data, 1)
    if data.stretches[0].yaw_rate_rad_s is not None:
        return (Weights(0.0, rate, NO_LAGS, rate), Weights(heading, 0.0, NO_LAGS, rate))
    return (Weights(heading, 0.0, NO_LAGS), Weights(heading, 0.0, np.array([-1.0])))


def _few(data: Data, lag_s: float) -> Data:
    """Return the data averaged as far as a turning lag allows, and an excerpt if many rows are left."""
    longest = max(1, int(lag_s / STEPS_PER_LAG / data.usual_step_s))
    return excerpt(thinned(data, min(data.rows // FEW_ROWS, longest)), 2 * FEW_ROWS)


def _surprise(problem: Problem, state: State) -> float:
    """Return minus twice the logarithm of the likelihood of a state's errors, their colour allowed for."""
    noise = fit_noise(error_pieces(problem, state))
    rows = problem.data.rows
    return rows * float(np.linalg.slogdet(noise.covariance)[1]) + 2.0 * noise.order


def likeliest(fits: Sequence[Fit]) -> Fit:
    """Return the fit whose errors are likeliest, of those that are no worse in the yaw rate."""
    return min(_no_worse_in_rate(fits), key=lambda one: _surprise(one.problem, one.state))


def _no_worse_in_rate(fits: Sequence[Fit]) -> list[Fit]:
    """Leave out fits that pay for the heading with more error of the yaw rate than chance explains.

    At sea a heading drifts off for reasons that are not the rudder, and what follows it turns worse.
    """
    least = min(float(fitted.accuracy.noise.spread[-1]) for fitted in fits)
    rows = fits[0].problem.data.rows
    both = fits[0].accuracy.noise.spread.size > 1
    most = least * (1.0 + PARAMETERS / rows)
    return [fitted for fitted in fits if not both or float(fitted.accuracy.noise.spread[-1]) <= most]


def error_pieces(problem: Problem, state: State) -> list[Floats]:
    """Return the unfiltered errors (rows, channels) of every stretch."""
    parts = zip(problem.data.stretches, state.starts, strict=True)
    return [np.column_stack(problem.errors(stretch, state, start)) for stretch, start in parts]


def _settled(problem: Problem, state: State, tell: Callable[[], None], rounds: int) -> Fit:
    """Refine, learn the noise, weigh the channels by it, and refine again until that settles."""
    evaluations = iterations = spikes = 0
    for round_ in range(rounds):
        refined = refine(problem, state, tell)
        state = refined.state
        evaluations, iterations = evaluations + refined.evaluations, iterations + refined.iterations
        if round_ == 0:
            cleaned, spikes = _without_spikes(problem, state)
            problem = replace(problem, data=cleaned)
        accuracy = information(problem, state)
        weights = _weights(problem, state, accuracy)
        scale = float(accuracy.noise.spread[0] / accuracy.noise.spread[-1]) ** 2
        settled = _same(problem.weights, weights, scale)
        if settled and weights.heading_lags.size:
            break
        if settled or round_ < rounds - 1:
            problem = replace(problem, weights=weights)
        if settled:
            break
    covariance = accuracy.covariance(problem.channel_weights())
    return Fit(problem, state, refined.cost, covariance, accuracy, spikes, evaluations, iterations, refined.converged)


def _power(data: Data, channel: int) -> float:
    """Return the mean square of a channel, 1 without one."""
    columns = [(stretch.heading_rad, stretch.yaw_rate_rad_s)[channel] for stretch in data.stretches]
    total = sum(float(column @ column) for column in columns if column is not None)
    return max(total / data.rows, 1e-30) if columns[0] is not None else 1.0


def first_guess(stretch: Stretch) -> Start:
    """Guess where a stretch begins from its first few samples."""
    first = slice(0, min(10, stretch.time_s.size))
    time_s = stretch.time_s[first] - stretch.time_s[0]
    heading, rate = 0.0, 0.0
    if stretch.yaw_rate_rad_s is not None:
        rate = float(np.median(stretch.yaw_rate_rad_s[first]))
    if stretch.heading_rad is not None:
        heading = float(np.median(stretch.heading_rad[first] - rate * time_s))
    return Start(heading, rate)


def _without_spikes(problem: Problem, state: State) -> tuple[Data, int]:
    """Take out of the readings what stands out of its neighbours once the motion is taken away."""
    stretches, total = [], 0
    for stretch, start in zip(problem.data.stretches, state.starts, strict=True):
        errors = list(problem.errors(stretch, state, start))
        for name in ("heading_rad", "yaw_rate_rad_s"):
            column = getattr(stretch, name)
            if column is None:
                continue
            error = errors.pop(0)
            clean, count = without_spikes(error)
            total += count
            if count:
                stretch = replace(stretch, **{name: column - (error - clean)})  # noqa: PLW2901 - built up field by field
        stretches.append(stretch)
    return replace(problem.data, stretches=tuple(stretches)), total


def _weights(problem: Problem, state: State, accuracy: Information) -> Weights:
    first = problem.data.stretches[0]
    start = 1.0 / max(float(accuracy.noise.spread[-1]) ** 2, 1e-300)
    if first.heading_rad is None:
        return Weights(0.0, best_weights(accuracy)[0], NO_LAGS, start)
    if first.yaw_rate_rad_s is not None:
        heading, rate = best_weights(accuracy)
        return Weights(heading, rate, NO_LAGS, start)
    # Alone, the heading is filtered so that its noise is white: efficient, and safe against drift,
    # which would otherwise add up over the whole log.
    pieces = [
        problem.errors(stretch, state, start)[0][:, None]
        for stretch, start in zip(problem.data.stretches, state.starts, strict=True)
    ]
    model = fit_noise(pieces, MOST_LAGS)
    return Weights(1.0 / max(float(model.covariance[0, 0]), 1e-30), 0.0, model.lags[:, 0, 0].copy())


def _same(before: Weights, after: Weights, scale: float) -> bool:
    """Whether weights are as good as equal; scale is the heading's power over the yaw rate's."""
    if before.heading_lags.size != after.heading_lags.size:
        return False
    if before.heading_lags.size and np.max(np.abs(before.heading_lags - after.heading_lags)) > SETTLED:
        return False
    # Only how the channels share matters for the estimate.
    shares = [
        weights.heading * scale / max(weights.heading * scale + weights.yaw_rate, 1e-300) for weights in (before, after)
    ]
    return abs(shares[0] - shares[1]) <= SETTLED
