"""report.html: one self-contained page with the picture, the figures and the settings of a run."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from hil.report import page, summary
from hil.report.figures import goal_figures
from hil.report.summary import Summary
from hil.report.text import COLUMNS, goal_cells, loop_line
from hil.sim import run_file
from hil.sim.run_directory import PAGE, PICTURE, TRUTH_FILE
from hil.sim.run_file import FINISHED, RunFile
from hil.sim.truth import Recorded

NOTE = (
    "Errors are heading less goal, of the hull's heading without the yaw of the waves. The steady part, which the "
    "errors and the rudder travel are of, begins 200 s after a goal, or with the last third of a shorter one. "
    "Overshoot is before that, in the direction of the step; settled is when she was outside 3 deg for the last time."
)
NOTHING_DRAWS = "none, matplotlib is not installed; pip install 'rambler-autopilot[hil]'"


def make(out: Path) -> tuple[Summary, str]:
    """Write summary.json and report.html of a run, over or cut short, into its directory; return figures and path.

    UsageError for a directory of no run.
    """
    record = run_file.read(out)
    figures = summary.summarise(record, out)
    summary.write(figures, out)
    # A float that tries the box has nothing that draws.
    drawn = importlib.util.find_spec("matplotlib") is not None
    return figures, str(write(record, figures, out)) if drawn else NOTHING_DRAWS


def write(record: RunFile, figures: Summary, out: Path) -> Path:
    """Write run.png and report.html; return the path of the page."""
    from hil.report.run_picture import draw, thinned  # noqa: PLC0415 - matplotlib is slow to import, not needed under way

    truth = Recorded(out / TRUTH_FILE)
    parts = []
    if rows := sum(piece.time_s.size for piece in truth):
        picture = out / PICTURE
        draw(thinned(truth, rows), goal_figures(truth), record.title, picture)
        parts.append(page.image(picture.read_bytes(), "heading, error, yaw rate, rudder and track"))
    (out / PAGE).write_text(_page(record, figures, parts), encoding="utf-8")
    return out / PAGE


def _page(record: RunFile, figures: Summary, parts: list[str]) -> str:
    lead = f"compass {record.compass}, servo {record.servo}, seed {record.seed}, {record.seconds:g} s"
    if record.ending != FINISHED:
        parts = [page.paragraph(f"Cut short: {record.ending}.", "bad"), *parts]
    return page.page(
        record.title,
        [
            page.paragraph(lead, "lead"),
            *parts,
            page.heading("Figures"),
            page.table([COLUMNS, *(goal_cells(goal) for goal in figures["goals"])]),
            page.paragraph(f"{loop_line(figures)}."),
            page.paragraph(NOTE, "note"),
            page.heading("The sea"),
            page.table(record.sea, head=False),
            page.heading("The orders"),
            page.table([("order", "given", "accepted"), *_orders(record)]),
            page.heading("Settings"),
            _settings(record),
            page.paragraph(", ".join(f"{name} {text}" for name, text in record.versions.items()), "note"),
        ],
    )


def _settings(record: RunFile) -> str:
    rows = [(name, f"{value:g}") for name, value in record.settings.items()]
    return page.table(rows, head=False) if rows else page.paragraph("Every parameter at its default.")


def _orders(record: RunFile) -> list[tuple[str, str, str]]:
    return [(order.text, _seconds(order.given_s), _seconds(order.accepted_s)) for order in record.orders]


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f} s"
