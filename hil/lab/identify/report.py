"""The result as text for a reader, as JSON for a program, and as parameters for the autopilot."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from firmware_py.common.angles import degrees
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import format_value, index_of, parse_file
from hil.errors import UsageError
from hil.lab.identify.held_out import HeldOut
from hil.lab.identify.identify import Identification
from hil.lab.identify.suggest import Suggestion
from hil.lab.identify.verdict import IDENTIFIABLE, Estimate

UNITS = {"K": "1/s", "T": "s", "alpha": "s^2", "delta0": "deg"}
LARGEST_TRIM_DEG = 20.0


def as_json(result: Identification, seconds: float, suggestion: Suggestion | None) -> str:
    """Return the contract's JSON, with more in it."""
    estimates = result.judgement.estimates
    data: dict[str, Any] = {
        "model": result.choice.model,
        **{name: _estimate(estimate) for name, estimate in estimates.items()},
        "K_over_T": _estimate(result.judgement.ratio),
        "speed_m_s": result.data.speed_m_s,
        "speed_scaled": result.choice.scaled,
        "train": _errors(result.train),
        "validate": [{"file": part.file, **_errors(part)} for part in result.validate],
        "evaluations": result.evaluations,
        "seconds": seconds,
        "rows": result.data.rows,
        "stretches": len(result.data.stretches),
        "outliers": result.data.spikes + result.fit.spikes,
        "explained": result.loop.explained,
        "closed_loop": result.loop.answered > 0.0,
        "correlations": dict(result.judgement.correlations),
        "whiteness": {
            name: {"lag_one": spectrum.lag_one, "outside_band": spectrum.outside, "white": spectrum.white}
            for name, spectrum in result.whiteness.items()
        },
        "search": {
            "scan_misfit": result.brought.scan,
            "swarm_misfit": result.brought.swarm,
            "swarm_evaluations": result.brought.swarm_evaluations,
            "refined_misfit": result.brought.refined,
            "refine_evaluations": result.brought.refine_evaluations,
        },
        "why": {"model": result.choice.why, "speed": result.choice.speed_why, "rudder": result.choice.timing.why},
        "suggestion": None if suggestion is None else suggestion.text,
        "warnings": _warnings(result),
        "notes": list(result.data.notes),
    }
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "se": estimate.se, "verdict": estimate.verdict, "why": estimate.why}


def _errors(part: HeldOut) -> dict[str, float | None]:
    return {
        "yaw_rate_rmse_rad_s": part.yaw_rate_rmse_rad_s,
        "heading_rmse_rad": part.heading_rmse_rad,
        "heading_mean_rad": part.heading_mean_rad,
        "heading_within_95_rad": part.heading_within_rad,
    }


def _warnings(result: Identification) -> list[str]:
    return [*result.judgement.warnings, *(text for part in result.validate for text in part.warnings)]


def as_text(result: Identification, suggestion: Suggestion | None, *, angular: bool = True) -> str:
    """Return the report that stands on the terminal; angular: the rudder column is an angle."""
    lines = [*_header(result), "", *_table(result, angular=angular), ""]
    lines.append(f"model: {result.choice.model} ({result.choice.why})")
    if result.choice.speed_why:
        lines.append(f"speed: {result.choice.speed_why}")
    if result.choice.timing.why:
        lines.append(f"timing: {result.choice.timing.why}")
    correlations = ", ".join(f"{name} {value:+.2f}" for name, value in result.judgement.correlations.items())
    lines.append(f"correlations: {correlations}")
    lines += ["", *(_whiteness(result)), *_predictions(result), "", _search(result)]
    if suggestion is not None:
        lines += ["", f"suggestion: {suggestion.text}"]
    lines += [f"warning: {text}" for text in _warnings(result)]
    lines += [f"note: {text}" for text in result.data.notes]
    return "\n".join(lines)


def _header(result: Identification) -> list[str]:
    data = result.data
    seconds = sum(float(stretch.time_s[-1] - stretch.time_s[0]) for stretch in data.stretches)
    spikes = data.spikes + result.fit.spikes
    outliers = f", {spikes} outliers replaced" if spikes else ""
    speed = "" if data.speed_m_s is None else f"; values hold at {data.speed_m_s:.3g} m/s"
    return [f"{data.rows} rows, {seconds:.0f} s in {len(data.stretches)} stretch(es){outliers}{speed}"]


def _table(result: Identification, *, angular: bool) -> list[str]:
    rows = [("", "value", "+-", "", "verdict")]
    for name, estimate in result.judgement.estimates.items():
        rows.append((name, *figures(name, estimate, angular=angular), f"{estimate.verdict}; {estimate.why}"))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        "  ".join(
            (row[0].ljust(widths[0]), row[1].rjust(widths[1]), row[2].rjust(widths[2]), row[3].ljust(widths[3]), row[4])
        ).rstrip()
        for row in rows
    ]


def figures(name: str, estimate: Estimate, *, angular: bool) -> tuple[str, str, str]:
    """Return value, standard error and unit as they are shown; angular: the rudder column is an angle."""
    value, se, unit = estimate.value, estimate.se, UNITS[name] if angular or name in ("T", "alpha") else ""
    if name == "delta0" and angular:
        value, se = degrees(value), degrees(se)
    return f"{value:.5g}", f"{se:.2g}" if se < 1e9 else "unknown", unit


