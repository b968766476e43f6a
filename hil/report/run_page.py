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
from hil.report.figures import goal_figures, turned_goals_rad
from hil.report.summary import Summary
from hil.report.text import COLUMNS, goal_cells, loop_line
from hil.report.thinning import thinned
from hil.report.voyages import run_voyage
from hil.sim import run_file
from hil.sim.run_directory import PAGE, PICTURE, STATE, TRUTH_FILE
from hil.sim.run_file import FINISHED, RunFile
from hil.sim.truth import Recorded, Truth

TEXTS_SHOWN = 500
NOTE = (
    "Errors are heading less goal, of the hull's heading without the yaw of the waves. The steady part, which the "
    "errors and the rudder travel are of, begins 200 s after a goal, or with the last third of a shorter one. "
    "Overshoot is before that, in the direction of the step; settled is when she was outside 3 deg for the last time."
)


def make(out: Path) -> tuple[Summary, Path]:
    """Write summary.json, report.html and run.png of a run, over or cut short; return figures and the page's path.

    The picture is left out where matplotlib is not installed. UsageError for a directory of no run.
    """
    record = run_file.read(out)
    log = summary.onboard(out)
    figures = summary.summarise(record, out, log)
    summary.write(figures, out)
    truth = Recorded(out / TRUTH_FILE)
    rows = sum(piece.time_s.size for piece in truth)
    few = thinned(truth, rows) if rows else None
    if few is not None:
        few = replace(few, goal_rad=turned_goals_rad(few))
    if few is not None and importlib.util.find_spec("matplotlib") is not None:
        from hil.report.run_picture import draw  # noqa: PLC0415 - slow to import, and a float has it not

        draw(few, goal_figures(truth), record.title, out / PICTURE)
    try:
        (out / PAGE).write_text(_page(record, figures, few, log, out), encoding="utf-8")
    except OSError as error:
        raise HilError(f"{out / PAGE} cannot be written: {error.strerror}") from None
    return figures, out / PAGE


def _page(record: RunFile, figures: Summary, truth: Truth | None, log: FieldLog | None, out: Path) -> str:
    shift_s = 0.0 if log is None else summary.onboard_shift_s(record, log)
    lead = f"compass {record.compass}, servo {record.servo}, seed {record.seed}, {record.seconds:g} s"
    return page.page(
        record.title,
        [
            page.paragraph(lead, "lead"),
            *([] if record.ending == FINISHED else [page.paragraph(f"Cut short: {record.ending}.", "bad")]),
            *([] if truth is None else page.voyage(run_voyage(truth, log, shift_s))),
            page.heading("Figures"),
            *([page.table([COLUMNS, *map(goal_cells, figures["goals"])])] if figures["goals"] else []),
            *_mission(figures),
            page.paragraph(f"{loop_line(figures)}."),
            page.paragraph(NOTE, "note"),
            page.heading("What she said"),
            *_said(figures),
            page.heading("The sea"),
            page.table(record.sea, head=False),
            page.heading("The orders"),
            page.table([("order", "given", "accepted"), *_orders(record)]),
            page.heading("The run"),
            page.table(_origin(record, figures, out), head=False),
            page.heading("Settings"),
            _settings(record),
        ],
        PLOTS,
    )


def _mission(figures: Summary) -> Iterator[str]:
    if (line := figures["cross_track"]) is not None:
        yield page.paragraph(
            f"On her lines she was {line['rms_m']:.1f} m off (rms), within {line['p95_m']:.1f} m for 95 % of the time, "
            "by her own receiver."
        )
    if figures["arrivals"]:
        done = ", ".join(f"{one['item']} at {one['time_s']:.0f} s" for one in figures["arrivals"][:TEXTS_SHOWN])
        yield page.paragraph(f"Items of the mission done: {done}.")


def _said(figures: Summary) -> Iterator[str]:
    events = figures["events"]
    if not events:
        yield page.paragraph("There is no onboard log that tells.")
        return
    if len(events) > TEXTS_SHOWN:
        yield page.paragraph(f"The last {TEXTS_SHOWN} of {len(events)}; summary.json has them all.", "note")
    shown = [(one["time_s"], one["severity"], one["text"]) for one in events[-TEXTS_SHOWN:]]
    yield page.said(shown, lambda t_s: f"{t_s:.1f} s")


def _origin(record: RunFile, figures: Summary, out: Path) -> Iterator[tuple[str, page.Cell]]:
    logs = log_files(out / STATE / "logs") if (out / STATE / "logs").is_dir() else {}
    yield "command", page.Cell(shlex.join(record.command))
    yield "begun", page.Cell(record.begun)
    yield "ended", page.Cell(record.ending)
    yield "made with", page.Cell(", ".join(f"{name} {text}" for name, text in record.versions.items()))
    if own := figures.get("figures_by"):
        yield "figures by", page.Cell(", ".join(f"{name} {text}" for name, text in own.items()))
    for _, path in sorted(logs.items()):
        yield "log", page.Cell(str(path), note=f"rambler replay {shlex.quote(str(path))}")
    yield "this page", page.Cell(str(out / PAGE), note=f"rambler-hil report {shlex.quote(str(out))}")


def _settings(record: RunFile) -> str:
    rows = [(name, f"{value:g}") for name, value in record.settings.items()]
    return page.table(rows, head=False) if rows else page.paragraph("Every parameter at its default.")


def _orders(record: RunFile) -> list[tuple[str, str, str]]:
    return [(order.text, _seconds(order.given_s), _seconds(order.accepted_s)) for order in record.orders]


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f} s"
