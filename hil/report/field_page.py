"""report.html of the logs of a boat, in the form of the page of a run."""

from __future__ import annotations

import datetime as dt
import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from firmware_py.log.disk import THIN, log_files
from firmware_py.view.document import PLOTS
from hil.errors import UsageError
from hil.report import field_log, page, thin_log
from hil.report.field_log import FieldLog
from hil.report.figures import goal_figures
from hil.report.run_page import NOTE
from hil.report.text import COLUMNS, goal_cells
from hil.report.voyages import days_voyage, field_voyage
from hil.sim.ground_station import MODE_NAMES
from hil.sim.truth import ROWS_PER_PIECE, Truth

LOG_DIRECTORY = "logs"
MAX_LOGS = 3  # full logs of a state directory on the page, with all of its thin log
MAX_TEXTS, MAX_GOALS, MAX_MODE_PERIODS = 200, 40, 60
FIELD_NOTE = (
    "The heading is the boat's own estimate, without wave yaw; an error of the compass is contained in it. A goal "
    "counts if it lasted a minute. The compass line is shifted by its mean difference from the heading."
)


def find_logs(paths: Sequence[Path]) -> tuple[list[Path], list[Path], list[str]]:
    """Return the full and the thin logs of files and directories in order, and notes on logs that are not included.

    Raises UsageError for a path that does not exist or a directory without logs.
    """
    full: list[Path] = []
    thin: list[Path] = []
    notes = []
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path} does not exist; name logs, a state directory or that of a run")
        if not path.is_dir():
            (thin if path.parent.name == THIN else full).append(path)
            continue
        directories = (path / "state" / LOG_DIRECTORY, path / LOG_DIRECTORY, path)
        logs = next(
            (directory for directory in directories if _numbered_logs(directory) or _numbered_logs(directory / THIN)),
            None,
        )
        if logs is None:
            raise UsageError(f"{path} holds no logs; name logs, a state directory or that of a run")
        numbered = _numbered_logs(logs)
        full += numbered[-MAX_LOGS:]
        if len(numbered) > MAX_LOGS:
            notes.append(f"the latest {MAX_LOGS} of {len(numbered)} full logs; name other logs to include them")
        thin += _numbered_logs(logs / THIN)
    return full, thin, notes


def _numbered_logs(directory: Path) -> list[Path]:
    return [path for _, path in sorted(log_files(directory).items())] if directory.is_dir() else []


