"""Figures of an estimate as JSON and as text for the terminal."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py.common.angles import TWO_PI
from firmware_py.common.parameters import ParameterSet
from hil.lab.estimate.boat import SHIP_PARAMETERS
from hil.lab.estimate.judgement import Judgement
from hil.lab.estimate.predictions import Prediction
from hil.lab.estimate.recording import Recording
from hil.lab.estimate.tick import COLUMNS, Estimates
from hil.lab.identify.recording import Floats

HOUR_S = 3600.0
DIGITS = 6
# column -> key of a learned value, the median of the second half; keys that end in _deg are in degrees
LEARNED_VALUES = {
    "speed_m_s": "speed_m_s",
    "current_north_m_s": "current_north_m_s",
    "current_east_m_s": "current_east_m_s",
    "rudder_bias_rad": "rudder_bias_deg",
    "wave_period_s": "wave_period_s",
    "compass_noise_rad": "compass_noise_deg",
}


@dataclass(frozen=True, slots=True)
class Result:
    """A recording with its parameters, estimates, figures and notes."""

    recording: Recording
    parameters: ParameterSet
    estimates: Estimates
    judgement: Judgement
    notes: tuple[str, ...]


def as_json(result: Result) -> dict[str, Any]:
    """Return the summary; unknown figures are null. Times are those of the file."""
    recording, estimates, judgement = result.recording, result.estimates, result.judgement
    begin_s, white, waves = recording.begin_s, judgement.whiteness, judgement.waves
    hours = max(float(estimates.time_s[-1]) / HOUR_S, 1e-9)
    return {
        "file": recording.name,
        "from_s": _time(begin_s),
        "to_s": _time(begin_s + float(estimates.time_s[-1])),
        "judged_from_s": _time(begin_s + judgement.from_s),
        "headings": int(estimates.time_s.size),
        "rate_hz": _number(1.0 / float(np.median(np.diff(estimates.time_s)))),
        "positions": len(recording.positions),
        "rudder_recorded": bool(recording.rudder),
        "ship": {name: _number(result.parameters[row]) for name, row in SHIP_PARAMETERS.items()},
        "recorded_speed_through_water_m_s": _number(recording.water_m_s),
        "recorded_speed_over_ground_m_s": _number(recording.ground_m_s),
        "recorded_waves": {
            "period_s": _number(None if waves is None else waves.period_s),
            "yaw_sd_deg": _degrees(None if waves is None else waves.sd_rad),
        },
        "innovations": {
            "nis": _number(judgement.nis),
            "autocorrelation_lag_1": _number(None if white is None else white.lag_one),
            "autocorrelation_share_outside_95_percent": _number(None if white is None else white.outside_fraction),
            "white": None if white is None else white.is_white,
        },
        "heading": {
            "rms_error_deg": _degrees(judgement.rms_error_rad),
            "nees": _number(judgement.nees),
            "compass_rms_error_deg": _degrees(judgement.compass_error_rad),
            "best_low_pass_rms_error_deg": _degrees(judgement.low_pass_error_rad),
            "best_low_pass_s": _number(judgement.low_pass_s),
        },
        "predictions": {
            f"{seconds}_s": {
                "rows": figures.rows,
                "rms_error_deg": _degrees(figures.rms_error_rad),
                "r2_against_persistence": _number(figures.r2),
                "r2_against_low_passed_compass": _number(figures.r2_low_pass),
                "nees": _number(figures.nees),
            }
            for seconds, figures in judgement.predictions.items()
        },
        "estimated": {key: _learned(estimates.columns[name], key) for name, key in LEARNED_VALUES.items()},
        "rudder_travel_commanded_deg_per_h": _number(math.degrees(estimates.travel_rad) / hours),
        "rudder_travel_recorded_deg_per_h": _number(_recorded_travel_deg(estimates, hours)),
        "restarts_s": [_time(begin_s + t_s) for t_s in estimates.restarts_s],
        "faults": [
            {"name": fault.name, "from_s": _time(begin_s + fault.from_s), "to_s": _time(begin_s + fault.to_s)}
            for fault in estimates.faults
        ],
        "notes": list(result.notes),
    }


def lines_of(summary: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as text."""
    heading, innovations, waves = summary["heading"], summary["innovations"], summary["recorded_waves"]
    minutes = (summary["to_s"] - summary["from_s"]) / 60.0
    rate = f"{_text(summary['rate_hz'])} Hz"
    yield f"{summary['headings']} headings in {minutes:.0f} min at {rate}, {summary['positions']} positions"
    yield f"recorded wave yaw: {_text(waves['yaw_sd_deg'])} deg, period {_text(waves['period_s'])} s"
    yield (
        f"heading error {_text(heading['rms_error_deg'])} deg rms, NEES {_text(heading['nees'])}; compass "
        f"{_text(heading['compass_rms_error_deg'])} deg, best low-pass "
        f"{_text(heading['best_low_pass_rms_error_deg'])} deg"
    )
    yield (
        f"innovations: NIS {_text(innovations['nis'])}, autocorrelation of lag 1 "
        f"{_text(innovations['autocorrelation_lag_1'])}"
    )
    for name, figures in summary["predictions"].items():
        r2, r2_low_pass = figures["r2_against_persistence"], figures["r2_against_low_passed_compass"]
        yield (
            f"predicted {name.removesuffix('_s')} s ahead: {_text(figures['rms_error_deg'])} deg rms, R2 {_text(r2)} "
            f"({_text(r2_low_pass)} against the low-passed compass), NEES {_text(figures['nees'])}"
        )
    travel = f"rudder travel of the computed command: {summary['rudder_travel_commanded_deg_per_h']:.0f} deg/h"
    recorded_travel = summary["rudder_travel_recorded_deg_per_h"]
    yield travel if recorded_travel is None else f"{travel}; recorded: {recorded_travel:.0f} deg/h"
    yield f"restarts: {len(summary['restarts_s'])}"
    yield from (f"{fault['name']} from {fault['from_s']:.1f} s to {fault['to_s']:.1f} s" for fault in summary["faults"])
    yield from (f"note: {note}" for note in summary["notes"])


