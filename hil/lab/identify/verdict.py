"""Verdicts on K, T, alpha and delta0: value, interval, and whether log or prior determines it."""

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
MAX_RELATIVE_SE = 0.25  # 95 % within a factor of about 1.6
MAX_OFFSET_SE = 0.25  # relative to the rudder's spread
MIN_ALPHA_SE = 3.0  # minimum alpha in standard errors
FROM_PRIOR = 0.5  # share of the information
MIN_GAIN = 10.0  # of the log-likelihood, relative to a boat without rudder effect
MAX_NUMBER = 1e12  # numbers in JSON are finite
MAX_TURN_1_M = 5.0  # K / U: with full rudder the turning radius is half a metre
MIN_DELAY_SE = 2.0  # delay in standard errors, from which it is reported


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
    """The four parameters and warnings; usable: the model predicts better than no model."""

    estimates: Mapping[str, Estimate]  # K, T, alpha, delta0
    usable: bool
    warnings: tuple[str, ...]


def judge(fit: Fit, data: Data, train: Errors) -> Judgement:
    """Return the verdicts on a fit."""
    usable = fit.gain > MIN_GAIN
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
        warnings.append("the log shows no effect of the rudder on the motion")
    elif gain_1_s < 0.0:
        warnings.append(
            "K is negative: positive rudder turns the boat to port in this log; invert the sign of the rudder column, "
            "or change RUD_REVERSE on the boat"
        )
    speed_m_s = data.speed_m_s
    if usable and speed_m_s is not None and abs(estimates["K"].low) > MAX_TURN_1_M * speed_m_s:
        warnings.append(
            f"K {gain_1_s:.3g} 1/s at {speed_m_s:.2g} m/s means a turning radius of half a metre: "
            "check the units of heading and rudder"
        )
    if usable and not fit.likeliest:
        warnings.append(
            "the boat is not a pure K-T boat: the likeliest model predicts this log worse than the model with the best "
            "prediction, which is reported; the intervals include the distance of both"
        )
    delay_s, lag_of_rudder_s = float(fit.values[DELAY]), float(fit.values[LAG])
    if usable and (
        abs(delay_s) > max(MIN_DELAY_SE * fit.spread(DELAY), step_s)
        or lag_of_rudder_s > max(MIN_DELAY_SE * fit.spread(LAG), step_s)
    ):
        warnings.append(
            f"the boat responds to the rudder column with a dead time of {delay_s:.2f} s and a lag of "
            f"{lag_of_rudder_s:.2f} s; K and T do not include them"
        )
    return Judgement(estimates, usable, tuple(warnings))


def _logarithmic(value: float, relative: float, verdict: str, why: str) -> Estimate:
    factor = math.exp(min(NORMAL_95 * relative, 25.0))
    low, high = sorted((value / factor, value * factor))
    return Estimate(value, _finite(abs(value) * relative), low, _finite(high), verdict, why)


def _main(value: float, fit: Fit, place: int, *, usable: bool, step_s: float = 0.0) -> Estimate:
    relative = fit.spread(place)
    if not usable:
        return _logarithmic(value, relative, NOT_IDENTIFIABLE, "the log shows no effect of the rudder")
    why = known(relative)
    if relative <= MAX_RELATIVE_SE:
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
        return Estimate(value, se, value, value, NOT_IDENTIFIABLE, "fixed at zero: --model linear")
    if usable and value > MIN_ALPHA_SE * se:
        return Estimate(value, se, low, high, IDENTIFIABLE, f"{where} {percent(value * rate**2)} of the yaw rate")
    why = f"{where} at most {percent(high * rate**2)} of the yaw rate"
    if fit.share(ALPHA) > FROM_PRIOR:
        why += "; it comes from the prior, not from the log"
    return Estimate(value, se, low, high, NOT_IDENTIFIABLE, why)


def _offset(value: float, fit: Fit, data: Data, *, usable: bool) -> Estimate:
    se, spread = fit.spread(OFFSET), float(np.std(data.rudder_rad))
    interval = value - NORMAL_95 * se, value + NORMAL_95 * se
    if usable and se <= MAX_OFFSET_SE * spread:
        why = f"known to {percent(se / spread)} of the rudder's spread"
        if data.stretches[0].heading_rad is None:
            why += "; it includes the constant error of the yaw rate over K"
        return Estimate(value, se, *interval, IDENTIFIABLE, why)
    return Estimate(
        value, _finite(se), *interval, NOT_IDENTIFIABLE, "its error is as large as the motion of the rudder"
    )


def known(relative: float) -> str:
    """Return a text with the relative error."""
    return f"known to {percent(relative)}"


def percent(share: float) -> str:
    """Return a share as text."""
    return "worse than a factor of ten" if share >= 10.0 else f"{100.0 * share:.2g} %"


def _finite(value: float) -> float:
    return min(MAX_NUMBER, value)
