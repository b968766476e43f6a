"""Page of an estimate: heading with its confidence band, spectrum, innovations, predictions, faults and figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from firmware_py.view.document import PLOTS
from firmware_py.view.model import Line, Panel, Voyage, voyage
from hil.lab.estimate.judgement import reference_after, wrap_angles
from hil.lab.estimate.predictions import Prediction
from hil.lab.estimate.summary import Result, lines_of
from hil.lab.identify.recording import Floats
from hil.report import page
from hil.report.page import Cell
from hil.report.spectrum import heading_spectra
from hil.report.thinning import extremes

MAX_ROWS: Final = 16_000  # of a plot; two hours at 2 Hz are plotted completely
BAND_SDS: Final = 2.0  # half width of a confidence band in standard deviations
MAX_BAND_RATIO: Final = 5.0  # wider bands, relative to the median, are not plotted
PLOTTED_AHEAD_S: Final = (10, 60)
MAX_FAULTS: Final = 500
WARNING: Final = 4
NOTE: Final = (
    "The averaged compass is the compass averaged over one wave period around each time; it is the reference for the "
    "heading of the hull, which is not recorded. Bands are two standard deviations to either side: 19 of 20 values lie "
    "within a correct band."
)
PANELS: Final = (
    Panel(
        "heading, deg",
        (
            Line("compass_deg", "compass", "faint"),
            Line("low_deg", "low", "second"),
            Line("high_deg", "high", "second"),
            Line("heading_deg", "estimate"),
            Line("goal_deg", "goal", "goal"),
        ),
        min_span=10.0,
        wrap=True,
        tall=True,
    ),
    Panel(
        "estimate minus averaged compass, deg",
        (Line("minus_deg", "band", "second"), Line("plus_deg", "band", "second"), Line("error_deg", "error")),
        min_span=2.0,
        zero=True,
    ),
    Panel(
        "innovation / standard deviation", (Line("innovation", "innovation"),), min_span=4.0, band=BAND_SDS, zero=True
    ),
    *(
        Panel(
            f"error of the {seconds} s prediction, deg",
            (
                Line(f"minus_{seconds}_deg", "band", "second"),
                Line(f"plus_{seconds}_deg", "band", "second"),
                Line(f"miss_{seconds}_deg", "error"),
            ),
            min_span=2.0,
            zero=True,
        )
        for seconds in PLOTTED_AHEAD_S
    ),
    Panel("yaw rate, deg/s", (Line("yaw_rate_deg_s", "yaw rate"),), min_span=0.2, zero=True),
    Panel(
        "rudder, deg",
        (
            Line("command_deg", "computed command", "command"),
            Line("rudder_deg", "recorded"),
            Line("bias_deg", "bias", "second"),
        ),
        min_span=4.0,
        zero=True,
    ),
    Panel(
        "speed, m/s",
        (Line("water_m_s", "through the water"), Line("current_m_s", "current", "command")),
        min_span=0.2,
        zero=True,
    ),
    Panel(
        "estimated waves",
        (Line("wave_period_s", "period, s"), Line("noise_deg", "compass noise, deg", "command")),
        min_span=2.0,
        zero=True,
    ),
    Panel("active faults", (Line("faults", "faults", "bad"),), min_span=1.0, zero=True, step=True),
)


def page_of(result: Result, predictions: Mapping[int, Prediction], summary: dict[str, Any]) -> str:
    """Return the page as HTML; `summary` contains the figures of the JSON file."""
    return page.page(
        f"Estimate over {result.recording.name}",
        [
            page.paragraph(_summary_text(summary), "lead"),
            *page.voyage(_voyage(result, predictions)),
            page.paragraph(NOTE, "note"),
            page.heading("Figures"),
            page.table(_figure_rows(summary)),
            *_prediction_parts(summary),
            page.heading("Faults"),
            *_fault_parts(result),
            page.heading("Inputs"),
            page.table(_input_rows(summary), head=False),
            page.bullets(summary["notes"]) if summary["notes"] else "",
            page.heading("Report"),
            page.verbatim("\n".join(lines_of(summary))),
        ],
        PLOTS,
    )


def _summary_text(summary: dict[str, Any]) -> str:
    hours = (summary["to_s"] - summary["from_s"]) / 3600.0
    return f"{summary['headings']} headings in {hours:.2f} h; figures from {summary['judged_from_s']:.0f} s on"


def _voyage(result: Result, predictions: Mapping[int, Prediction]) -> Voyage:
    """Return the plots; times are seconds since the first heading."""
    estimates, judgement = result.estimates, result.judgement
    columns, time_s = estimates.columns, estimates.time_s
    row_step = 1 if time_s.size <= MAX_ROWS else 2 * math.ceil(time_s.size / MAX_ROWS)
    hull = np.unwrap(np.where(np.isfinite(columns["heading_rad"]), columns["heading_rad"], columns["compass_rad"]))
    compass = hull + wrap_angles(columns["compass_rad"] - hull)
    band = _band(columns["heading_sd_rad"])
    plots = {
        "compass_deg": np.degrees(compass),
        "heading_deg": np.degrees(hull),
        "low_deg": np.degrees(hull - band),
        "high_deg": np.degrees(hull + band),
        "goal_deg": np.degrees(estimates.goal_rad),
        "error_deg": np.degrees(wrap_angles(columns["heading_rad"] - judgement.reference_rad)),
        "plus_deg": np.degrees(band),
        "minus_deg": -np.degrees(band),
        "innovation": columns["innovation_rad"]
        / np.where(columns["innovation_sd_rad"] > 0.0, columns["innovation_sd_rad"], np.nan),
        "yaw_rate_deg_s": np.degrees(columns["yaw_rate_rad_s"]),
        "command_deg": np.degrees(columns["command_rad"]),
        "rudder_deg": np.degrees(_rudder(result)),
        "bias_deg": np.degrees(columns["rudder_bias_rad"]),
        "water_m_s": columns["speed_m_s"],
        "current_m_s": np.hypot(columns["current_north_m_s"], columns["current_east_m_s"]),
        "wave_period_s": columns["wave_period_s"],
        "noise_deg": np.degrees(columns["compass_noise_rad"]),
        "faults": _fault_counts(result),
        **_prediction_errors(result, predictions),
    }
    voyage_plots = voyage(
        {"time_s": extremes(time_s, row_step), **{name: extremes(values, row_step) for name, values in plots.items()}},
        [(fault.from_s, WARNING, fault.name) for fault in estimates.faults[:MAX_FAULTS]],
        PANELS,
    )
    learned = columns["wave_period_s"][time_s.size // 2 :]
    if (spectrum := heading_spectra(time_s, compass, hull, learned[np.isfinite(learned)])) is not None:
        voyage_plots["spectrum"] = spectrum
    return voyage_plots


def _band(sd_rad: Floats) -> Floats:
    """Return two standard deviations; NaN if they are very large, as at the start."""
    known_sd = sd_rad[np.isfinite(sd_rad)]
    max_sd = MAX_BAND_RATIO * float(np.median(known_sd)) if known_sd.size else math.inf
    return np.where(sd_rad <= max_sd, BAND_SDS * sd_rad, np.nan)


def _prediction_errors(result: Result, predictions: Mapping[int, Prediction]) -> dict[str, Floats]:
    plots = {}
    for seconds in PLOTTED_AHEAD_S:
        prediction = predictions[seconds]
        later_reference = reference_after(seconds, result.estimates.time_s, result.judgement.reference_rad)
        band = np.degrees(_band(prediction.sd_rad))
        plots[f"miss_{seconds}_deg"] = np.degrees(wrap_angles(prediction.heading_rad - later_reference))
        plots[f"plus_{seconds}_deg"], plots[f"minus_{seconds}_deg"] = band, -band
    return plots


def _rudder(result: Result) -> Floats:
    """Return the recorded rudder angle at the times of the headings."""
    estimates = result.estimates
    if not estimates.rudder_s.size:
        return np.full(estimates.time_s.size, np.nan)
    index = np.searchsorted(estimates.rudder_s, estimates.time_s, side="right") - 1
    return np.where(index >= 0, estimates.rudder_rad[np.maximum(index, 0)], np.nan)


def _fault_counts(result: Result) -> Floats:
    time_s = result.estimates.time_s
    counts = np.zeros(time_s.size)
    for fault in result.estimates.faults:
        counts += (time_s >= fault.from_s) & (time_s < fault.to_s)
    return counts


def _figure_rows(summary: dict[str, Any]) -> Iterator[tuple[str | Cell, ...]]:
    heading, innovations, waves = summary["heading"], summary["innovations"], summary["recorded_waves"]
    yield "figure", "value", Cell("expected")
    yield "heading error, deg rms", _text(heading["rms_error_deg"]), Cell("at most that of the best low-pass")
    yield (
        "best low-pass of the compass (chosen afterwards), deg rms",
        _text(heading["best_low_pass_rms_error_deg"]),
        Cell(f"time constant {_text(heading['best_low_pass_s'])} s"),
    )
    yield "compass itself, deg rms", _text(heading["compass_rms_error_deg"]), Cell("")
    yield "NEES of the heading", _text(heading["nees"]), Cell("1; larger: standard deviation too small")
    yield "NIS", _text(innovations["nis"]), Cell("1; necessary, but not sufficient")
    yield "autocorrelation of the innovations, lag 1", _text(innovations["autocorrelation_lag_1"]), Cell("near 0")
    yield (
        "share of 20 lags outside the 95 % limits",
        _text(innovations["autocorrelation_share_outside_95_percent"]),
        Cell("about 0.05"),
    )
    yield "recorded wave yaw, deg", _text(waves["yaw_sd_deg"]), Cell("standard deviation in the band of the waves")
    yield "recorded wave period, s", _text(waves["period_s"]), Cell("peak of the spectrum of the yaw rate")
    yield (
        "rudder travel of the computed command, deg/h",
        _text(summary["rudder_travel_commanded_deg_per_h"]),
        Cell(f"recorded: {_text(summary['rudder_travel_recorded_deg_per_h'])}"),
    )
    yield "restarts of the estimator", str(len(summary["restarts_s"])), Cell("0")


def _prediction_parts(summary: dict[str, Any]) -> Iterator[str]:
    yield page.heading("Predictions with the recorded rudder")
    if not summary["predictions"]:
        yield page.paragraph("None." if summary["rudder_recorded"] else "None: the rudder was not recorded.")
        return
    rows: list[tuple[str, ...]] = [("ahead", "error, deg rms", "R2", "R2 against the low-passed compass", "NEES")]
    for name, figures in summary["predictions"].items():
        names = ("rms_error_deg", "r2_against_persistence", "r2_against_low_passed_compass", "nees")
        ahead = f"{name.removesuffix('_s')} s"
        rows.append((ahead, *(_text(figures[key]) for key in names)))
    yield page.table(rows)


def _fault_parts(result: Result) -> Iterator[str]:
    faults, begin_s = result.estimates.faults, result.recording.begin_s
    if not faults:
        yield page.paragraph("None.")
        return
    if len(faults) > MAX_FAULTS:
        yield page.paragraph(f"First {MAX_FAULTS} of {len(faults)}; the JSON file lists all.", "note")
    fault_events = [
        (fault.from_s, WARNING, f"{fault.name} for {fault.to_s - fault.from_s:.1f} s") for fault in faults[:MAX_FAULTS]
    ]
    yield page.events(fault_events, lambda t_s: f"{begin_s + t_s:.1f} s")


def _input_rows(summary: dict[str, Any]) -> Iterator[tuple[str, Cell]]:
    ship = summary["ship"]
    yield "ship", Cell(f"K {ship['K']} 1/s, T {ship['T']} s, alpha {ship['alpha']} s², at {ship['speed']} m/s")
    yield "headings", Cell(f"{summary['headings']} at {_text(summary['rate_hz'])} Hz")
    yield "positions", Cell(str(summary["positions"]))
    yield "rudder", Cell("recorded" if summary["rudder_recorded"] else "not recorded: assumed centred")
    for name in ("through_water", "over_ground"):
        speed = summary[f"recorded_speed_{name}_m_s"]
        yield f"speed {name.replace('_', ' ')}", Cell("not recorded" if speed is None else f"mean {_text(speed)} m/s")


def _text(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