def _whiteness(result: Identification) -> list[str]:
    names = {"heading": "heading", "yaw_rate": "yaw rate"}
    texts = [
        f"{names[name]}: {'white' if colour.white else 'coloured'} (correlation of neighbours {colour.lag_one:+.2f})"
        for name, colour in result.whiteness.items()
    ]
    answers = "; the rudder answers the rest (closed loop)" if result.loop.answered else ""
    explained = f"explained: {100.0 * max(result.loop.explained, 0.0):.0f} % of the motion (R2){answers}"
    weights = result.fit.problem.channel_weights()
    power = (np.array(weights) * result.fit.accuracy.noise.spread**2).tolist()
    named = zip(result.whiteness, power, strict=True)
    shares = [f"{names[name]} {100.0 * share / sum(power):.0f} %" for name, share in named]
    worth = f"worth {result.fit.effective_rows:.0f} independent rows, which the standard errors allow for"
    return [explained, f"residuals: {'; '.join(texts)}; {worth}", f"weight in the fit: {', '.join(shares)}"]


def _predictions(result: Identification) -> list[str]:
    lines = []
    for part in (result.train, *result.validate):
        parts = []
        if part.yaw_rate_rmse_rad_s is not None:
            parts.append(f"yaw rate rms {degrees(part.yaw_rate_rmse_rad_s):.4g} deg/s")
        if (
            part.heading_rmse_rad is not None
            and part.heading_mean_rad is not None
            and part.heading_within_rad is not None
        ):
            mean = "" if part is result.train else f"mean {degrees(part.heading_mean_rad):+.2g}, "
            parts.append(
                f"heading {mean}rms {degrees(part.heading_rmse_rad):.3g}, "
                f"95 % within {degrees(part.heading_within_rad):.3g} deg"
            )
        name = "errors on the training data" if part is result.train else f"prediction of {part.file}"
        lines.append(f"{name}: " + "; ".join(parts))
    return lines


def _search(result: Identification) -> str:
    brought = result.brought
    steps = (
        f"{brought.scan:.3g} by the scan over T",
        f"{brought.swarm:.3g} by the fish swarm ({brought.swarm_evaluations} evaluations)",
        f"{brought.refined:.3g} after refinement ({brought.refine_evaluations} evaluations)",
    )
    return "search: share of the averaged motion left unexplained: " + ", ".join(steps)


def about_alpha(result: Identification) -> str:
    """Say what a parameter file does to alpha where none is in the model; nothing where one is."""
    if result.model().norrbin_s2 > 0.0:
        return ""
    delivered, alpha = TABLE[index_of("MDL_ALPHA_S2")].default, result.judgement.estimates["alpha"]
    most = "" if not 0.0 < alpha.se < 1e9 else f"; this log allows up to {alpha.value + 1.96 * alpha.se:.3g} s^2"
    return (
        f"MDL_ALPHA_S2 is written as 0, over what the boat has (delivered: {delivered:g}, of another boat): K and T "
        f"were fitted without alpha, and go with 0 alone{most}"
    )


def as_parameters(result: Identification, unit: str) -> str:
    """Return a parameter file of the model, or raise UsageError when there is none for the autopilot."""
    if unit == "any":
        raise UsageError("no parameter file: K is per unit of a command that is no angle; give the rudder in radians")
    judgement = result.judgement
    estimates = judgement.estimates
    if not judgement.usable:
        raise UsageError("no parameter file: neither K and T nor their ratio can be told from this log")
    if estimates["K"].value <= 0.0:
        raise UsageError("no parameter file: K is negative; turn the sign of the rudder column")
    model = result.model()
    values = {
        "MDL_K": model.turning_ability_1_s,
        "MDL_T_S": model.turning_lag_s,
        "MDL_ALPHA_S2": max(model.norrbin_s2, 0.0),
    }
    if result.data.speed_m_s is not None:
        values["MDL_SPEED"] = result.data.speed_m_s
    trim_deg = degrees(estimates["delta0"].value)
    if estimates["delta0"].verdict == IDENTIFIABLE and abs(trim_deg) <= LARGEST_TRIM_DEG:
        values["CTL_TRIM_DEG"] = trim_deg
    lines = [f"# Identified by rambler-hil identify, {result.choice.model} model."]
    lines += [f"# {name}: {estimate.verdict}; {estimate.why}" for name, estimate in estimates.items()]
    lines += [f"# {text}." for text in (about_alpha(result),) if text]
    if result.data.speed_m_s is None:
        lines.append("# The logs have no speed: set MDL_SPEED to what it was.")
    try:
        lines += [f"{name} {format_value(TABLE[index_of(name)].check(value))}" for name, value in values.items()]
        text = "\n".join(lines) + "\n"
        parse_file(text, "identified parameters")
    except ParameterError as error:
        raise UsageError(f"no parameter file: {error}; the model lies outside of what the autopilot takes") from None
    return text
