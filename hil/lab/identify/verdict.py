"""What a fit is worth, parameter by parameter, in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hil.lab.identify.estimates import Estimates
from hil.lab.identify.fit import PARAMETERS, Fit
from hil.lab.identify.loop import Loop
from hil.lab.identify.recording import Floats

IDENTIFIABLE = "identifiable"
RATIO = "only the ratio K/T is identifiable"
NOT_IDENTIFIABLE = "not identifiable"
LOOSE = 0.25  # of a value: 95 % within a factor of about 1.6
LOOSE_OFFSET = 0.25  # of the rudder's spread
CERTAIN = 3.0  # standard errors that alpha must be away from zero
SHORTEST_S, FEWEST_READINGS = 30.0, 30.0  # less cannot tell what the rudder does from a few waves
LEAST_LAGS = 5.0  # that a log must last for K and T to be told apart
LEAST_EXPLAINED = 0.25  # of the motion, where the rudder answers the rest
PLAINLY_EXPLAINED = 0.9  # of the motion: a boat that is quicker than her log, and not a rudder that follows her
LARGEST_ERROR = 1e12  # a standard error is a finite number, also where there is no knowing


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its standard error, the verdict on it and the reason."""

    value: float
    se: float
    verdict: str
    why: str


@dataclass(frozen=True, slots=True)
class Judgement:
    """The four parameters, K/T, the correlations between those estimated, and what is wrong altogether."""

    estimates: Mapping[str, Estimate]  # K, T, alpha, delta0
    ratio: Estimate
    correlations: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def usable(self) -> bool:
        """Whether there is a model at all: K and T, or at least their ratio."""
        return self.ratio.verdict == IDENTIFIABLE or self.estimates["K"].verdict == IDENTIFIABLE


def judge(fit: Fit, estimates: Estimates, alpha: tuple[float, float] | None, loop: Loop) -> Judgement:
    """Judge what is known of a fit.

    alpha: value and standard error where the model has it held, None where the estimates tell.
    loop: what of the motion is explained, and whether the rudder answers the rest.
    """
    scales = fit.problem.scales
    gain, lag_s, cubic, offset = estimates.physical(scales, fit.state.point.sign)
    free = list(estimates.free)
    covariance = estimates.covariance
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # Where the likelihood is level, its curvature, which the spread comes from, says nothing.
    endless = fit.outlasts_log
    ln_gain_se, ln_lag_se = (math.inf, math.inf) if endless else (float(spread[0]), float(spread[1]))
    ratio_se = _ratio_spread(covariance)
    offset_se = float(spread[free.index(3)]) * scales.rudder_rad
    if alpha is None:
        alpha = (cubic, math.inf if endless else float(spread[free.index(2)]) / scales.yaw_rate_rad_s**2)
    explained = _explained(covariance)
    refusal = _refusal(fit, loop, explained=explained)
    # Disturbances that are answered look like an endless T, and the ratio to it is as wrong as K.
    lost = loop.answered > 0.0 and ln_gain_se > LOOSE and loop.explained < PLAINLY_EXPLAINED
    ratio = Estimate(
        gain / lag_s,
        _finite(abs(gain) / lag_s * ratio_se),
        IDENTIFIABLE if ratio_se <= LOOSE and not refusal and not lost else NOT_IDENTIFIABLE,
        f"known to {_percent(ratio_se)}" + ", were the rest not answered by the rudder" * lost,
    )
    short = fit.problem.data.duration_s < LEAST_LAGS * lag_s or fit.effective_rows < FEWEST_READINGS
    main = {
        "K": _main("K", gain, ln_gain_se, ratio, refusal, short=short),
        "T": _main("T", lag_s, ln_lag_se, ratio, refusal, short=short),
    }
    known = all(one.verdict == IDENTIFIABLE for one in main.values())
    judged = main | {
        "alpha": _alpha(fit, *alpha, explained=not refusal, known=known),
        "delta0": _offset(fit, offset, offset_se, explained=not refusal),
    }
    warnings = []
    if loop.answered and not refusal:
        warnings.append(
            f"the rudder answers what it does not explain ({_percent(1.0 - loop.explained)} of the motion), as an "
            "autopilot or a helmsman does, or a dead time or a second lag in a zigzag that repeats itself: K may be "
            "too small, and the standard errors allow for it; steer by an irregular plan"
        )
    if gain < 0.0 and not refusal:
        warnings.append(
            "K is negative: positive rudder turns her to port in this log; turn the sign of the rudder column, "
            "or RUD_REVERSE on the boat"
        )
    if refusal:
        warnings.append(f"{refusal}: no model can be had from this log")
    return Judgement(judged, ratio, _correlations(free, covariance), tuple(warnings))