def write(paths: Sequence[Path], target: Path) -> None:
    """Write the page of logs or directories of them; UsageError if there are none or they cannot be read."""
    full, thin, notes = find_logs(paths)
    parts: list[str] = []
    title = ", ".join(str(path) for path in paths)
    if full:
        try:
            parts += _full_log_parts(field_log.read(full), full, notes)
        except UsageError as error:
            if not thin:
                raise
            parts.append(page.paragraph(f"The full logs are not included: {error}", "note"))
    if thin:
        parts += _day_parts(thin_log.read(thin))
    if not parts:
        raise UsageError(f"{title}: no records to show; give logs of the autopilot")
    try:
        target.write_text(page.page(title, parts, PLOTS), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--out {target} cannot be written: {error.strerror}; give another") from None


def _day_parts(table: thin_log.ThinTable) -> Iterator[str]:
    if table.rows:
        yield page.heading("Day by day")
        yield from page.voyage(days_voyage(table))
        yield page.table(thin_log.day_rows(table))
    if table.undated_s > 0.0:
        hours = table.undated_s / 3600.0
        yield page.paragraph(f"{hours:.1f} h of the thin log have no date, because no clock was valid then.", "note")


def _full_log_parts(log: FieldLog, paths: Sequence[Path], notes: Sequence[str]) -> Iterator[str]:
    truth = log.truth
    goals = goal_figures(_pieces(replace(truth, goal_rad=log.lasting_goal_rad)))
    begin = "" if log.segments[0].utc_s is None else f"{_clock(float(truth.time_s[0]), log)} UTC, "
    apart_s = sum(segment.gap_s for segment in log.segments if segment.gap_s > 0.0)
    hours = (float(truth.time_s[-1] - truth.time_s[0]) - apart_s) / 3600.0
    yield page.paragraph(f"{begin}{hours:.2f} h logged; {log.software or 'software unknown'}", "lead")
    yield from page.voyage(field_voyage(log))
    yield page.heading("Figures")
    if goals:
        yield page.table([COLUMNS, *(goal_cells(asdict(goal), _clock(goal.t_s, log)) for goal in goals[:MAX_GOALS])])
    yield page.table(
        [
            ("mode", "duration", "mean error", "rms error", "rudder travel"),
            *(_period_cells(period, log) for period in log.mode_periods[:MAX_MODE_PERIODS]),
        ]
    )
    late = ", ".join(f"{name} {value:.0f} us" for name, value in log.late_us.items())
    yield page.paragraph(
        f"loop: {log.ticks} ticks, {log.skipped} skipped; lateness of ticks {late}; "
        f"servo energy {log.steering_wh:.2f} Wh."
    )
    omitted = [f"{len(rest)} more {name} are not included" for name, rest in _omitted(log, len(goals)) if rest]
    yield page.paragraph(f"{NOTE} {FIELD_NOTE}", "note")
    if lines := [*notes, *log.notes, *omitted]:
        yield page.bullets(lines)
    yield page.heading("Texts of the autopilot")
    yield page.events(log.texts[-MAX_TEXTS:], lambda t_s: _clock(t_s, log))
    yield page.heading("Logs")
    yield page.table([(str(path), page.Cell(f"rambler replay {shlex.quote(str(path))}")) for path in paths], head=False)
    yield page.heading("Settings")
    rows = [(name, f"{value:g}") for name, value in sorted(log.settings.items())]
    yield page.table(rows, head=False) if rows else page.paragraph("All parameters have their defaults.")


def _omitted(log: FieldLog, goals: int) -> tuple[tuple[str, range], ...]:
    return (
        ("goals", range(MAX_GOALS, goals)),
        ("periods of one mode", range(MAX_MODE_PERIODS, len(log.mode_periods))),
        ("older texts", range(MAX_TEXTS, len(log.texts))),
    )


def _pieces(truth: Truth) -> list[Truth]:
    """Split a truth into pieces, as for a run."""
    names = truth.__dataclass_fields__
    return [
        Truth(*(getattr(truth, name)[first : first + ROWS_PER_PIECE] for name in names))
        for first in range(0, truth.time_s.size, ROWS_PER_PIECE)
    ]


def _period_cells(period: field_log.ModePeriod, log: FieldLog) -> tuple[str, ...]:
    armed = "armed" if period.armed else "disarmed"
    has_error = math.isfinite(period.rms_error_deg)
    return (
        f"{MODE_NAMES.get(period.mode, f'mode {period.mode}')}, {armed}, from {_clock(period.t_s, log)}",
        f"{period.seconds:.0f} s",
        f"{period.mean_error_deg:+.2f} deg" if has_error else "-",
        f"{period.rms_error_deg:.2f} deg" if has_error else "-",
        f"{period.travel_deg_per_h:.0f} deg/h",
    )


def _clock(t_s: float, log: FieldLog) -> str:
    """Return a time of the page as UTC by its log; without a date, the time since the first tick of that log."""
    started = [segment for segment in log.segments if segment.begin_s <= t_s]
    segment = started[-1] if started else log.segments[0]
    if segment.utc_s is not None:
        return _calendar(segment.utc_s + t_s)
    return f"{segment.name + ' ' if len(log.segments) > 1 else ''}{t_s - segment.begin_s:.1f} s"


def _calendar(utc_s: float) -> str:
    try:
        return dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, OSError, ValueError):
        return f"{utc_s:.0f} s"
