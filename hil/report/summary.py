"""summary.json: the results of a run for other programs, computed from the directory of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.log.disk import log_files
from hil.errors import HilError, UsageError
from hil.report import field_log
from hil.report.field_log import FieldLog
from hil.report.figures import RudderTravel, goal_figures, steady_rudder_travel_deg_per_h
from hil.sim import run_file
from hil.sim.run_directory import STATE, SUMMARY, TRUTH_FILE
from hil.sim.run_file import OrderRecord, RunFile
from hil.sim.truth import RecordedTruth

DIGITS = 4  # decimals
MAX_FULL_BYTES = 64 << 20  # of logs with all ticks, about 3 h
Summary = dict[str, Any]


def summarise(record: RunFile, out: Path, log: FieldLog | None = None) -> Summary:
    """Return the content of summary.json; raise UsageError if the truth cannot be read.

    Errors are the heading without wave yaw minus the goal.
    """
    truth = RecordedTruth(out / TRUTH_FILE)
    try:
        figures = goal_figures(truth)
        travel, end_s = RudderTravel(), 0.0
        for piece in truth:
            travel.add(piece.time_s, piece.rudder_rad)
            end_s = float(piece.time_s[-1])
    except (OSError, ValueError) as error:
        raise UsageError(f"{out}: {error}; name the directory of a run") from None
    goals = [asdict(goal_figure) for goal_figure in figures]
    for goal in goals:
        goal["accepted_s"] = _accepted_s(goal["t_s"], record.orders)
    summary: Summary = {
        "scenario": record.scenario,
        "with": record.extras,
        "seed": record.seed,
        "seconds": record.seconds,
        "ending": record.ending,
        "command": list(record.command),
        "begun": record.begun,
        "compass": record.compass,
        "servo": record.servo,
        "settings": record.settings,
        "goals": goals,
        "rudder_travel_deg_per_h": steady_rudder_travel_deg_per_h(figures),
        "rudder_travel_whole_deg_per_h": travel.deg_per_h() if end_s else None,
        **({} if record.supply is None else {"supply": record.supply}),
        **({} if record.vessels is None else {"vessels": record.vessels}),
        **_onboard_summary(record, log),
        "arrivals": [{"time_s": t_s, "item": item} for t_s, item in record.arrivals],
        "loop": _loop(record, log),
        "lockstep": record.lockstep,
        "sailed_s": end_s,
        "speed_ratio": end_s / record.wall_s if end_s and record.wall_s else None,
        "versions": record.versions,
        **({} if (own_versions := run_file.versions()) == record.versions else {"figures_by": own_versions}),
    }
    result: Summary = _round(summary)
    return result


def read_onboard_logs(out: Path) -> FieldLog | None:
    """Return the content of the logs of a run, with fewer ticks for long logs; None without readable logs."""
    logs = out / STATE / "logs"
    paths = [path for _, path in sorted(log_files(logs).items())] if logs.is_dir() else []
    every = math.ceil(sum(path.stat().st_size for path in paths) / MAX_FULL_BYTES)
    try:
        return field_log.read(paths, every=max(1, every)) if paths else None
    except UsageError:
        return None


def onboard_shift_s(record: RunFile, log: FieldLog) -> float:
    """Return truth time minus log time; in real time it follows from the UTC of the receiver, to 0.3 s."""
    if record.lockstep or log.utc_s is None:
        return log.start_s
    return log.utc_s - record.start_utc_s


def write(summary: Summary, out: Path) -> None:
    """Write summary.json; raise HilError if that fails."""
    try:
        (out / SUMMARY).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise HilError(f"{out / SUMMARY} cannot be written: {error.strerror}") from None


def _loop(record: RunFile, log: FieldLog | None) -> Summary | None:
    if log is None:
        return None
    note = "in lockstep the simulated time stands still while the autopilot computes" if record.lockstep else ""
    late_us = None if record.lockstep else dict(log.late_us) or None
    return {"ticks": log.ticks, "skipped": log.skipped, "lateness_us": late_us, "note": note}


def _accepted_s(goal_s: float, orders: Sequence[OrderRecord]) -> float | None:
    for order in orders:
        if order.goal_s is not None and order.accepted_s is not None and abs(order.goal_s - goal_s) <= 0.1:
            return order.accepted_s
    return None


def _onboard_summary(record: RunFile, log: FieldLog | None) -> Summary:
    """Return the texts of the autopilot and the cross-track error."""
    if log is None:
        return {"events": [], "cross_track": None}
    shift_s = onboard_shift_s(record, log)
    distance_m = np.abs(log.columns["cross_track_m"])
    distance_m = distance_m[np.isfinite(distance_m)]
    return {
        "events": [{"time_s": t_s + shift_s, "severity": severity, "text": text} for t_s, severity, text in log.texts],
        "cross_track": {
            "rms_m": float(np.sqrt(np.mean(np.square(distance_m)))),
            "p95_m": float(np.percentile(distance_m, 95.0)),
        }
        if distance_m.size
        else None,
    }


def _round(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, dict):
        return {key: _round(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_round(item) for item in value]
    return value
