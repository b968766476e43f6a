"""Identification as a whole: recordings in, a judged model out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.model.kt import KtModel
from hil.errors import UsageError
from hil.lab.compiled import compiling
from hil.lab.identify.choice import choose
from hil.lab.identify.damping import Damping, damping_of
from hil.lab.identify.doubt import doubted
from hil.lab.identify.estimates import allowing_for_bend, estimates_of, with_slow_noise
from hil.lab.identify.fit import CUBIC, Fit, search
from hil.lab.identify.held_out import HeldOut, errors_of, held_out
from hil.lab.identify.left_out import LeftOut, left_out_of
from hil.lab.identify.loop import Loop, loop_of
from hil.lab.identify.noise import Whiteness, whiteness
from hil.lab.identify.recording import Recording
from hil.lab.identify.rudder_timing import AS_RAMPS, TimingChoice, choose_timing
from hil.lab.identify.search import GlobalSearch, misfit, swarm_search
from hil.lab.identify.stability import runs_away, seems_unstable
from hil.lab.identify.stretch import Data, Timing, prepare, timed
from hil.lab.identify.verdict import IDENTIFIABLE, LARGEST_ERROR, NOT_IDENTIFIABLE, Judgement, judge

MODELS = ("linear", "cubic", "auto")
SPEEDS = ("auto", "scaled", "ignored")
SPEED_SPREAD = 0.005  # relative; a steadier speed makes no difference
CONSTANT = 1e-9
MOST_GAIN_1_M = 5.0  # of K / U: K L / U is hardly above 2.5, of a hull of half a metre or more


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
    loop: Loop

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
    with compiling("the identification"):
        kinds = _kinds(data, speed)
        searched = search(kinds[0][0], seed, globally, cubic=model != "linear", tell=tell)
        chosen = choose(kinds, searched, model, tell)
        timing, spent = choose_timing(chosen.fit.problem.data, chosen.fit, tell)
        spent += chosen.evaluations
        if timing.timing is not Timing.RAMP:
            kinds = tuple((timed(one, timing.timing), scaled) for one, scaled in kinds)
            chosen = choose(kinds, searched, model, tell)
            spent += chosen.evaluations
    found = chosen.fit
    choice = Choice(chosen.model, chosen.why, chosen.scaled, chosen.speed_why, timing)
    data = next(one for one, scaled in kinds if scaled == chosen.scaled)
    damping = damping_of(found, asked=model == "cubic")
    loop, left_out = _loop_or_left_out(damping.fit if damping is not None and damping.told else found)
    found = with_slow_noise(found)
    judgement = _warned(_judged(found, model, loop, left_out, damping), found, left_out, damping)
    _check_size(data, judgement)
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
        loop,
    )


def _judged(found: Fit, model: str, loop: Loop, left_out: LeftOut | None, damping: Damping | None) -> Judgement:
    """Judge a fit, K, T and delta0 with regard to an alpha that is held at zero but need not be zero."""
    estimates, alpha = estimates_of(found), None
    if found.problem.free != CUBIC:
        alpha = (0.0, 0.0)
        if model != "linear":
            allowing = allowing_for_bend(found, (3,) if model == "cubic" else (3, 2))
            alpha = (0.0, LARGEST_ERROR)
            if allowing is not None:
                place = CUBIC.index(2)
                spread = math.sqrt(max(float(allowing.covariance[place, place]), 0.0))
                estimates, alpha = allowing, (0.0, spread / found.problem.scales.yaw_rate_rad_s**2)
    return judge(found, doubted(estimates, found, loop, left_out, damping), alpha, loop)


def _loop_or_left_out(found: Fit) -> tuple[Loop, LeftOut | None]:
    """Tell a rudder that answers her from a boat that answers late: each looks like the other in a repeated plan."""
    loop, left_out = loop_of(found), left_out_of(found)
    if left_out is not None and loop.answered:
        beside = loop_of(found, left_out)
        return (loop, None) if beside.answered else (replace(loop, answered=0.0), left_out)
    return loop, left_out


def _warned(judgement: Judgement, found: Fit, left_out: LeftOut | None, damping: Damping | None) -> Judgement:
    """Add what was seen of the data before the fit, and a boat that the equation is not of."""
    warnings, estimates = [*found.problem.data.warnings, *judgement.warnings], dict(judgement.estimates)
    if left_out is not None and judgement.usable and left_out.warning():
        warnings.append(left_out.warning())
    if damping is not None and judgement.usable and damping.warning():
        warnings.append(damping.warning())
    if estimates["T"].verdict != IDENTIFIABLE:
        unstable = seems_unstable(found)
        if unstable:
            warnings.append(
                "is she unstable? a yaw rate that is there seems to grow by itself, so that she does not run straight "
                "with the rudder amidships (T below zero): a K and a T above zero do not describe her"
            )
        if unstable or runs_away(found):
            why = "the equation with T above zero is hardly that of this boat"
            estimates["delta0"] = replace(estimates["delta0"], verdict=NOT_IDENTIFIABLE, why=why)
    return replace(judgement, estimates=estimates, warnings=tuple(warnings))


def _kinds(data: Data, speed: str) -> tuple[tuple[Data, bool], ...]:
    """Return the data as they may be fitted: following the measured speed, or not."""
    constant = (_unscaled(data), False)
    if speed == "ignored" or data.speed_m_s is None:
        return (constant,)
    ratio = np.concatenate([stretch.speed_ratio for stretch in data.stretches])
    varies = float(np.std(ratio)) > SPEED_SPREAD
    return ((data, True), constant) if speed == "auto" and varies else ((data, True),)


def _unscaled(data: Data) -> Data:
    stretches = tuple(replace(stretch, speed_ratio=np.ones(stretch.time_s.size)) for stretch in data.stretches)
    return replace(data, stretches=stretches)


def _check_size(data: Data, judgement: Judgement) -> None:
    """Refuse a K that no ship of that speed has: with the rudder hard over she would turn within half a metre."""
    gain, speed_m_s = judgement.estimates["K"], data.speed_m_s
    if speed_m_s is None or not judgement.usable or abs(gain.value) - 3.0 * gain.se <= MOST_GAIN_1_M * speed_m_s:
        return
    raise UsageError(
        f"{_names(data)}: K {gain.value:.3g} 1/s is beyond any ship of {speed_m_s:.2g} m/s: are heading and yaw rate "
        "in degrees? name the columns heading_deg and yaw_rate_deg_s, or convert them"
    )


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
