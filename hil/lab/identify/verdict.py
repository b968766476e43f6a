"""Judge K, T, alpha and delta0: value, interval, and whether the log or the prior determines it."""

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
MAX_RELATIVE_SE = 0.25  # the 95 % interval is a factor of about 1.6
MAX_OFFSET_SE = 0.25  # relative to the rudder's spread
MIN_ALPHA_SE = 3.0  # minimum alpha in standard errors
MAX_PRIOR_FRACTION = 0.5  # of the information on a value that counts as determined by the log
MIN_GAIN = 10.0  # of the log-likelihood, relative to a boat without rudder effect
MAX_NUMBER = 1e12  # numbers in JSON are finite
MAX_GAIN_PER_SPEED_1_M = 5.0  # K / U, at which the turning radius with full rudder is half a metre
MIN_DELAY_SE = 2.0  # minimum delay, in standard errors, that is reported


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its standard error, its 95 % interval, the verdict and the reason."""

    value: float
    se: float
    low: float
    high: float
    verdict: str
    reason: str


@dataclass(frozen=True, slots=True)
class Judgement:
    """The four parameters and warnings. is_usable: the model predicts better than no model."""

    estimates: Mapping[str, Estimate]  # K, T, alpha, delta0
    is_usable: bool
    warnings: tuple[str, ...]


def judge(fit: Fit, data: Data, train: Errors) -> Judgement:
    """Return the verdicts on a fit."""
    is_usable = fit.gain > MIN_GAIN
    gain_1_s, lag_s, alpha_s2, offset_rad, _ = fit.model().tolist()
    step_s = data.median_step_s
    estimates = {
        "K": _judge_log_parameter(gain_1_s, fit, LN_K, is_usable=is_usable),
        "T": _judge_log_parameter(lag_s, fit, LN_T, is_usable=is_usable, step_s=step_s),
        "alpha": _judge_alpha(alpha_s2, fit, train, is_usable=is_usable),
        "delta0": _judge_offset(offset_rad, fit, data, is_usable=is_usable),
    }
    warnings = list(data.warnings)
    if not is_usable:
        warnings.append("the log shows no effect of the rudder on the motion")
    elif gain_1_s < 0.0:
        warnings.append(
            "K is negative: positive rudder turns the boat to port in this log; invert the sign of the rudder column, "
            "or change RUD_REVERSE on the boat"
        )
    speed_m_s = data.speed_m_s
    if is_usable and speed_m_s is not None and abs(estimates["K"].low) > MAX_GAIN_PER_SPEED_1_M * speed_m_s:
        warnings.append(
            f"K {gain_1_s:.3g} 1/s at {speed_m_s:.2g} m/s means a turning radius of half a metre: "
            "check the units of heading and rudder"
        )
    if is_usable and not fit.is_likeliest:
        warnings.append(
            "the boat is not a pure K-T boat: the likeliest model predicts this log worse than the model with the best "
            "prediction, which is reported; the intervals include the distance of both"
        )
    delay_s, lag_of_rudder_s = float(fit.values[DELAY]), float(fit.values[LAG])
    if is_usable and (
        abs(delay_s) > max(MIN_DELAY_SE * fit.spread(DELAY), step_s)
        or lag_of_rudder_s > max(MIN_DELAY_SE * fit.spread(LAG), step_s)
    ):
        warnings.append(
            f"the boat responds to the rudder column with a dead time of {delay_s:.2f} s and a lag of "
            f"{lag_of_rudder_s:.2f} s; K and T do not include them"
        )
    return Judgement(estimates, is_usable, tuple(warnings))


def _log_normal_estimate(value: float, relative: float, verdict: str, reason: str) -> Estimate:
    factor = math.exp(min(NORMAL_95 * relative, 25.0))
    low, high = sorted((value / factor, value * factor))
    return Estimate(value, _limit(abs(value) * relative), low, _limit(high), verdict, reason)


def _judge_log_parameter(value: float, fit: Fit, index: int, *, is_usable: bool, step_s: float = 0.0) -> Estimate:
    relative = fit.spread(index)
    if not is_usable:
        return _log_normal_estimate(value, relative, NOT_IDENTIFIABLE, "the log shows no effect of the rudder")
    reason = error_text(relative)
    if relative <= MAX_RELATIVE_SE:
        return _log_normal_estimate(value, relative, IDENTIFIABLE, reason)
    if value < step_s:
        reason += f"; T is shorter than the rows ({step_s:.2g} s)"
    if fit.prior_fraction_of(index) > MAX_PRIOR_FRACTION:
        reason += "; it comes from the prior, not from the log"
    return _log_normal_estimate(value, relative, NOT_IDENTIFIABLE, reason)


def _judge_alpha(value: float, fit: Fit, train: Errors, *, is_usable: bool) -> Estimate:
    se = _limit(fit.spread(ALPHA))
    rate_rad_s = float(
        np.quantile(np.abs(np.concatenate([prediction.yaw_rate_rad_s for prediction in train.predictions])), 0.95)
    )
    low, high = max(value - NORMAL_95 * se, 0.0), _limit(value + NORMAL_95 * se)
    term_text = f"at the yaw rates of this log ({math.degrees(rate_rad_s):.2g} deg/s) its term is"
    if ALPHA not in fit.free:
        return Estimate(value, se, value, value, NOT_IDENTIFIABLE, "fixed at zero: --model linear")
    if is_usable and value > MIN_ALPHA_SE * se:
        return Estimate(
            value, se, low, high, IDENTIFIABLE, f"{term_text} {format_percent(value * rate_rad_s**2)} of the yaw rate"
        )
    reason = f"{term_text} at most {format_percent(high * rate_rad_s**2)} of the yaw rate"
    if fit.prior_fraction_of(ALPHA) > MAX_PRIOR_FRACTION:
        reason += "; it comes from the prior, not from the log"
    return Estimate(value, se, low, high, NOT_IDENTIFIABLE, reason)


def _judge_offset(value: float, fit: Fit, data: Data, *, is_usable: bool) -> Estimate:
    se, sd = fit.spread(OFFSET), float(np.std(data.rudder_rad))
    interval = value - NORMAL_95 * se, value + NORMAL_95 * se
    if is_usable and se <= MAX_OFFSET_SE * sd:
        reason = f"known to {format_percent(se / sd)} of the rudder's spread"
        if data.stretches[0].heading_rad is None:
            reason += "; it includes the constant error of the yaw rate over K"
        return Estimate(value, se, *interval, IDENTIFIABLE, reason)
    return Estimate(value, _limit(se), *interval, NOT_IDENTIFIABLE, "its error is as large as the motion of the rudder")


def error_text(relative: float) -> str:
    """Return a text with the relative error `relative`."""
    return f"known to {format_percent(relative)}"


def format_percent(fraction: float) -> str:
    """Return a fraction as text in percent."""
    return "worse than a factor of ten" if fraction >= 10.0 else f"{100.0 * fraction:.2g} %"


def _limit(value: float) -> float:
    return min(MAX_NUMBER, value)