def _refusal(fit: Fit, loop: Loop, *, explained: bool) -> str:
    """Return why there is no model at all, empty where there is one."""
    seconds, readings = fit.problem.data.duration_s, fit.effective_rows
    if not explained:
        return "the rudder explains next to nothing of the motion"
    if seconds < SHORTEST_S:
        least = f"{SHORTEST_S:.0f} s are the least"
        return f"{seconds:.0f} s are too short to tell the rudder's work from a few waves; {least}"
    if readings < FEWEST_READINGS and not _plain(loop, readings):
        return f"worth {readings:.0f} independent readings only, where {FEWEST_READINGS:.0f} are the least"
    if loop.answered and loop.explained < LEAST_EXPLAINED:
        share = _percent(max(loop.explained, 0.0))
        return f"the rudder explains {share} of the motion and answers the rest, as an autopilot does (closed loop)"
    if not fit.converged:
        return "the refinement has not converged, as where too few rudder angles leave the values undecided"
    # A helm that answers her within a row is itself a model of the log: one without T, and mostly of the wrong sign.
    step_s = fit.problem.data.usual_step_s
    if float(fit.physical[1]) < step_s and (float(fit.physical[0]) < 0.0 or loop.explained < PLAINLY_EXPLAINED):
        return (
            f"rudder and turning go together within a row of {step_s:.2g} s, as where the rudder answers her turning "
            "(closed loop); steer by a plan, and log more often"
        )
    return ""


def _plain(loop: Loop, readings: float) -> bool:
    """Whether so few readings leave no doubt, their share that so many parameters explain of anything taken off."""
    left = readings - PARAMETERS - 1.0
    return left > 0.0 and (1.0 - loop.explained) * (readings - 1.0) / left <= 1.0 - PLAINLY_EXPLAINED


def _explained(covariance: Floats) -> bool:
    """Whether the rudder acts at all: K or K/T more than three standard errors from zero (ln K's is the inverse)."""
    return min(math.sqrt(max(float(covariance[0, 0]), 0.0)), _ratio_spread(covariance)) < 1.0 / 3.0


def _ratio_spread(covariance: Floats) -> float:
    return math.sqrt(max(float(covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1]), 0.0))


def _main(name: str, value: float, relative: float, ratio: Estimate, refusal: str, *, short: bool) -> Estimate:
    se = _finite(abs(value) * relative)
    if refusal:
        return Estimate(value, se, NOT_IDENTIFIABLE, refusal)
    if relative <= LOOSE and not short:
        return Estimate(value, se, IDENTIFIABLE, f"known to {_percent(relative)}")
    if ratio.verdict == IDENTIFIABLE:
        why = f"{name} alone is known to {_percent(relative)} only, K/T = {ratio.value:.4g} {ratio.why}"
        return Estimate(value, se, RATIO, why)
    return Estimate(value, se, NOT_IDENTIFIABLE, f"known to {_percent(relative)} only")


def _alpha(fit: Fit, value: float, se: float, *, explained: bool, known: bool) -> Estimate:
    rate = fit.typical_rate_rad_s()
    share = abs(value) * rate**2
    bound = (max(value, 0.0) + 1.96 * se) * rate**2
    where = f"at the yaw rates of this log ({math.degrees(rate):.2g} deg/s) its term is"
    if explained and not known and (value > 2.0 * se or not math.isfinite(se)):
        return Estimate(value, _finite(se), NOT_IDENTIFIABLE, "it goes with K and T, which are not known by themselves")
    if explained and value > CERTAIN * se:
        return Estimate(value, _finite(se), IDENTIFIABLE, f"{where} {_percent(share)} of the yaw rate, and shows")
    if explained and value > 2.0 * se:
        why = f"{where} {_percent(share)} of the yaw rate, but alpha is known to {_percent(se / value)} only"
    else:
        why = f"{where} at most {_percent(bound)} of the yaw rate; zero is as likely"
    return Estimate(value, _finite(se), NOT_IDENTIFIABLE, why)


def _offset(fit: Fit, value: float, se: float, *, explained: bool) -> Estimate:
    rudder = np.concatenate([stretch.rudder_rad for stretch in fit.problem.data.stretches])
    spread = float(np.std(rudder))
    if explained and se <= LOOSE_OFFSET * spread:
        why = f"known to {_percent(se / max(spread, 1e-300))} of the rudder's spread"
        if fit.problem.data.stretches[0].heading_rad is None:
            why += "; it includes the gyroscope's constant error over K, for only a heading beside it tells them apart"
        return Estimate(value, se, IDENTIFIABLE, why)
    return Estimate(value, _finite(se), NOT_IDENTIFIABLE, "its error is as large as the rudder's own motion")


def _correlations(free: list[int], covariance: Floats) -> dict[str, float]:
    names = ("K", "T", "alpha", "delta0")
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    table = covariance / np.outer(spread, spread)
    return {
        f"{names[free[a]]},{names[free[b]]}": float(np.clip(table[a, b], -1.0, 1.0))
        for a in range(len(free))
        for b in range(a + 1, len(free))
    }


def _finite(value: float) -> float:
    return min(LARGEST_ERROR, value)


def _percent(share: float) -> str:
    if share >= 10.0:
        return "worse than a factor of ten"
    return f"{100.0 * share:.2g} %"
