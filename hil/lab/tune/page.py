"""Plot and self-contained page of a tuning of fixed gains."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import FixedLocator, NullLocator

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.tune import paper
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.report import Report, Trace, case_rows, choice_lines, parameter_file, study_line, switched_off_lines
from hil.lab.tune.trials import Score
from hil.report import page
from hil.report.style import COMMAND, COMPASS, GOAL, HULL, INK, add_headroom, add_legend, finish, name_panel, new_figure

SIZE_INCHES = (13.0, 8.6)
EXCESS_PERCENT = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
THOUSAND = 1000.0
TRAVEL_TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
ERROR_TICKS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0, 4.0)


def draw(report: Report, path: Path) -> None:
    """Write the plot as a PNG file."""
    figure = new_figure(f"Tuning of {report.vehicle}", *SIZE_INCHES)
    top, bottom = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
    upper_axes = top.subplots(1, 1 + len(report.studies))
    for axes, study in zip(upper_axes, report.studies, strict=False):
        contours = _draw_map(axes, study)
    # One colour scale for all maps, because labels on the contours would overlap.
    colour_bar = top.colorbar(contours, ax=upper_axes[len(report.studies) - 1], format="+%g %%", pad=0.03, aspect=30)
    colour_bar.ax.tick_params(colors=INK, labelsize=7, length=0)
    colour_bar.outline.set_visible(False)
    _draw_front(upper_axes[-1], report)
    lower_axes = bottom.subplots(1, 2)
    _draw_headings(lower_axes[0], report)
    _draw_rudders(lower_axes[1], report)
    for axes in (*upper_axes, *lower_axes):
        finish(axes)
    figure.savefig(path)


def _draw_map(axes: Any, study: StepStudy) -> Any:
    """Draw the excess of J over k1 and k2 with the paper's gains and the optimum; return the contours."""
    excess = 100.0 * (study.itae_map / study.best_itae - 1.0)
    palette = colormaps["Blues_r"](np.linspace(0.25, 0.98, len(EXCESS_PERCENT) - 1))
    contours = axes.contourf(study.k1, study.k2, np.clip(excess, 0.0, 499.0), levels=EXCESS_PERCENT, colors=palette)
    axes.contour(study.k1, study.k2, excess, levels=EXCESS_PERCENT[1:-1], colors="white", linewidths=0.6)
    best = study.swarm.best
    axes.plot(paper.PAPER_K1, paper.PAPER_K2, "o", color=GOAL, ms=8, mec="white", clip_on=False, zorder=5)
    axes.plot(best[0], best[1], "D", color=COMMAND, ms=7, mec="white", clip_on=False, zorder=5)
    box = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": "none", "alpha": 0.85}
    axes.annotate(
        f"the paper's 40, 0.3: +{100.0 * study.excess:.1f} %",
        (paper.PAPER_K1, paper.PAPER_K2), (paper.PAPER_K1 - 4.0, 4.6), ha="center", fontsize=8, color=GOAL, bbox=box,
        arrowprops={"arrowstyle": "-", "color": GOAL},
    )  # fmt: skip
    axes.annotate(
        f"optimum: {best[0]:.0f}, {best[1]:.2f}",
        (best[0], best[1]), (best[0] - 3.0, 2.9), ha="right", fontsize=8, color=INK, bbox=box,
        arrowprops={"arrowstyle": "-", "color": INK},
    )  # fmt: skip
    name_panel(axes, f"ITAE of a {study.step_deg:g}° step, above the optimum", x="k1", y="k2")
    return contours


def _draw_front(axes: Any, report: Report) -> None:
    tuned, trials = report.tuned, report.trials
    scores = [score for score in trials.archive if score.error < 4.0]
    axes.plot(*_coordinates(scores), ".", color=COMPASS, ms=2.5)
    axes.plot(*_coordinates([score for score in tuned.front if score.error < 4.0]), color=HULL, lw=1.6, label="front")
    axes.plot(*_coordinates([trials.paper]), "o", color=GOAL, ms=8, mec="white", label="the paper's 40, 0.3")
    axes.plot(*_coordinates([tuned.chosen]), "*", color=COMMAND, ms=15, mec=INK, mew=0.6, label="chosen")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis, ticks in ((axes.xaxis, TRAVEL_TICKS), (axes.yaxis, ERROR_TICKS)):
        low, high = axis.get_view_interval()
        axis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    name_panel(
        axes, "error against rudder travel, all cases", x="rudder travel, 1000 deg/h", y="error (ITAE), the paper's = 1"
    )
    axes.legend(loc="upper right", fontsize=8, edgecolor="none", framealpha=0.9)


def _coordinates(scores: list[Score]) -> tuple[list[float], list[float]]:
    return [score.travel_deg_per_h / THOUSAND for score in scores], [score.error for score in scores]


def _draw_headings(axes: Any, report: Report) -> None:
    first = report.traces[0]
    axes.plot(first.time_s, first.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    for trace, colour in zip(report.traces, (GOAL, HULL), strict=True):
        axes.plot(trace.time_s, trace.heading_rad * DEGREES_PER_RADIAN, color=colour, lw=1.3, label=_label(trace))
    name_panel(axes, f"hull's heading, {report.plotted_case}", x="time, s", y="deg")
    add_legend(axes)


def _draw_rudders(axes: Any, report: Report) -> None:
    for trace, colour, width in zip(report.traces, (GOAL, HULL), (0.5, 1.1), strict=True):
        axes.plot(trace.time_s, trace.rudder_rad * DEGREES_PER_RADIAN, color=colour, lw=width, label=_label(trace))
    add_headroom(axes)
    name_panel(axes, f"rudder, {report.plotted_case}", x="time, s", y="deg")
    add_legend(axes, 2)


def _label(trace: Trace) -> str:
    return f"{trace.name}: {trace.travel_deg_per_h / THOUSAND:.1f} thousand deg/h"


NOTE = (
    "The error is ITAE, the absolute heading error weighted by the time since the goal, relative to the paper's gains; "
    "root mean square over the cases. The rudder travel is that of the last third after each goal, mean of the cases. "
    "Each sea is run with the model and with ships whose K and T differ by 30 %; flat water at 0.2 and 1.2 m/s. The "
    "autopilot uses the model of the vehicle file. The table shows seas that were not used in the search, with the "
    "larger mean error of the two goals."
)


def write(report: Report, path: Path) -> tuple[Path, Path]:
    """Write the plot and the page; return the paths of both."""
    png, html = path.with_suffix(".png"), path.with_suffix(".html")
    draw(report, png)
    html.write_text(_page(report, png.read_bytes()), encoding="utf-8")
    return png, html


def _page(report: Report, png: bytes) -> str:
    lines = [*map(study_line, report.studies), *choice_lines(report), *switched_off_lines(report)]
    settings, cases = report.tuned.evaluations, len(report.trials.cases)
    return page.page(
        f"Tuning of {report.vehicle}",
        [
            page.paragraph(f"{settings} settings in {cases} trial runs each, seed {report.seed}", "lead"),
            page.image(png, "ITAE maps, front, headings and rudders"),
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
