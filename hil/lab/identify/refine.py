"""Levenberg-Marquardt on the weighted output error, the initial states of all stretches included."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.identify.kernel import normal_equations
from hil.lab.identify.noise import whitened, whitening_taps
from hil.lab.identify.predict import (
    DIFFERENCE,
    Point,
    Scales,
    Start,
    inner_steps,
    perturbed,
    sensitivities,
    trajectories,
)
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretch import Data, Stretch

MOST_ITERATIONS = 40
SMALL_GAIN = 1e-4  # of the noise's variance: a step that promises less is a hundredth of the standard errors
DAMPING_RANGE = (1e-9, 1e9)
LONGEST_MOVE = 1.0  # of ln K and ln T in one iteration
LONGEST_LAG = 30.0  # of the longest stretch; nothing tells a longer T from an endless one
SPIN = 0.25  # -alpha r^2 at the largest yaw rate; from 1/3 on the equation has no rest
LOWEST = np.array([-25.0, math.log(0.01), -SPIN, -50.0])
HIGHEST = np.array([25.0, math.log(2e4), 1e4, 50.0])


@dataclass(frozen=True, slots=True)
class Weights:
    """How much a squared error counts: of heading [1/rad^2], of yaw rate [s^2/rad^2].

    `heading_lags` is the filter that makes the heading's noise white, empty when it is white. `start` is of the
    initial yaw rate's difference from the first reading, where there is one [s^2/rad^2].
    """

    heading: float
    yaw_rate: float
    heading_lags: Floats
    start: float = 0.0


@dataclass(frozen=True, slots=True)
class State:
    """A fit under way: the candidate and where each stretch starts."""

    point: Point
    starts: tuple[Start, ...]


@dataclass(frozen=True, slots=True)
class Linear:
    """One stretch around a state: errors and sensitivities (rows, parameters) of the channels in use.

    Filtered by heading_lags where there are any; local columns last (initial heading and yaw rate).
    """

    errors: tuple[Floats, ...]
    slopes: tuple[Floats, ...]


@dataclass(frozen=True, slots=True)
class Normal:
    """J'WJ and J'We over the free parameters and the starts of all stretches, and the cost e'We."""

    matrix: Floats
    slope: Floats
    cost: float


@dataclass(frozen=True, slots=True)
class Refined:
    """Where the refinement ended."""

    state: State
    cost: float
    iterations: int
    evaluations: int
    converged: bool


