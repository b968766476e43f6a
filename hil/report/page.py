"""report.html: one self-contained page with the picture, the figures and the settings of a run."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from hil.report.summary import Summary
from hil.report.text import COLUMNS, goal_cells, loop_line
from hil.ship.scenarios import Scenario
from hil.sim.runner import Run

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #333b44; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
p.lead { color: #66717d; margin-top: 0; } img { width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .9rem; border-bottom: 1px solid #dde3e8; }
th { color: #66717d; font-weight: 600; } td:first-child, th:first-child { text-align: left; padding-left: 0; }
.note { color: #66717d; font-size: .9rem; max-width: 60rem; }
"""
NOTE = (
    "Errors are heading less goal, of the hull's heading without the yaw of the waves. The steady part, which the "
    "errors and the rudder travel are of, begins 200 s after a goal, or with the last third of a shorter one. "
    "Overshoot is before that, in the direction of the step; settled is when she was outside 3 deg for the last time."
)


def write(run: Run, summary: Summary, directory: Path) -> Path:
    """Write run.png and report.html; return the path of the page."""
    from hil.report.picture import draw  # noqa: PLC0415 - matplotlib is slow to import, and not needed while she sails

    options = run.options
    title = f"{options.scenario.name}: {options.scenario.text}"
    picture = directory / "run.png"
    draw(run.truth.table(), title, picture)
    path = directory / "report.html"
    path.write_text(_page(run, summary, title, picture.read_bytes()), encoding="utf-8")
    return path


def _page(run: Run, summary: Summary, title: str, picture: bytes) -> str:
    image = base64.b64encode(picture).decode("ascii")
    lead = f"compass {summary['compass']}, servo {summary['servo']}, seed {summary['seed']}, {summary['seconds']:g} s"
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f"<title>Rambler run, {escape(title)}</title><style>{STYLE}</style></head><body>",
        f'<h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p>',
        f'<img alt="heading, error, yaw rate, rudder and track" src="data:image/png;base64,{image}">',
        "<h2>Figures</h2>",
        _table([COLUMNS, *(goal_cells(goal) for goal in summary["goals"])]),
        f'<p>{escape(loop_line(summary))}.</p><p class="note">{NOTE}</p>',
        "<h2>The sea</h2>",
        _table(_sea(run), head=False),
        "<h2>The orders</h2>",
        _table([("order", "given", "accepted"), *_orders(run)]),
        "<h2>Settings</h2>",
        _settings(summary),
        f'<p class="note">{escape(", ".join(f"{name} {text}" for name, text in summary["versions"].items()))}</p>',
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _settings(summary: Summary) -> str:
    rows = [(name, f"{value:g}") for name, value in summary["settings"].items()]
    return _table(rows, head=False) if rows else "<p>Every parameter at its default.</p>"


def _sea(run: Run) -> list[tuple[str, str]]:
    sea = run.options.scenario
    return [
        ("speed through the water", f"{sea.speed_m_s:g} m/s"),
        ("wave period", f"{sea.wave_period_s:g} s" if sea.wave_period_s else "no waves"),
        ("wave yaw, standard deviation", f"{sea.wave_yaw_deg:g} deg"),
        ("rudder angle at which she runs straight", f"{sea.bias_deg:g} deg, wandering by {sea.drift_deg:g} deg"),
        ("current", _current(sea)),
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


def _table(rows: Iterable[Sequence[str]], *, head: bool = True) -> str:
    lines = []
    for number, row in enumerate(rows):
        tag = "th" if head and number == 0 else "td"
        lines.append("<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"
