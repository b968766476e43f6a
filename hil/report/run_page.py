"""report.html: one self-contained page with the plots, the figures and the settings of a run."""

from __future__ import annotations

import importlib.util
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from firmware_py.log.disk import log_files
from firmware_py.view.document import PLOTS
from hil.errors import HilError
from hil.report import page, summary
from hil.report.field_log import FieldLog
from hil.report.figures import goal_figures, unwrapped_goals_rad
from hil.report.summary import Summary
from hil.report.text import COLUMNS, goal_cells, loop_line
from hil.report.thinning import thin_truth
from hil.report.voyages import run_voyage
from hil.sim import run_file
from hil.sim.run_directory import PAGE, PICTURE, STATE, TRUTH_FILE
from hil.sim.run_file import FINISHED, UNDER_WAY, RunFile
from hil.sim.truth import RecordedTruth, Truth

MAX_TEXTS = 500
NOTE = (
    "Error: heading minus goal, with the heading of the hull without wave yaw. Errors and rudder travel are those of "
    "the steady part, which begins 200 s after a goal, or with the last third of a shorter one. Overshoot is counted "
    "before it, in the direction of the step. Settled: last time with an error larger than 3 deg."
)
INTERRUPTED = "interrupted"


def make(out: Path) -> tuple[Summary, Path]:
    """Write summary.json, report.html and run.png of a complete or partial run; return figures and path of the page.

    run.png is omitted if matplotlib is not installed. Raises UsageError for a directory without a run, and HilError
    for a file that cannot be written.
    """
    record = run_file.read(out)
    log = summary.read_onboard_logs(out)
    figures = summary.summarise(record, out, log)
    summary.write(figures, out)
    truth = RecordedTruth(out / TRUTH_FILE)
    rows = sum(piece.time_s.size for piece in truth)
    thinned_truth = thin_truth(truth, rows) if rows else None
    if thinned_truth is not None:
        thinned_truth = replace(thinned_truth, goal_rad=unwrapped_goals_rad(thinned_truth))
    if thinned_truth is not None and importlib.util.find_spec("matplotlib") is not None:
        from hil.report.run_picture import draw  # noqa: PLC0415 - slow to import and optional

        draw(thinned_truth, goal_figures(truth), record.title, out / PICTURE)
    try:
        (out / PAGE).write_text(_page_text(record, figures, thinned_truth, log, out), encoding="utf-8")
    except OSError as error:
        raise HilError(f"{out / PAGE} cannot be written: {error.strerror}") from None
    return figures, out / PAGE


def _page_text(record: RunFile, figures: Summary, truth: Truth | None, log: FieldLog | None, out: Path) -> str:
    shift_s = 0.0 if log is None else summary.onboard_shift_s(record, log)
    lead = f"compass {record.compass}, servo {record.servo}, seed {record.seed}, {record.seconds:g} s"
    return page.page(
        record.title,
        [
            page.paragraph(lead, "lead"),
            *_ending(record),
            *([] if truth is None else page.voyage(run_voyage(truth, log, shift_s))),
            page.heading("Figures"),
            *([page.table([COLUMNS, *map(goal_cells, figures["goals"])])] if figures["goals"] else []),
            *_mission(figures),
            page.paragraph(f"{loop_line(figures)}."),
            page.paragraph(NOTE, "note"),
            page.heading("Texts of the autopilot"),
            *_events(figures),
            page.heading("Scenario"),
            page.table(record.sea, head=False),
            page.heading("Commands of the operator"),
            page.table([("command", "sent", "accepted"), *_orders(record)]),
            page.heading("Origin of the run"),
            page.table(_origin(record, figures, out), head=False),
            page.heading("Settings"),
            _settings(record),
        ],
        PLOTS,
    )


def _ending(record: RunFile) -> Iterator[str]:
    """Yield the reason for an early end; an interruption by the operator is not a failure."""
    if record.ending != FINISHED:
        text = "no end recorded, the run is under way or was killed" if record.ending == UNDER_WAY else record.ending
        is_failure = not record.ending.startswith(INTERRUPTED)
        yield page.paragraph(f"Ended early: {text}.", "bad" if is_failure else "note")


def _mission(figures: Summary) -> Iterator[str]:
    if (line := figures["cross_track"]) is not None:
        yield page.paragraph(
            f"Cross-track error {line['rms_m']:.1f} m (rms), below {line['p95_m']:.1f} m for 95 % of the time, "
            "measured by the boat's GNSS receiver."
        )
    if figures["arrivals"]:
        reached_items = ", ".join(
            f"{item['item']} at {item['time_s']:.0f} s" for item in figures["arrivals"][:MAX_TEXTS]
        )
        yield page.paragraph(f"Mission items reached: {reached_items}.")


def _events(figures: Summary) -> Iterator[str]:
    events = figures["events"]
    if not events:
        yield page.paragraph("No onboard log with texts.")
        return
    if len(events) > MAX_TEXTS:
        yield page.paragraph(f"The last {MAX_TEXTS} of {len(events)}; summary.json has all.", "note")
    texts = [(item["time_s"], item["severity"], item["text"]) for item in events[-MAX_TEXTS:]]
    yield page.events(texts, lambda t_s: f"{t_s:.1f} s")


def _origin(record: RunFile, figures: Summary, out: Path) -> Iterator[tuple[str, page.Cell]]:
    logs = log_files(out / STATE / "logs") if (out / STATE / "logs").is_dir() else {}
    yield "command", page.Cell(shlex.join(record.command))
    yield "start", page.Cell(record.begun)
    yield "end", page.Cell(record.ending)
    yield "versions", page.Cell(", ".join(f"{name} {text}" for name, text in record.versions.items()))
    if own_versions := figures.get("figures_by"):
        yield "versions of the figures", page.Cell(", ".join(f"{name} {text}" for name, text in own_versions.items()))
    for _, path in sorted(logs.items()):
        yield "log", page.Cell(str(path), note=f"rambler replay {shlex.quote(str(path))}")
    yield "this page", page.Cell(str(out / PAGE), note=f"rambler-hil report {shlex.quote(str(out))}")


def _settings(record: RunFile) -> str:
    rows = [(name, f"{value:g}") for name, value in record.settings.items()]
    return page.table(rows, head=False) if rows else page.paragraph("All parameters have their defaults.")


def _orders(record: RunFile) -> list[tuple[str, str, str]]:
    return [(order.text, _seconds(order.given_s), _seconds(order.accepted_s)) for order in record.orders]


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f} s"