@dataclass(frozen=True, slots=True)
class Problem:
    """Data, scales, which of ln K, ln T, alpha, delta0 are free, and the weights."""

    data: Data
    scales: Scales
    largest_rate_rad_s: float
    free: tuple[int, ...]
    weights: Weights

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the least and largest of all four coordinates."""
        lowest, highest = LOWEST.copy(), HIGHEST.copy()
        lowest[2] = -SPIN * min((self.scales.yaw_rate_rad_s / self.scales.largest_rate_rad_s) ** 2, 1.0)
        duration_s = max(float(stretch.time_s[-1] - stretch.time_s[0]) for stretch in self.data.stretches)
        highest[1] = min(highest[1], math.log(LONGEST_LAG * duration_s))
        return lowest, highest

    def channel_weights(self) -> tuple[float, ...]:
        """Return the weights of the channels that the data has, heading first."""
        first = self.data.stretches[0]
        pairs = ((first.heading_rad, self.weights.heading), (first.yaw_rate_rad_s, self.weights.yaw_rate))
        return tuple(weight for column, weight in pairs if column is not None)

    def _weights_of(self, stretch: Stretch) -> Floats:
        """Return the weights of heading and yaw rate, 0 for what was not measured."""
        heading = 0.0 if stretch.heading_rad is None else self.weights.heading
        return np.array([heading, 0.0 if stretch.yaw_rate_rad_s is None else self.weights.yaw_rate])

    def linear(self, stretch: Stretch, state: State, start: Start) -> Linear:
        """Linearise one stretch."""
        candidate = state.point.candidate(self.scales)
        steps = inner_steps(stretch, candidate, self.largest_rate_rad_s)
        heading, rate, by_heading, by_rate = sensitivities(stretch, state.point, self.scales, start, self.free, steps)
        errors, slopes = [], []
        if stretch.heading_rad is not None:
            errors.append(whitened(stretch.heading_rad - heading, self.weights.heading_lags))
            slopes.append(whitened(by_heading, self.weights.heading_lags))
        if stretch.yaw_rate_rad_s is not None:
            errors.append(stretch.yaw_rate_rad_s - rate)
            slopes.append(by_rate)
        return Linear(tuple(errors), tuple(slopes))

    def motion(self, stretch: Stretch, state: State, start: Start) -> tuple[Floats, Floats]:
        """Return the heading and the yaw rate of the model."""
        candidate = state.point.candidate(self.scales)
        steps = inner_steps(stretch, candidate, self.largest_rate_rad_s)
        heading, rate = trajectories(stretch, candidate[:, None], (start,), steps)
        return heading[:, 0], rate[:, 0]

    def errors(self, stretch: Stretch, state: State, start: Start) -> tuple[Floats, ...]:
        """Return the errors of the channels, unfiltered."""
        columns = (stretch.heading_rad, stretch.yaw_rate_rad_s)
        motion = self.motion(stretch, state, start)
        return tuple(column - values for column, values in zip(columns, motion, strict=True) if column is not None)

    def _start_apart(self, stretch: Stretch, start: Start) -> float:
        """Return what the first reading of the yaw rate exceeds the initial one by; 0 where none was measured.

        Where the yaw rate has no weight of its own, as where it is full of waves, the start would else be free.
        """
        return 0.0 if stretch.yaw_rate_rad_s is None else float(stretch.yaw_rate_rad_s[0]) - start.yaw_rate_rad_s

    def cost(self, state: State) -> float:
        """Return the weighted sum of squared errors."""
        total = 0.0
        for stretch, start in zip(self.data.stretches, state.starts, strict=True):
            found = self.errors(stretch, state, start)
            if stretch.heading_rad is not None:
                found = (whitened(found[0], self.weights.heading_lags), *found[1:])
            for error, weight in zip(found, self.channel_weights(), strict=True):
                total += weight * float(error @ error)
            total += self.weights.start * self._start_apart(stretch, start) ** 2
        return total

    def normal(self, state: State) -> Normal:
        """Return the normal equations around a state."""
        free, count = len(self.free), len(self.data.stretches)
        cost = 0.0
        matrix, slope = np.zeros((free + 2 * count,) * 2), np.zeros(free + 2 * count)
        taps = whitening_taps(self.weights.heading_lags)
        for index, (stretch, start) in enumerate(zip(self.data.stretches, state.starts, strict=True)):
            places = np.array([*range(free), free + 2 * index, free + 2 * index + 1])
            here, down = np.empty((free + 2, free + 2)), np.empty(free + 2)
            candidates, first = perturbed(state.point, self.scales, start, self.free)
            cost += normal_equations(
                stretch.step_s,
                stretch.rudder_rad,
                stretch.rudder_end_rad,
                stretch.speed_ratio,
                inner_steps(stretch, state.point.candidate(self.scales), self.largest_rate_rad_s),
                candidates,
                first,
                stretch.measured(),
                self._weights_of(stretch),
                taps,
                DIFFERENCE,
                here,
                down,
            )
            if stretch.yaw_rate_rad_s is not None:
                apart, unit = self._start_apart(stretch, start), self.scales.yaw_rate_rad_s
                cost += self.weights.start * apart**2
                here[-1, -1] += self.weights.start * unit**2
                down[-1] += self.weights.start * unit * apart
            matrix[np.ix_(places, places)] += here
            slope[places] += down
        return Normal(matrix, slope, cost)


def refine(problem: Problem, state: State, tell: Callable[[], None] = lambda: None) -> Refined:
    """Go downhill from a state until a step no longer matters; never uphill, never beyond the bounds."""
    here = problem.normal(state)
    damping, simulations = 1e-4, 1
    columns = len(problem.free) + 2
    small = SMALL_GAIN / problem.data.rows
    for iteration in range(1, MOST_ITERATIONS + 1):
        tell()
        diagonal = np.diag(here.matrix).copy()
        # A parameter that nothing depends on is left where it is.
        diagonal[diagonal <= 1e-14 * max(float(diagonal.max()), 1e-300)] = max(float(diagonal.max()), 1e-300)
        gain = 0.0
        while True:
            step = _step(problem, state, here.matrix + damping * np.diag(diagonal), here.slope)
            if float(step @ here.slope) <= small * here.cost:
                break
            tried = moved(problem, state, step)
            there = problem.normal(tried)
            simulations += 1
            if there.cost <= here.cost:
                gain, state, here = here.cost - there.cost, tried, there
                damping = max(damping / 30.0, DAMPING_RANGE[0])
                break
            if damping >= DAMPING_RANGE[1]:
                break
            damping = max(10.0 * damping, 1e-6)
        if gain <= small * here.cost:
            return Refined(state, here.cost, iteration, simulations * columns, converged=damping < 1.0)
    return Refined(state, here.cost, MOST_ITERATIONS, simulations * columns, converged=False)


def _step(problem: Problem, state: State, matrix: Floats, slope: Floats) -> Floats:
    """Solve for a step that leads no parameter further out of bounds that it already stands at."""
    low, high = problem.bounds()
    values = state.point.values
    held = np.zeros(slope.size, dtype=bool)
    step = np.linalg.solve(matrix, slope)
    for _ in problem.free:
        out = [
            (values[name] >= high[name] and step[place] > 0.0) or (values[name] <= low[name] and step[place] < 0.0)
            for place, name in enumerate(problem.free)
        ]
        if not any(out):
            break
        held[: len(out)] |= out
        step = np.zeros(slope.size)
        step[~held] = np.linalg.solve(matrix[np.ix_(~held, ~held)], slope[~held])
    return np.asarray(step)


def moved(problem: Problem, state: State, step: Floats) -> State:
    """Return a state after a step of the free parameters and the starts, or of the part of it that is believed."""
    free = list(problem.free)
    values = state.point.values.copy()
    move = step[: len(free)]
    longest = float(np.max(np.abs(move[:2]), initial=0.0))
    values[free] += move * min(1.0, LONGEST_MOVE / longest) if longest > 0.0 else move
    values[free] = np.clip(values, *problem.bounds())[free]
    starts = [
        Start(
            start.heading_rad + float(step[len(free) + 2 * index]),
            start.yaw_rate_rad_s + float(step[len(free) + 2 * index + 1]) * problem.scales.yaw_rate_rad_s,
        )
        for index, start in enumerate(state.starts)
    ]
    return State(replace(state.point, values=values), tuple(starts))
