"""Result of an identification as text, as JSON and as a parameter file."""

from __future__ import annotations

import json
import math
from typing import Any

from firmware_py.common.angles import degrees
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import format_value, index_of, parse_file
from hil.errors import UsageError
from hil.lab.identify.filter import COMPASS, DAMPING, DELAY, DIFFUSION, EXPONENT, GYRO, LAG, PERIOD, WALK, WAVE
from hil.lab.identify.identify import Identification
from hil.lab.identify.predict import Errors
from hil.lab.identify.verdict import IDENTIFIABLE, MAX_NUMBER, Estimate

UNITS = {"K": "1/s", "T": "s", "alpha": "s^2", "delta0": "deg"}
MAX_TRIM_DEG = 20.0  # a larger delta0 is not proposed as CTL_TRIM_DEG


def as_json(result: Identification, seconds: float) -> str:
    """Return the result as JSON."""
    fit, judgement, v = result.fit, result.judgement, result.fit.values
    data: dict[str, Any] = {
        "model": result.name,
        **{name: _estimate(estimate) for name, estimate in judgement.estimates.items()},
        "speed_m_s": result.data.speed_m_s,
        "speed_exponent": float(v[EXPONENT]),
        "rudder": {"delay_s": float(v[DELAY]), "lag_s": float(v[LAG])},
        "levels": {
            "diffusion_deg2_s": degrees(degrees(math.exp(v[DIFFUSION]))),
            "wave_yaw_deg": degrees(math.exp(v[WAVE])),
            "wave_period_s": math.exp(v[PERIOD]),
            "wave_damping": math.exp(v[DAMPING]),
            "compass_noise_deg": degrees(math.exp(v[COMPASS])) if COMPASS in fit.free else None,
            "yaw_rate_noise_deg_s": degrees(math.exp(v[GYRO])) if GYRO in fit.free else None,
            "bias_walk_deg_sqrt_s": degrees(math.exp(v[WALK])),
        },
        "train": _errors(result.train),
        "validate": [{"file": errors.file, **_errors(errors)} for errors in result.validate],
        "evaluations": fit.evaluations,
        "seconds": seconds,
        "rows": result.data.rows,
        "stretches": len(result.data.stretches),
        "outliers": fit.outliers,
        "explained": result.train.explained,
        "log_likelihood_gain": fit.gain,
        "suggestion": suggestion(result),
        "warnings": _warnings(result),
        "notes": list(result.data.notes),
    }
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": estimate.value,
        "se": estimate.se,
        "interval": [estimate.low, estimate.high],
        "verdict": estimate.verdict,
        "why": estimate.reason,
    }


def _errors(errors: Errors) -> dict[str, float | None]:
    return {
        "yaw_rate_rmse_rad_s": errors.yaw_rate_rmse_rad_s,
        "heading_rmse_rad": errors.heading_rmse_rad,
        "heading_mean_rad": errors.heading_mean_rad,
        "heading_within_95_rad": errors.heading_95_rad,
    }


def _warnings(result: Identification) -> list[str]:
    return [*result.judgement.warnings, *(text for errors in result.validate for text in errors.warnings)]


def suggestion(result: Identification) -> str | None:
    """Return the manoeuvre that would identify the other parameters, None if all are identified."""
    estimates = result.judgement.estimates
    if not result.judgement.is_usable:
        return (
            "record a zigzag for 10 minutes: 20 deg of rudder to alternate sides, each until the heading has changed "
            "by 20 deg; if that does not help, check that the rudder column is the real rudder"
        )
    if any(estimates[name].verdict != IDENTIFIABLE for name in ("K", "T")):
        return (
            "for K and T record a zigzag with 20 deg of rudder to alternate sides for 10 minutes, at 10 rows per second"
        )
    if estimates["alpha"].verdict != IDENTIFIABLE:
        return "for alpha record circles with full and with a third of the rudder to each side, each for several T"
    return None


def as_text(result: Identification, *, is_angle: bool = True) -> str:
    """Return the report for the terminal; is_angle: the rudder column is an angle."""
    lines = [*_header(result), "", *_table(result, is_angle=is_angle), "", *_model(result), *_predictions(result)]
    text = suggestion(result)
    if text is not None:
        lines += ["", f"suggestion: {text}"]
    lines += [f"warning: {text}" for text in _warnings(result)]
    lines += [f"note: {text}" for text in result.data.notes]
    return "\n".join(lines)


def _header(result: Identification) -> list[str]:
    data = result.data
    outliers = f", {result.fit.outliers} outliers" if result.fit.outliers else ""
    speed = "" if data.speed_m_s is None else f"; values are valid at {data.speed_m_s:.3g} m/s"
    return [f"{data.rows} rows, {data.duration_s:.0f} s in {len(data.stretches)} stretch(es){outliers}{speed}"]


