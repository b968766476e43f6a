"""Conversion of runs and logs to voyages, the data of the plots of firmware_py.view, with a limited number of rows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from firmware_py.common.plan import Plan
from firmware_py.view.model import Line, Panel, Voyage, numbers, plan_rows, voyage
from hil.report import thin_log
from hil.report.field_log import FieldLog
from hil.report.spectrum import log_spectra
from hil.report.thin_log import ThinTable, gap_rows, panel_values, positions_m, with_breaks
from hil.report.thinning import thin_truth
from hil.sim.truth import Array, Truth
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG

MAX_AGE_S: Final = 2.5  # of values that are logged once a second
_DAY_LINES: Final = 20_000


def run_voyage(truth: Truth, log: FieldLog | None, shift_s: float) -> Voyage:
    """Return the voyage of a run: a thinned truth and the logged values, whose time is `shift_s` less."""
    # Goals of the run replace those in the log; a mission has only those in the log.
    finite_columns = {name: column for name, column in _columns(truth).items() if np.isfinite(column).any()}
    voyage_data = voyage(
        {**({} if log is None else _onboard(log, truth.time_s - shift_s)), **finite_columns},
        [] if log is None else [(t_s + shift_s, severity, text) for t_s, severity, text in log.texts],
    )
    voyage_data["origin"] = [START_LATITUDE_DEG, START_LONGITUDE_DEG]
    if log is not None:
        voyage_data |= _plans_and_spectrum(log)
    return voyage_data


def field_voyage(log: FieldLog) -> Voyage:
    """Return the voyage of the logs of a boat."""
    truth = log.truth
    thinned_truth = thin_truth((truth,), truth.time_s.size)
    gaps = np.searchsorted(thinned_truth.time_s, truth.time_s[list(log.cuts)])
    columns = with_breaks(
        thinned_truth.time_s, {**_onboard(log, thinned_truth.time_s), **_columns(thinned_truth)}, gaps
    )
    voyage_data = voyage(columns, log.texts) | _plans_and_spectrum(log)
    voyage_data["begin_utc_s"] = log.axis_utc_s()
    voyage_data["origin"] = None if log.origin is None else numbers(log.origin, 7)
    return voyage_data


def days_voyage(table: ThinTable) -> Voyage:
    """Return the voyage of a thin log: one row a minute, lines broken at gaps."""
    begin_s = float(table["Utc"][0])
    every = max(1, math.ceil(table.rows / _DAY_LINES))
    north_m, east_m = positions_m(table)
    panel_columns = {f"day_{number}": panel_values(table, panel) for number, panel in enumerate(thin_log.PANELS)}
    time_s = table["Utc"] - begin_s
    columns = with_breaks(time_s, {**panel_columns, "north_m": north_m, "east_m": east_m}, gap_rows(time_s))
    panels = [
        Panel(title, (Line(f"day_{number}", title),), step=label == "Flt")
        for number, (title, label, _) in enumerate(thin_log.PANELS)
    ]
    voyage_data = voyage({name: column[::every] for name, column in columns.items()}, (), panels)
    return voyage_data | {"begin_utc_s": begin_s}


def _columns(truth: Truth) -> dict[str, Array]:
    has_no_waves = np.array_equal(truth.heading_rad, truth.heading_low_rad)
    has_no_track = not (np.any(truth.north_m) or np.any(truth.east_m))  # no receiver
    return {
        "time_s": truth.time_s,
        **({} if has_no_waves else {"compass_deg": np.degrees(truth.heading_rad)}),
        "heading_deg": np.degrees(truth.heading_low_rad),
        "goal_deg": np.degrees(truth.goal_rad),
        "error_deg": np.degrees(truth.heading_low_rad - truth.goal_rad),
        "yaw_rate_deg_s": np.degrees(truth.yaw_rate_rad_s),
        "rudder_deg": np.degrees(truth.rudder_rad),
        "command_deg": np.degrees(truth.rudder_command_rad),
        **({} if has_no_track else {"north_m": truth.north_m, "east_m": truth.east_m}),
    }


def _onboard(log: FieldLog, times_s: Array) -> dict[str, Array]:
    """Return the logged values at some times of the log; NaN if older than MAX_AGE_S."""
    time_s = log.truth.time_s
    rows = np.searchsorted(time_s, times_s + 1e-6, side="right") - 1
    values_at_times: dict[str, Array] = {}
    for name, values in log.columns.items():
        finite_rows = np.flatnonzero(np.isfinite(values))
        if not finite_rows.size:
            continue
        newest = np.searchsorted(finite_rows, rows, side="right") - 1
        source = finite_rows[np.maximum(newest, 0)]
        is_recent = (newest >= 0) & (times_s - time_s[source] <= MAX_AGE_S)
        values_at_times[name] = np.where(is_recent, values[source], math.nan)
    return values_at_times


def _plans_and_spectrum(log: FieldLog) -> dict[str, Any]:
    plans: dict[str, Any] = {name: plan_rows(plan) for name, plan in _nonempty_plans(log.plans)}
    if log.home is not None:
        plans["home"] = numbers(log.home, 7)
    voyage_data: dict[str, Any] = {"plans": plans, "first_item": log.first_item} if plans else {}
    if (spectrum := log_spectra(log)) is not None:
        voyage_data["spectrum"] = spectrum
    return voyage_data


def _nonempty_plans(plans: Mapping[str, Plan]) -> Iterator[tuple[str, Plan]]:
    return ((name, plan) for name, plan in plans.items() if plan.items)
