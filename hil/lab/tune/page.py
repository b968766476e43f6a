"""The page of a tuning: self-contained HTML with the picture in it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from hil.lab.tune import pictures
from hil.lab.tune.report import Report, case_rows, choice_lines, parameter_file, study_line
from hil.report.page import STYLE

NOTE = (
    "Error is ITAE, the absolute heading error weighted by the time since the goal was given, in each case by that "
    "of the paper's gains, root mean square over the cases. Rudder travel is of the steady last third after each "
    "goal, mean over the cases. Each sea is sailed by the model and by ships with K and T 30 % off, and flat water "
    "at 0.2 and 1.2 m/s; the autopilot keeps the vehicle file's model. The table is of seas that "
    "the search has not seen; its mean is that of the goal where it is larger."
)


def write(report: Report, path: Path) -> tuple[Path, Path]:
    """Write the picture and the page beside each other; return the paths of both."""
    picture, page = path.with_suffix(".png"), path.with_suffix(".html")
    pictures.draw(report, picture)
    page.write_text(_page(report, picture.read_bytes()), encoding="utf-8")
    return picture, page


def _page(report: Report, picture: bytes) -> str:
    image = base64.b64encode(picture).decode("ascii")
    title = escape(f"Tuning of {report.vehicle}")
    lines = [*map(study_line, report.studies), *choice_lines(report)]
    parts = [
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        f"<style>{STYLE}</style></head><body><h1>{title}</h1>",
        (
            f'<p class="lead">{report.tuned.evaluations} settings in {len(report.trials.cases)} trial runs each, '
            f"seed {report.seed}</p>"
        ),
        f'<img alt="ITAE planes, front, headings and rudders" src="data:image/png;base64,{image}">',
        "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>",
        "<h2>The paper's gains (left) and the chosen setting (right)</h2>",
        _table(case_rows(report)),
        f'<p class="note">{escape(NOTE)}</p>',
        f"<h2>Parameters</h2><pre>{escape(parameter_file(report))}</pre>",
        "<h2>The front</h2>",
        _table(_front_rows(report)),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _front_rows(report: Report) -> list[Sequence[str]]:
    rows: list[Sequence[str]] = [("travel deg/h", "error", "worst", "k1", "k2", "tau s", "deadband deg")]
    for score in report.tuned.front:
        setting = score.setting
        rows.append(
            (
                f"{score.travel_deg_per_h:.0f}",
                f"{score.error:.3f}",
                f"{score.worst_error:.2f}",
                f"{setting.k1:.1f}",
                f"{setting.k2:.2f}",
                f"{setting.tau_s:.1f}",
                f"{setting.deadband_deg:.2f}",
            )
        )
    return rows


def _table(rows: Iterable[Sequence[str]]) -> str:
    lines = []
    for number, row in enumerate(rows):
        tag = "th" if number == 0 else "td"
        lines.append("<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"
