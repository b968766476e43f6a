"""What the equation leaves out between rudder and turning, a dead time or slack, and what that does to K and T."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.identify.accuracy import information_of, linearised, slow_noise
from hil.lab.identify.fit import CUBIC, Fit
from hil.lab.identify.noise import NoiseModel, whitened
from hil.lab.identify.predict import Start, to_natural
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import Linear, Problem, State, moved, refine
from hil.lab.identify.stretch import Stretch

CERTAIN = 3.0  # standard errors
MATTERS = 0.02  # of K or T
SLACKS = (0.02, 0.04, 0.08, 0.16, 0.32)  # of half of the rudder's swing, that are tried
ROUNDS = 3
NEAR = 1.6  # times as much or as little as was tried: what a motion that is slack by that still stands for

Motion = tuple[Floats, Floats]  # heading and yaw rate


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A dead time [s], or slack [rudder]; how ln K, ln T, alpha r^2 and delta0 would move with it, and the state then.

    `errors` is how many standard errors it is away from nought.
    """

    size: float
    is_slack: bool
    moved: Floats
    state: State
    errors: float
    swing: float  # of the rudder, from side to side

    def motion(self, problem: Problem, stretch: Stretch, start: Start) -> Motion:
        """Return the heading and the yaw rate of a model that has it."""
        if self.is_slack:
            return problem.motion(_slack(stretch, self.size), self.state, start)
        heading, rate = problem.motion(stretch, self.state, start)
        return heading - self.size * rate, rate - self.size * np.gradient(rate, stretch.time_s)

    def warning(self) -> str:
        """Return what to tell of it, nothing where it hardly changes K or T."""
        if float(np.max(np.abs(self.moved[:2]))) < MATTERS:
            return ""
        gain, lag = (100.0 * (math.exp(min(float(one), 1.0)) - 1.0) for one in self.moved[:2])
        if self.is_slack:
            share = 100.0 * self.size / self.swing
            what = f"she answers as if {share:.2g} % of the rudder's swing were lost in slack when it turns back"
        elif self.size > 0.0:
            what = (
                f"she answers {self.size:.2g} s later than the rudder column says, as of a compass or a servo that is "
                "late, a course over ground for the heading, or a second lag"
            )
        else:
            what = f"she answers {-self.size:.2g} s sooner than the rudder column says, as of a late rudder feedback"
        change = f"allowing for it changes K by {gain:+.2g} % and T by {lag:+.2g} %"
        return f"{what}; {change}, and the standard errors count that"


def left_out_of(fit: Fit) -> LeftOut | None:
    """Take one Gauss-Newton step with a dead time that is free, too, and one with slack; return the surer one.

    None where none is certain.
    """
    noise = slow_noise(fit.problem, fit.state, fit.accuracy.noise)
    found = [_judged(fit, [_late(*one) for one in zip(_motions(fit), fit.problem.data.stretches, strict=True)], noise)]
    for share in SLACKS:
        width = share * fit.problem.scales.rudder_rad
        slack = _judged(fit, _slower(_motions(fit), _motions(fit, width), width), noise)
        if width / NEAR < slack.size < width * NEAR:
            found.append(replace(slack, is_slack=True))
    best = max(found, key=lambda one: one.errors)
    if not best.errors > CERTAIN:
        return None
    return _settled(fit, best, noise) if best.is_slack else best


def _settled(fit: Fit, slack: LeftOut, noise: NoiseModel) -> LeftOut:
    """Fit slack and all coordinates in turn: one step does not lead far enough, and alpha looks much like it."""
    size, state = slack.size, slack.state
    fit = replace(fit, problem=replace(fit.problem, free=CUBIC))
    begin = fit.state.point
    for _ in range(ROUNDS):
        here = replace(fit, problem=_slackened(fit.problem, size), state=state)
        here = replace(here, state=refine(here.problem, state).state)
        state, more = here.state, 0.1 * size
        step = _judged(
            here, _slower(_motions(here), _motions(replace(fit, state=state), size + more), more), noise
        ).size
        size = min(max(size + step, size / NEAR), size * NEAR)
    apart = to_natural(state.point, CUBIC)[0] - to_natural(begin, CUBIC)[0]
    # A plan that repeats one angle loses the same of each: that is K's, and hardly to be told from it.
    apart[0] = math.copysign(max(abs(float(apart[0])), size / slack.swing), float(apart[0]))
    return replace(slack, size=size, state=state, moved=apart)


