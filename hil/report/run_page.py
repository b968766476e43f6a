"""report.html: one self-contained page with the picture, the figures and the settings of a run."""

from __future__ import annotations

from pathlib import Path

from hil.report import page
from hil.report.figures import goal_figures
from hil.report.summary import Summary
from hil.report.text import COLUMNS, goal_cells, loop_line
from hil.ship import extras_table
from hil.ship.scenarios import Scenario
from hil.sim.runner import Run

NOTE = (
    "Errors are heading less goal, of the hull's heading without the yaw of the waves. The steady part, which the "
    "errors and the rudder travel are of, begins 200 s after a goal, or with the last third of a shorter one. "
    "Overshoot is before that, in the direction of the step; settled is when she was outside 3 deg for the last time."
)


def write(run: Run, summary: Summary, directory: Path) -> Path:
    """Write run.png and report.html; return the path of the page."""
    from hil.report.run_picture import draw, thinned  # noqa: PLC0415 - matplotlib is slow to import, not needed under way

    options = run.options
    names = extras_table.names_of(options.scenario.extras)
    title = f"{options.scenario.name}: {options.scenario.text}" + (f"; {', '.join(names)}" if names else "")
    picture = directory / "run.png"
    draw(thinned(run.truth, run.truth.rows), goal_figures(run.truth), title, picture)
    path = directory / "report.html"
    path.write_text(_page(run, summary, title, picture.read_bytes()), encoding="utf-8")
    return path


def _page(run: Run, summary: Summary, title: str, picture: bytes) -> str:
    lead = f"compass {summary['compass']}, servo {summary['servo']}, seed {summary['seed']}, {summary['seconds']:g} s"
    versions = ", ".join(f"{name} {text}" for name, text in summary["versions"].items())
    return page.page(
        title,
        [
            page.paragraph(lead, "lead"),
            page.image(picture, "heading, error, yaw rate, rudder and track"),
            page.heading("Figures"),
            page.table([COLUMNS, *(goal_cells(goal) for goal in summary["goals"])]),
            page.paragraph(f"{loop_line(summary)}."),
            page.paragraph(NOTE, "note"),
            page.heading("The sea"),
            page.table(_sea(run), head=False),
            page.heading("The orders"),
            page.table([("order", "given", "accepted"), *_orders(run)]),
            page.heading("Settings"),
            _settings(summary),
            page.paragraph(versions, "note"),
        ],
    )


def _settings(summary: Summary) -> str:
    rows = [(name, f"{value:g}") for name, value in summary["settings"].items()]
    return page.table(rows, head=False) if rows else page.paragraph("Every parameter at its default.")


def _sea(run: Run) -> list[tuple[str, str]]:
    sea = run.options.scenario
    return [
        ("speed through the water", f"{sea.speed_m_s:g} m/s"),
        ("wave period", f"{sea.wave_period_s:g} s" if sea.wave_period_s else "no waves"),
        ("wave yaw, standard deviation", f"{sea.wave_yaw_deg:g} deg"),
        ("rudder angle at which she runs straight", f"{sea.bias_deg:g} deg, wandering by {sea.drift_deg:g} deg"),
        ("current", _current(sea)),
        *extras_table.rows_of(sea.extras),
    ]


def _current(sea: Scenario) -> str:
    if not sea.current_m_s:
        return "none"
    steady = f"{sea.current_m_s:g} m/s toward {sea.current_toward_deg:g} deg"
    return f"{steady}, turning with a tide of {sea.tide_s / 3600.0:g} h" if sea.tide_s else steady


def _orders(run: Run) -> list[tuple[str, str, str]]:
    return [(order.text, _seconds(order.first_sent_s), _seconds(order.accepted_s)) for order in run.orders]


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f} s"