def _recorded_travel_deg(estimates: Estimates, hours: float) -> float | None:
    angles = estimates.rudder_rad
    return math.degrees(float(np.sum(np.abs(np.diff(angles))))) / hours if angles.size > 1 else None


def _learned(values: Floats, key: str) -> float | None:
    half = values[values.size // 2 :]
    finite_values = half[np.isfinite(half)]
    median_value = float(np.median(finite_values)) if finite_values.size else None
    return _degrees(median_value) if key.endswith("_deg") else _number(median_value)


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else _number(math.degrees(angle_rad))


def _number(value: float | None) -> float | None:
    """Return a number for JSON; None for NaN and infinity."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}")


def _time(time_s: float) -> float:
    return round(time_s, 3)


def _text(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3g}"


ESTIMATE_COLUMNS = COLUMNS[:-2]  # the command and the compass are not estimates
CSV_DIGITS = 9


def table_of(time_s: Floats, estimates: Estimates, predictions: Mapping[int, Prediction]) -> dict[str, Floats]:
    """Return the columns of the CSV file by name; `time_s` are the times of the file."""
    table = {"time_s": time_s, **{name: estimates.columns[name] for name in ESTIMATE_COLUMNS}}
    for seconds, prediction in predictions.items():
        table[f"heading_in_{seconds}_s_rad"] = np.asarray(prediction.heading_rad % TWO_PI)
        table[f"heading_in_{seconds}_s_sd_rad"] = prediction.sd_rad
    return table


def as_csv(table: Mapping[str, Floats]) -> str:
    """Return the columns as CSV text; times are exact."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    names = list(table)[1:]
    for time_s, *values in zip(table["time_s"].tolist(), *(table[name].tolist() for name in names), strict=True):
        writer.writerow((time_s, *(f"{value:.{CSV_DIGITS}g}" if math.isfinite(value) else "" for value in values)))
    return text.getvalue()