def _motions(fit: Fit, width: float = 0.0) -> list[Motion]:
    """Return the model's motions in all stretches, with so much slack."""
    problem = _slackened(fit.problem, width)
    parts = zip(problem.data.stretches, fit.state.starts, strict=True)
    return [problem.motion(stretch, fit.state, start) for stretch, start in parts]


def _late(motion: Motion, stretch: Stretch) -> Motion:
    """Return what a dead time does to heading and yaw rate: minus their own rates."""
    return -motion[1], -np.gradient(motion[1], stretch.time_s)


def _slower(before: Sequence[Motion], after: Sequence[Motion], width: float) -> list[Motion]:
    """Return what slack does to heading and yaw rate, for each unit of it."""
    pairs = zip(before, after, strict=True)
    return [((new[0] - old[0]) / width, (new[1] - old[1]) / width) for old, new in pairs]


def _with(fit: Fit, more: Sequence[Motion]) -> list[Linear]:
    """Return linearised stretches with one column more."""
    problem, free = fit.problem, len(fit.problem.free)
    whole = []
    for stretch, linear, (heading, rate) in zip(
        problem.data.stretches, linearised(problem, fit.state), more, strict=True
    ):
        columns = []
        if stretch.heading_rad is not None:
            columns.append(whitened(heading[:, None], problem.weights.heading_lags)[:, 0])
        if stretch.yaw_rate_rad_s is not None:
            columns.append(rate)
        slopes = tuple(np.insert(by, free, column, axis=1) for by, column in zip(linear.slopes, columns, strict=True))
        whole.append(Linear(linear.errors, slopes))
    return whole


def _judged(fit: Fit, more: Sequence[Motion], noise: NoiseModel) -> LeftOut:
    """Take a step with one parameter more, which does that to the motions, and say how sure it is."""
    problem, free = fit.problem, len(fit.problem.free)
    linears = _with(fit, more)
    weights = problem.channel_weights()
    known = information_of(linears, free + 1, noise, problem.data.rows)
    slope = np.zeros(known.own.shape[1])
    for index, linear in enumerate(linears):
        places = [*range(free + 1), free + 1 + 2 * index, free + 2 + 2 * index]
        for weight, by, errors in zip(weights, linear.slopes, linear.errors, strict=True):
            slope[places] += weight * (by.T @ errors)
    step = known.solved(weights, slope)
    spread = math.sqrt(max(float(known.covariance(weights)[free, free]), 1e-300))
    size = float(step[free])
    state = moved(problem, fit.state, np.delete(step, free))
    apart = np.zeros(4)
    apart[list(problem.free)] = to_natural(fit.state.point, problem.free)[1] @ step[:free]
    return LeftOut(size, False, apart, state, abs(size) / spread, 2.0 * problem.scales.rudder_rad)


def _slackened(problem: Problem, width: float) -> Problem:
    data = problem.data
    return replace(problem, data=replace(data, stretches=tuple(_slack(stretch, width) for stretch in data.stretches)))


def _slack(stretch: Stretch, width: float) -> Stretch:
    """Return a stretch whose rudder follows what was measured with so much play, from the middle of it on."""
    if width == 0.0:
        return stretch
    rudder, end = stretch.rudder_rad.copy(), stretch.rudder_end_rad.copy()
    _follow(rudder, end, 0.5 * width)
    return replace(stretch, rudder_rad=rudder, rudder_end_rad=end)


@compiled
def _follow(rudder_rad: Floats, rudder_end_rad: Floats, half: float) -> None:
    """Let a rudder, from sample to sample, lag by half of its play behind what moves it, in place."""
    at = rudder_rad[0]
    for n in range(rudder_rad.size):
        at = min(max(at, rudder_rad[n] - half), rudder_rad[n] + half)
        rudder_rad[n] = at
        if n < rudder_end_rad.size:
            at = min(max(at, rudder_end_rad[n] - half), rudder_end_rad[n] + half)
            rudder_end_rad[n] = at
