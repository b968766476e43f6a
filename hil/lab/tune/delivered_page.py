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
    summary = f"{report.tuned.evaluations} settings in {len(report.trials.cases)} trial runs each, seed {report.seed}"
    return page.page(
        f"Tuning of {report.vehicle}",
        [
            page.paragraph(summary, "lead"),
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
    settings_axes, headings_axes, rudders_axes = figure.subplots(1, 3)
    _draw_settings(settings_axes, report)
    delivered = _simulate(report, default_setting())
    runs = [("defaults", GOAL, delivered)]
    if not report.tuned.keeps_defaults:
        runs.append(("chosen", HULL, _simulate(report, report.tuned.chosen.setting)))
    goal_deg = delivered[0].goal_rad * DEGREES_PER_RADIAN
    headings_axes.plot(delivered[0].time_s, goal_deg, color=INK, lw=1.0, ls="--", label="goal")
    for name, colour, (truth, travel) in runs:
        headings_axes.plot(truth.time_s, truth.heading_rad * DEGREES_PER_RADIAN, color=colour, lw=1.2, label=name)
        rudder_deg, label = truth.rudder_rad * DEGREES_PER_RADIAN, f"{name}: {travel:.0f} deg/h"
        rudders_axes.plot(truth.time_s, rudder_deg, color=colour, lw=0.8, label=label)
    case = report.fresh_trials.cases[0].text
    name_panel(headings_axes, f"hull's heading, {case}", x="time, s", y="deg")
    name_panel(rudders_axes, f"rudder, {case}", x="time, s", y="deg")
    add_legend(headings_axes)
    add_headroom(rudders_axes)
    add_legend(rudders_axes)
    for axes in (settings_axes, headings_axes, rudders_axes):
        finish(axes)
    figure.savefig(path)


def _draw_settings(axes: Any, report: Report) -> None:
    trials = report.trials
    scores = [score for score in trials.archive if score.error < 4.0]
    axes.plot([trials.travel(score) for score in scores], [score.error for score in scores], ".", color=COMPASS, ms=4)
    axes.plot(1.0, 1.0, "o", color=GOAL, ms=8, mec="white", label="defaults")
    chosen = report.tuned.chosen
    axes.plot(trials.travel(chosen), chosen.error, "*", color=COMMAND, ms=14, mec=INK, mew=0.6, label="chosen")
    name_panel(axes, "all settings, all cases", x="rudder travel, defaults = 1", y="error, defaults = 1")
    axes.legend(loc="upper right", fontsize=8, edgecolor="none", framealpha=0.9)


def _simulate(report: Report, setting: Setting) -> tuple[Truth, float]:
    """Simulate the first case of the fresh seas; return the run and its rudder travel [deg/h]."""
    record = report.fresh_trials.record(setting, report.fresh_trials.seas[0])
    travel = float(report.fresh_trials.results(setting)[0, TRAVEL]) * DEG_PER_H
    return sailing.truth_of(record, report.fresh_trials.goals), travel
