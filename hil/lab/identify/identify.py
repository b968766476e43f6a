"""Identification as a whole: recordings in, a judged model out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.model.kt import KtModel
from hil.errors import UsageError
from hil.lab.compiled import compiling
from hil.lab.identify.estimates import allowing_for_cubic, estimates_of
from hil.lab.identify.fit import CUBIC, LINEAR, Fit, Searched, fit, search
from hil.lab.identify.held_out import HeldOut, errors_of, held_out
from hil.lab.identify.noise import Whiteness, whiteness
from hil.lab.identify.predict import Point
from hil.lab.identify.recording import Recording
from hil.lab.identify.refine import refine
from hil.lab.identify.rudder_timing import AS_RAMPS, TimingChoice, choose_timing
from hil.lab.identify.search import GlobalSearch, misfit, swarm_search
from hil.lab.identify.stretch import Data, Timing, prepare, timed
from hil.lab.identify.verdict import LARGEST_ERROR, Judgement, judge

MODELS = ("linear", "cubic", "auto")
SPEEDS = ("auto", "scaled", "ignored")
SPEED_SPREAD = 0.02  # relative; a steadier speed makes no difference
EQUAL_LIKELIHOOD = 4.0
FEW_READINGS, DECISIVE_FOR_SPEED = 80.0, 10.0
CONSTANT = 1e-9
TINY = 1e-12
DECISIVE = 10.0  # times what BIC asks for: alpha is there, however badly its size is known


@dataclass(frozen=True, slots=True)
class Choice:
    """Which model was taken, and why; `scaled` says whether the measured speed scales it.

    `timing` is what the rudder does between samples.
    """

    model: str
    why: str
    scaled: bool = False
    speed_why: str = ""
    timing: TimingChoice = AS_RAMPS


@dataclass(frozen=True, slots=True)
class Brought:
    """What the steps of the search brought: misfit from 1 (nothing explained) to 0, and what it cost."""

    scan: float
    swarm: float
    swarm_evaluations: int
    refined: float
    refine_evaluations: int
    refine_iterations: int


@dataclass(frozen=True, slots=True)
class Identification:
    """All that is reported. The model holds at speed_m_s, None where the logs have no speed."""

    data: Data
    fit: Fit
    choice: Choice
    judgement: Judgement
    brought: Brought
    train: HeldOut
    validate: tuple[HeldOut, ...]
    whiteness: dict[str, Whiteness]

    @property
    def evaluations(self) -> int:
        """Simulations of the log, whole or averaged."""
        return self.brought.swarm_evaluations + self.brought.refine_evaluations

    def model(self) -> KtModel:
        """Return the K-T model that predicts best; its speed is NaN where it is unknown."""
        gain, lag_s, cubic, offset = (float(value) for value in self.fit.physical)
        return KtModel(gain, lag_s, cubic, offset, math.nan if self.data.speed_m_s is None else self.data.speed_m_s)


def identify(
    train: Sequence[Recording],
    validate: Sequence[Recording] = (),
    *,
    model: str = "auto",
    speed: str = "auto",
    seed: int = 1,
    globally: GlobalSearch = swarm_search,
    tell: Callable[[], None] = lambda: None,
) -> Identification:
    """Identify K, T, alpha and delta0; UsageError for data that cannot tell anything, naming the remedy."""
    data = prepare(train)
    _check_motion(data)
    scaled = speed != "ignored" and data.speed_m_s is not None
    if not scaled:
        data = _unscaled(data)
    with compiling("the identification"):
        searched = search(data, seed, globally, cubic=model != "linear", tell=tell)
        found, choice, spent = _chosen(data, searched, model, tell)
        timing, more = choose_timing(data, found, tell)
        spent += more
        if timing.timing is not Timing.RAMP:
            data = timed(data, timing.timing)
            found, choice, more = _chosen(data, searched, model, tell)
            spent += more
        choice = replace(choice, scaled=scaled, timing=timing)
        if scaled and speed == "auto" and (_speed_varies(data) or found.effective_rows < FEW_READINGS):
            data, found, choice, more = _rescaled(data, searched, found, choice, tell)
            spent += more
    judgement = _judged(found, model)
    brought = Brought(
        searched.box.guess_misfit,
        searched.found.misfit,
        searched.found.evaluations,
        float(misfit(searched.record, found.state.point.values[None], found.state.point.sign)[0]),
        spent,
        found.iterations,
    )
    errors = errors_of(found)
    return Identification(
        data,
        found,
        choice,
        judgement,
        brought,
        HeldOut.of("train", errors),
        tuple(
            held_out(found, recording, data.speed_m_s, scaled=choice.scaled, timing=timing.timing)
            for recording in validate
        ),
        {name: whiteness([piece - piece.mean() for piece in pieces]) for name, pieces in errors.items()},
    )


def _rescaled(
    data: Data, searched: Searched, found: Fit, choice: Choice, tell: Callable[[], None]
) -> tuple[Data, Fit, Choice, int]:
    """Return data and fit that follow the measured speed, or do not, and why.

    Similarity is what is to be expected of a hull, so a constant model must be clearly better to be taken. But a
    short log has seen too little of other speeds to be carried to them on trust: there the scaling must show.
    """
    other = fit(_unscaled(data), searched, found.problem.free, found.state.point, tell)
    share = found.effective_rows / data.rows
    gain = (other.likelihood - found.likelihood) * share
    if found.effective_rows < FEW_READINGS and gain < DECISIVE_FOR_SPEED:
        why = (
            f"not scaled: {_rows(found)} are too few to trust a scaling that does not show "
            f"({gain:+.0f} in -2 ln likelihood, {DECISIVE_FOR_SPEED:.0f} are needed)"
        )
        return _unscaled(data), other, replace(choice, scaled=False, speed_why=why), other.evaluations
    if gain < -EQUAL_LIKELIHOOD:
        why = f"a model that does not change with the speed fits better (by {-gain:.0f} in -2 ln likelihood)"
        return _unscaled(data), other, replace(choice, scaled=False, speed_why=why), other.evaluations
    why = f"scaled to the measured speed (against a constant model: {gain:+.0f} in -2 ln likelihood)"
    return data, found, replace(choice, speed_why=why), other.evaluations


def _chosen(data: Data, searched: Searched, model: str, tell: Callable[[], None]) -> tuple[Fit, Choice, int]:
    """Return the fit of the model asked for or that the evidence is for, and why."""
    linear = fit(data, searched, LINEAR, _best_start(searched), tell)
    if model == "linear":
        return linear, Choice("linear", "as asked for"), linear.evaluations
    cubic = fit(data, searched, CUBIC, searched.found.point, tell, linear)
    spent = linear.evaluations + cubic.evaluations
    place = CUBIC.index(2)
    spread = math.sqrt(max(float(cubic.covariance[place, place]), 0.0))
    alpha = float(cubic.state.point.values[2])
    z = alpha / max(spread, TINY)
    needed = math.sqrt(math.log(max(cubic.effective_rows, 10.0)))
    size = f"alpha is {z:.1f} standard errors from zero"
    if alpha > 0.0 and z <= needed:
        gain, tried = _gain(linear, cubic, DECISIVE * needed**2)
        spent += tried
        if gain > DECISIVE * needed**2:
            needed, size = 0.0, f"{size}, but takes {gain:.0f} off -2 ln likelihood"
    if model == "cubic" and alpha < 0.0:
        # Against all that is known of hulls, and a boat with a negative alpha spins up without end.
        return linear, Choice("cubic", f"as asked for; {size}, so it is held at zero"), spent
    if model == "cubic":
        return cubic, Choice("cubic", "as asked for"), spent
    why = f"{size}; {needed:.1f} are needed (BIC, {_rows(cubic)})"
    if z > needed:
        return cubic, Choice("cubic", why), spent
    return linear, Choice("linear", f"{why}; K and T allow for an alpha that does not show"), spent


def _gain(linear: Fit, cubic: Fit, enough: float) -> tuple[float, int]:
    """Return what alpha takes off -2 ln likelihood, by the weights of the cubic fit, and the evaluations spent.

    Where it is clear beforehand that it is less than enough, what it is at most.
    """
    shares = np.array(cubic.problem.channel_weights()) * cubic.accuracy.noise.spread**2
    readings = cubic.effective_rows * float(np.count_nonzero(shares > 0.01 * shares.max()))
    bent = refine(cubic.problem, cubic.state)
    # The linear model refined by these weights costs no more than as it is.
    most = (cubic.problem.cost(linear.state) / max(bent.cost, 1e-300) - 1.0) * readings
    if most <= enough:
        return most, bent.evaluations + 1
    flat = refine(replace(cubic.problem, free=linear.problem.free), linear.state)
    gain = (flat.cost / max(bent.cost, 1e-300) - 1.0) * readings
    return gain, flat.evaluations + bent.evaluations + 1


def _judged(found: Fit, model: str) -> Judgement:
    """Judge a fit, K, T and delta0 with regard to an alpha that is held at zero but need not be zero."""
    if found.problem.free == CUBIC:
        return judge(found, estimates_of(found), None)
    if model == "linear":
        return judge(found, estimates_of(found), (0.0, 0.0))
    estimates = allowing_for_cubic(found)
    if estimates is None:
        return judge(found, estimates_of(found), (0.0, LARGEST_ERROR))
    place = CUBIC.index(2)
    spread = math.sqrt(max(float(estimates.covariance[place, place]), 0.0))
    return judge(found, estimates, (0.0, spread / found.problem.scales.yaw_rate_rad_s**2))


def _rows(fitted: Fit) -> str:
    return f"{fitted.effective_rows:.0f} independent readings"


def _best_start(searched: Searched) -> Point:
    """Return the better of what scan and swarm say of a linear model."""
    guess, swarm = searched.box.guess, searched.found.point
    values = swarm.values.copy()
    values[2] = 0.0
    flat = Point(values, swarm.sign)
    both = misfit(searched.record, np.array([guess.values, flat.values]), guess.sign)
    return guess if both[0] <= both[1] else flat


def _unscaled(data: Data) -> Data:
    stretches = tuple(replace(stretch, speed_ratio=np.ones(stretch.time_s.size)) for stretch in data.stretches)
    return replace(data, stretches=stretches)


def _speed_varies(data: Data) -> bool:
    ratio = np.concatenate([stretch.speed_ratio for stretch in data.stretches])
    return float(np.std(ratio)) > SPEED_SPREAD


def _check_motion(data: Data) -> None:
    rudder = np.concatenate([stretch.rudder_rad for stretch in data.stretches])
    low, high = float(np.min(rudder)), float(np.max(rudder))
    moving = [
        column
        for stretch in data.stretches
        for column in (stretch.heading_rad, stretch.yaw_rate_rad_s)
        if column is not None and float(np.ptp(column)) > 0.0
    ]
    if not moving:
        raise UsageError(
            f"{_names(data)}: she does not turn at all, heading and yaw rate are constant; record a zigzag"
        )
    if high - low <= CONSTANT * max(abs(low), abs(high), 1.0):
        raise UsageError(
            f"{_names(data)}: constant rudder, {low:g} throughout: nothing can be told from it; "
            "record a zigzag, or give a second file with another rudder angle"
        )


def _names(data: Data) -> str:
    return ", ".join(sorted({stretch.name for stretch in data.stretches}))