def _table(result: Identification, *, is_angle: bool) -> list[str]:
    rows = [("", "value", "95 % interval", "", "verdict")]
    for name, estimate in result.judgement.estimates.items():
        verdict = f"{estimate.verdict}; {estimate.reason}"
        rows.append((name, *format_estimate(name, estimate, is_angle=is_angle), verdict))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        "  ".join(
            (row[0].ljust(widths[0]), row[1].rjust(widths[1]), row[2].ljust(widths[2]), row[3].ljust(widths[3]), row[4])
        ).rstrip()
        for row in rows
    ]


def format_estimate(name: str, estimate: Estimate, *, is_angle: bool) -> tuple[str, str, str]:
    """Return value, interval and unit as texts; is_angle: the rudder column is an angle."""
    unit = UNITS[name] if is_angle or name in ("T", "alpha") else ""
    scale = degrees(1.0) if name == "delta0" and is_angle else 1.0
    value, low, high = (scale * number for number in (estimate.value, estimate.low, estimate.high))
    return f"{value:.5g}", f"{low:.4g} to {high:.4g}" if high < MAX_NUMBER else "unknown", unit


def _model(result: Identification) -> list[str]:
    v, fit = result.fit.values, result.fit
    noise = (
        f"compass noise {degrees(math.exp(v[COMPASS])):.2g} deg"
        if COMPASS in fit.free
        else f"yaw rate noise {degrees(math.exp(v[GYRO])):.2g} deg/s"
    )
    lines = [
        f"model: {result.name}; rudder with a dead time of {v[DELAY]:.2g} s and a lag of {v[LAG]:.2g} s",
        (
            f"disturbances: yaw diffusion {degrees(degrees(math.exp(v[DIFFUSION]))):.2g} deg^2/s, wave yaw "
            f"{degrees(math.exp(v[WAVE])):.2g} deg with a period of {math.exp(v[PERIOD]):.2g} s, {noise}"
        ),
    ]
    if EXPONENT in fit.free:
        lines.append(
            f"speed: K, 1/T and 1/sqrt(alpha) vary with the speed to the power {v[EXPONENT]:.2g} (similarity: 1), "
            f"+-{1.96 * fit.spread(EXPONENT):.2g}"
        )
    explained = 100.0 * max(result.train.explained, 0.0)
    lines.append(f"explained by the rudder alone: {explained:.0f} % of the turns within each T (R2)")
    return lines


def _predictions(result: Identification) -> list[str]:
    lines = []
    for errors in (result.train, *result.validate):
        texts = []
        if errors.yaw_rate_rmse_rad_s is not None:
            texts.append(f"yaw rate rms {degrees(errors.yaw_rate_rmse_rad_s):.4g} deg/s")
        if (
            errors.heading_rmse_rad is not None
            and errors.heading_mean_rad is not None
            and errors.heading_95_rad is not None
        ):
            texts.append(
                f"heading mean {degrees(errors.heading_mean_rad):+.2g}, rms {degrees(errors.heading_rmse_rad):.3g}, "
                f"95 % within {degrees(errors.heading_95_rad):.3g} deg"
            )
        name = "errors on the training data" if errors is result.train else f"prediction of {errors.file}"
        lines.append(f"{name}: " + "; ".join(texts))
    return lines


def as_parameters(result: Identification, unit: str) -> str:
    """Return a parameter file of the model, or raise UsageError if it is not usable."""
    if unit == "any":
        raise UsageError(
            "no parameter file: K is per unit of a command that is not an angle; give the rudder in radians"
        )
    estimates = result.judgement.estimates
    if not result.judgement.is_usable:
        raise UsageError("no parameter file: the log shows no effect of the rudder")
    if estimates["K"].value <= 0.0:
        raise UsageError("no parameter file: K is negative; invert the sign of the rudder column")
    model = result.model()
    values = {"MDL_K": model.turning_ability_1_s, "MDL_T_S": model.turning_lag_s, "MDL_ALPHA_S2": model.norrbin_s2}
    if result.data.speed_m_s is not None:
        values["MDL_SPEED"] = result.data.speed_m_s
    trim_deg = degrees(estimates["delta0"].value)
    if estimates["delta0"].verdict == IDENTIFIABLE and abs(trim_deg) <= MAX_TRIM_DEG:
        values["CTL_TRIM_DEG"] = trim_deg
    lines = [f"# Identified by rambler-hil identify, {result.name} model."]
    lines += [f"# {name}: {estimate.verdict}; {estimate.reason}" for name, estimate in estimates.items()]
    if result.data.speed_m_s is None:
        lines.append("# The logs contain no speed: set MDL_SPEED.")
    try:
        lines += [f"{name} {format_value(TABLE[index_of(name)].check(value))}" for name, value in values.items()]
        text = "\n".join(lines) + "\n"
        parse_file(text, "identified parameters")
    except ParameterError as error:
        raise UsageError(f"no parameter file: {error}; the model is outside the range of the parameters") from None
    return text
