"""What is known of K, T, alpha and delta0: value, interval, and whether the log or the prior tells it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hil.lab.identify.filter import ALPHA, DELAY, LAG, LN_K, LN_T, OFFSET
from hil.lab.identify.fit import Fit
from hil.lab.identify.predict import Errors
from hil.lab.identify.stretches import Data

IDENTIFIABLE = "identifiable"
NOT_IDENTIFIABLE = "not identifiable"
NORMAL_95 = 1.96
LOOSE = 0.25  # of a value: 95 % within a factor of about 1.6
LOOSE_OFFSET = 0.25  # of the rudder's spread
CERTAIN = 3.0  # standard errors that alpha must be away from zero
FROM_PRIOR = 0.5  # of what is known
LEAST_GAIN = 10.0  # of the log-likelihood, over that of a boat which no rudder turns
LARGEST = 1e12  # a number in the JSON is finite
LARGEST_TURN_1_M = 5.0  # K / U: with the rudder hard over the boat turns within half a metre
SHOWN_DELAY = 2.0  # standard errors


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its standard error, its 95 % interval, the verdict and the reason."""

    value: float
    se: float
    low: float
    high: float
    verdict: str
    why: str


@dataclass(frozen=True, slots=True)
class Judgement:
    """The four parameters and warnings; usable: the model predicts better than none."""

    estimates: Mapping[str, Estimate]  # K, T, alpha, delta0
    usable: bool
    warnings: tuple[str, ...]


def judge(fit: Fit, data: Data, train: Errors) -> Judgement:
    """Judge a fit."""
    usable = fit.gain > LEAST_GAIN
    gain_1_s, lag_s, alpha_s2, offset_rad, _ = fit.model().tolist()
    step_s = data.usual_step_s
    estimates = {
        "K": _main(gain_1_s, fit, LN_K, usable=usable),
        "T": _main(lag_s, fit, LN_T, usable=usable, step_s=step_s),
        "alpha": _alpha(alpha_s2, fit, train, usable=usable),
        "delta0": _offset(offset_rad, fit, data, usable=usable),
    }
    warnings = list(data.warnings)
    if not usable:
        warnings.append("the rudder explains next to nothing of the motion: the log is as likely without a rudder")
    elif gain_1_s < 0.0:
        warnings.append(
            "K is negative: positive rudder turns the boat to port in this log; turn the sign of the rudder column, "
            "or RUD_REVERSE on the boat"
        )
    speed_m_s = data.speed_m_s
    if usable and speed_m_s is not None and abs(estimates["K"].low) > LARGEST_TURN_1_M * speed_m_s:
        warnings.append(
            f"K {gain_1_s:.3g} 1/s at {speed_m_s:.2g} m/s is that of a boat which turns within half a metre: "
            "are heading and rudder in the units that their names say?"
        )
    if usable and not fit.likeliest:
        warnings.append(
            "the boat is not quite a K-T boat: the likeliest model predicts this log worse than the best one does; "
            "the best one is given, and its distance from the likeliest counts in the intervals"
        )
    delay_s, lag_of_rudder_s = float(fit.values[DELAY]), float(fit.values[LAG])
    if usable and (
        abs(delay_s) > max(SHOWN_DELAY * fit.spread(DELAY), step_s)
        or lag_of_rudder_s > max(SHOWN_DELAY * fit.spread(LAG), step_s)
    ):
        warnings.append(
            f"the boat answers the rudder column with a dead time of {delay_s:.2f} s and a lag of "
            f"{lag_of_rudder_s:.2f} s; both are counted in, so K and T are those behind them"
        )
    return Judgement(estimates, usable, tuple(warnings))


def _logarithmic(value: float, relative: float, verdict: str, why: str) -> Estimate:
    factor = math.exp(min(NORMAL_95 * relative, 25.0))
    low, high = sorted((value / factor, value * factor))
    return Estimate(value, _finite(abs(value) * relative), low, _finite(high), verdict, why)


def _main(value: float, fit: Fit, place: int, *, usable: bool, step_s: float = 0.0) -> Estimate:
    relative = fit.spread(place)
    if not usable:
        return _logarithmic(value, relative, NOT_IDENTIFIABLE, "the rudder explains next to nothing of the motion")
    why = known(relative)
    if relative <= LOOSE:
        return _logarithmic(value, relative, IDENTIFIABLE, why)
    if value < step_s:
        why += f"; T is shorter than the rows ({step_s:.2g} s)"
    if fit.share(place) > FROM_PRIOR:
        why += "; it comes from the prior, not from the log"
    return _logarithmic(value, relative, NOT_IDENTIFIABLE, why)


def _alpha(value: float, fit: Fit, train: Errors, *, usable: bool) -> Estimate:
    se = _finite(fit.spread(ALPHA))
    rate = float(np.quantile(np.abs(np.concatenate([one.yaw_rate_rad_s for one in train.predictions])), 0.95))
    low, high = max(value - NORMAL_95 * se, 0.0), _finite(value + NORMAL_95 * se)
    where = f"at the yaw rates of this log ({math.degrees(rate):.2g} deg/s) its term is"
    if ALPHA not in fit.free:
        return Estimate(value, se, value, value, NOT_IDENTIFIABLE, "held at zero: --model linear")
    if usable and value > CERTAIN * se:
        return Estimate(value, se, low, high, IDENTIFIABLE, f"{where} {percent(value * rate**2)} of the yaw rate")
    why = f"{where} at most {percent(high * rate**2)} of the yaw rate"
    if fit.share(ALPHA) > FROM_PRIOR:
        why += "; it comes from the prior, not from the log"
    return Estimate(value, se, low, high, NOT_IDENTIFIABLE, why)


def _offset(value: float, fit: Fit, data: Data, *, usable: bool) -> Estimate:
    se, spread = fit.spread(OFFSET), float(np.std(data.rudder_rad))
    interval = value - NORMAL_95 * se, value + NORMAL_95 * se
    if usable and se <= LOOSE_OFFSET * spread:
        why = f"known to {percent(se / spread)} of the rudder's spread"
        if data.stretches[0].heading_rad is None:
            why += "; it includes the constant error of the yaw rate over K"
        return Estimate(value, se, *interval, IDENTIFIABLE, why)
    return Estimate(value, _finite(se), *interval, NOT_IDENTIFIABLE, "its error is as large as the rudder's own motion")


def known(relative: float) -> str:
    """Say how well a value is known."""
    return f"known to {percent(relative)}"


def percent(share: float) -> str:
    """Write a share."""
    return "worse than a factor of ten" if share >= 10.0 else f"{100.0 * share:.2g} %"


def _finite(value: float) -> float:
    return min(LARGEST, value)
