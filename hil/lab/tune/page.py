"""The page of a tuning: self-contained HTML with the picture in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hil.lab.tune import picture
from hil.lab.tune.report import (
    Report,
    case_rows,
    choice_lines,
    parameter_file,
    study_line,
    switched_off_lines,
)
from hil.report import page

NOTE = (
    "Error is ITAE, the absolute heading error weighted by the time since the goal was given, in each case by that "
    "of the paper's gains, root mean square over the cases. Rudder travel is of the steady last third after each "
    "goal, mean over the cases. Each sea is sailed by the model and by ships with K and T 30 % off, and flat water "
    "at 0.2 and 1.2 m/s; the autopilot keeps the vehicle file's model. The table is of seas that "
    "the search has not seen; its mean is that of the goal where it is larger."
)


def write(report: Report, path: Path) -> tuple[Path, Path]:
    """Write the picture and the page beside each other; return the paths of both."""
    png, html = path.with_suffix(".png"), path.with_suffix(".html")
    picture.draw(report, png)
    html.write_text(_page(report, png.read_bytes()), encoding="utf-8")
    return png, html


def _page(report: Report, png: bytes) -> str:
    lines = [*map(study_line, report.studies), *choice_lines(report), *switched_off_lines(report)]
    settings, cases = report.tuned.evaluations, len(report.trials.cases)
    return page.page(
        f"Tuning of {report.vehicle}",
        [
            page.paragraph(f"{settings} settings in {cases} trial runs each, seed {report.seed}", "lead"),
            page.image(png, "ITAE planes, front, headings and rudders"),
            page.bullets(lines),
            page.heading("The paper's gains (left) and the chosen setting (right)"),
            page.table(case_rows(report)),
            page.paragraph(NOTE, "note"),
            page.heading("Parameters"),
            page.verbatim(parameter_file(report)),
            page.heading("The front"),
            page.table(_front_rows(report)),
        ],
    )


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
