"""Runs and logs as voyages, the data of the plots of firmware_py.view: few rows for any length."""

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
from hil.report.thin_log import ThinTable, broken, gaps_of, panel_values, places_m
from hil.report.thinning import thinned
from hil.sim.truth import Array, Truth
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG

MAX_AGE_S: Final = 2.5  # of slow values, which are logged every second
_DAY_LINES: Final = 20_000


def run_voyage(truth: Truth, log: FieldLog | None, shift_s: float) -> Voyage:
    """Return the voyage of a run: a thinned truth and the boat's logged values, which are `shift_s` earlier."""
    # Goals of the run precede those in the log; in a mission there are only the latter.
    known = {name: column for name, column in _columns(truth).items() if np.isfinite(column).any()}
    made = voyage(
        {**({} if log is None else _onboard(log, truth.time_s - shift_s)), **known},
        [] if log is None else [(t_s + shift_s, severity, text) for t_s, severity, text in log.texts],
    )
    made["origin"] = [START_LATITUDE_DEG, START_LONGITUDE_DEG]
    if log is not None:
        made |= _beside(log)
    return made


def field_voyage(log: FieldLog) -> Voyage:
    """Return the voyage of a boat's own logs."""
    truth = log.truth
    few = thinned((truth,), truth.time_s.size)
    gaps = np.searchsorted(few.time_s, truth.time_s[list(log.cuts)])
    columns = broken(few.time_s, {**_onboard(log, few.time_s), **_columns(few)}, gaps)
    made = voyage(columns, log.texts) | _beside(log)
    made["begin_utc_s"], made["origin"] = log.axis_utc_s(), None if log.origin is None else numbers(log.origin, 7)
    return made


def days_voyage(table: ThinTable) -> Voyage:
    """Return the voyage of a thin log: one row a minute, lines broken at gaps."""
    begin_s = float(table["Utc"][0])
    every = max(1, math.ceil(table.rows / _DAY_LINES))
    north_m, east_m = places_m(table)
    named = {f"day_{number}": panel_values(table, panel) for number, panel in enumerate(thin_log.PANELS)}
    time_s = table["Utc"] - begin_s
    columns = broken(time_s, {**named, "north_m": north_m, "east_m": east_m}, gaps_of(time_s))
    panels = [
        Panel(title, (Line(f"day_{number}", title),), step=label == "Flt")
        for number, (title, label, _) in enumerate(thin_log.PANELS)
    ]
    made = voyage({name: column[::every] for name, column in columns.items()}, (), panels)
    return made | {"begin_utc_s": begin_s}


def _columns(truth: Truth) -> dict[str, Array]:
    bare = np.array_equal(truth.heading_rad, truth.heading_low_rad)
    lying = not (np.any(truth.north_m) or np.any(truth.east_m))  # without a receiver there is no track
    return {
        "time_s": truth.time_s,
        **({} if bare else {"compass_deg": np.degrees(truth.heading_rad)}),
        "heading_deg": np.degrees(truth.heading_low_rad),
        "goal_deg": np.degrees(truth.goal_rad),
        "error_deg": np.degrees(truth.heading_low_rad - truth.goal_rad),
        "yaw_rate_deg_s": np.degrees(truth.yaw_rate_rad_s),
        "rudder_deg": np.degrees(truth.rudder_rad),
        "command_deg": np.degrees(truth.rudder_command_rad),
        **({} if lying else {"north_m": truth.north_m, "east_m": truth.east_m}),
    }


def _onboard(log: FieldLog, at_s: Array) -> dict[str, Array]:
    """Return the logged values at some times of the log; NaN if older than MAX_AGE_S."""
    time_s = log.truth.time_s
    place = np.searchsorted(time_s, at_s + 1e-6, side="right") - 1
    found: dict[str, Array] = {}
    for name, values in log.more.items():
        known = np.flatnonzero(np.isfinite(values))
        if not known.size:
            continue
        newest = np.searchsorted(known, place, side="right") - 1
        source = known[np.maximum(newest, 0)]
        fresh = (newest >= 0) & (at_s - time_s[source] <= MAX_AGE_S)
        found[name] = np.where(fresh, values[source], math.nan)
    return found


def _beside(log: FieldLog) -> dict[str, Any]:
    plans: dict[str, Any] = {name: plan_rows(plan) for name, plan in _plans(log.plans)}
    if log.home is not None:
        plans["home"] = numbers(log.home, 7)
    made: dict[str, Any] = {"plans": plans, "first_item": log.first_item} if plans else {}
    if (spectrum := log_spectra(log)) is not None:
        made["spectrum"] = spectrum
    return made


def _plans(plans: Mapping[str, Plan]) -> Iterator[tuple[str, Plan]]:
    return ((name, plan) for name, plan in plans.items() if plan.items)
