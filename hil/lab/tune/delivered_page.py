"""Plot and page of a tuning of the default controller: all settings, and runs with the defaults and the choice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.tune.delivered import DEG_PER_H, Setting, default_setting
from hil.lab.tune.delivered_report import Report, case_rows, choice_lines, parameter_file
from hil.lab.tune.loop_kernel import TRAVEL
from hil.lab.twin import sailing
from hil.report import page
from hil.report.style import (
    COMMAND,
    COMPASS,
    GOAL,
    HULL,
    INK,
    add_headroom,
    add_legend,
    finish,
    name_panel,
    new_figure,
)  # fmt: skip
from hil.sim.truth import Truth

SIZE_INCHES = (13.0, 4.6)
NOTE = (
    "The error is ITAE, the absolute heading error weighted by the time since the goal, relative to the defaults; root "
    "mean square over the cases. The rudder travel is that of the last third after each goal, mean over the cases. The "
    "autopilot uses the model of the vehicle file. The table shows seas that were not used in the search, with the "
    "larger mean error of the two goals."
)


def write(report: Report, path: Path) -> tuple[Path, Path]:
    """Write the plot and the page; return the paths of both."""
    png, html = path.with_suffix(".png"), path.with_suffix(".html")
    _draw(report, png)
    html.write_text(_page(report, png.read_bytes()), encoding="utf-8")
    return png, html


def _page(report: Report, png: bytes) -> str:
    lead = f"{report.tuned.evaluations} settings in {len(report.trials.cases)} trial runs each, seed {report.seed}"
    return page.page(
        f"Tuning of {report.vehicle}",
        [
            page.paragraph(lead, "lead"),
            page.image(png, "settings, headings and rudders"),
            page.bullets(choice_lines(report)),
            page.heading("Defaults (left) and the chosen setting (right)"),
            page.table(case_rows(report)),
            page.paragraph(NOTE, "note"),
            page.heading("Parameters"),
            page.verbatim(parameter_file(report)),
        ],
    )


def _draw(report: Report, path: Path) -> None:
    figure = new_figure(f"Tuning of {report.vehicle}", *SIZE_INCHES)
    tried, headings, rudders = figure.subplots(1, 3)
    _tried(tried, report)
    delivered = _run(report, default_setting())
    runs = [("defaults", GOAL, delivered)]
    if not report.tuned.kept:
        runs.append(("chosen", HULL, _run(report, report.tuned.chosen.setting)))
    goal_deg = delivered[0].goal_rad * DEGREES_PER_RADIAN
    headings.plot(delivered[0].time_s, goal_deg, color=INK, lw=1.0, ls="--", label="goal")
    for name, colour, (truth, travel) in runs:
        headings.plot(truth.time_s, truth.heading_rad * DEGREES_PER_RADIAN, color=colour, lw=1.2, label=name)
        rudder_deg, label = truth.rudder_rad * DEGREES_PER_RADIAN, f"{name}: {travel:.0f} deg/h"
        rudders.plot(truth.time_s, rudder_deg, color=colour, lw=0.8, label=label)
    case = report.fresh.cases[0].text
    name_panel(headings, f"hull's heading, {case}", x="time, s", y="deg")
    name_panel(rudders, f"rudder, {case}", x="time, s", y="deg")
    add_legend(headings)
    add_headroom(rudders)
    add_legend(rudders)
    for axes in (tried, headings, rudders):
        finish(axes)
    figure.savefig(path)


def _tried(axes: Any, report: Report) -> None:
    trials = report.trials
    scores = [score for score in trials.archive if score.error < 4.0]
    axes.plot([trials.travel(score) for score in scores], [score.error for score in scores], ".", color=COMPASS, ms=4)
    axes.plot(1.0, 1.0, "o", color=GOAL, ms=8, mec="white", label="defaults")
    chosen = report.tuned.chosen
    axes.plot(trials.travel(chosen), chosen.error, "*", color=COMMAND, ms=14, mec=INK, mew=0.6, label="chosen")
    name_panel(axes, "all settings, all cases", x="rudder travel, defaults = 1", y="error, defaults = 1")
    axes.legend(loc="upper right", fontsize=8, edgecolor="none", framealpha=0.9)


def _run(report: Report, setting: Setting) -> tuple[Truth, float]:
    """Return a run of the first case in fresh seas, and its rudder travel."""
    record = report.fresh.record(setting, report.fresh.seas[0])
    travel = float(report.fresh.results(setting)[0, TRAVEL]) * DEG_PER_H
    return sailing.truth_of(record, report.fresh.goals), travel
