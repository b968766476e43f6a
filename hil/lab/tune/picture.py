"""The picture of a tuning: the paper's ITAE planes, the front of error and rudder work, and runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import FixedLocator, NullLocator

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.tune import paper
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.report import Report, Trace
from hil.lab.tune.trials import Score
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
)

SIZE_INCHES = (13.0, 8.6)
EXCESS_PERCENT = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
THOUSAND = 1000.0
TRAVEL_TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
ERROR_TICKS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0, 4.0)


def draw(report: Report, path: Path) -> None:
    """Write the picture as a PNG file."""
    figure = new_figure(f"Tuning of {report.vehicle}", *SIZE_INCHES)
    top, bottom = figure.subfigures(2, 1, height_ratios=(1.15, 1.0))
    upper = top.subplots(1, 1 + len(report.studies))
    for axes, study in zip(upper, report.studies, strict=False):
        shades = _plane(axes, study)
    # One scale for all planes: labels on the lines would lie on each other where the plane is steep.
    bar = top.colorbar(shades, ax=upper[len(report.studies) - 1], format="+%g %%", pad=0.03, aspect=30)
    bar.ax.tick_params(colors=INK, labelsize=7, length=0)
    bar.outline.set_visible(False)
    _front(upper[-1], report)
    lower = bottom.subplots(1, 2)
    _headings(lower[0], report)
    _rudders(lower[1], report)
    for axes in (*upper, *lower):
        finish(axes)
    figure.savefig(path)


def _plane(axes: Any, study: StepStudy) -> Any:
    """Draw J over the k1-k2 plane with the paper's gains and the optimum on it; return the shades."""
    excess = 100.0 * (study.plane / study.best_itae - 1.0)
    palette = colormaps["Blues_r"](np.linspace(0.25, 0.98, len(EXCESS_PERCENT) - 1))
    shades = axes.contourf(study.k1, study.k2, np.clip(excess, 0.0, 499.0), levels=EXCESS_PERCENT, colors=palette)
    axes.contour(study.k1, study.k2, excess, levels=EXCESS_PERCENT[1:-1], colors="white", linewidths=0.6)
    best = study.swarm.best
    axes.plot(paper.K1, paper.K2, "o", color=GOAL, ms=8, mec="white", clip_on=False, zorder=5)
    axes.plot(best[0], best[1], "D", color=COMMAND, ms=7, mec="white", clip_on=False, zorder=5)
    box = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": "none", "alpha": 0.85}
    axes.annotate(
        f"the paper's 40, 0.3: +{100.0 * study.excess:.1f} %",
        (paper.K1, paper.K2), (paper.K1 - 4.0, 4.6), ha="center", fontsize=8, color=GOAL, bbox=box,
        arrowprops={"arrowstyle": "-", "color": GOAL},
    )  # fmt: skip
    axes.annotate(
        f"least: {best[0]:.0f}, {best[1]:.2f}",
        (best[0], best[1]), (best[0] - 3.0, 2.9), ha="right", fontsize=8, color=INK, bbox=box,
        arrowprops={"arrowstyle": "-", "color": INK},
    )  # fmt: skip
    name_panel(axes, f"ITAE of a {study.step_deg:g}° step, above the least", x="k1", y="k2")
    return shades


def _front(axes: Any, report: Report) -> None:
    tuned, trials = report.tuned, report.trials
    shown = [score for score in trials.archive if score.error < 4.0]
    axes.plot(*_places(shown), ".", color=COMPASS, ms=2.5)
    axes.plot(*_places([score for score in tuned.front if score.error < 4.0]), color=HULL, lw=1.6, label="front")
    axes.plot(*_places([trials.paper]), "o", color=GOAL, ms=8, mec="white", label="the paper's 40, 0.3")
    axes.plot(*_places([tuned.chosen]), "*", color=COMMAND, ms=15, mec=INK, mew=0.6, label="chosen")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis, ticks in ((axes.xaxis, TRAVEL_TICKS), (axes.yaxis, ERROR_TICKS)):
        low, high = axis.get_view_interval()
        axis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
    name_panel(
        axes, "error against rudder work, all cases", x="rudder travel, 1000 deg/h", y="error (ITAE), the paper's = 1"
    )
    axes.legend(loc="upper right", fontsize=8, edgecolor="none", framealpha=0.9)


def _places(scores: list[Score]) -> tuple[list[float], list[float]]:
    return [score.travel_deg_per_h / THOUSAND for score in scores], [score.error for score in scores]


def _headings(axes: Any, report: Report) -> None:
    first = report.traces[0]
    axes.plot(first.time_s, first.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    for trace, colour in zip(report.traces, (GOAL, HULL), strict=True):
        axes.plot(trace.time_s, trace.heading_rad * DEGREES_PER_RADIAN, color=colour, lw=1.3, label=_label(trace))
    name_panel(axes, f"hull's heading, {report.shown_case}", x="time, s", y="deg")
    add_legend(axes)


def _rudders(axes: Any, report: Report) -> None:
    for trace, colour, width in zip(report.traces, (GOAL, HULL), (0.5, 1.1), strict=True):
        axes.plot(trace.time_s, trace.rudder_rad * DEGREES_PER_RADIAN, color=colour, lw=width, label=_label(trace))
    add_headroom(axes)
    name_panel(axes, f"rudder, {report.shown_case}", x="time, s", y="deg")
    add_legend(axes, 2)


def _label(trace: Trace) -> str:
    return f"{trace.name}: {trace.travel_deg_per_h / THOUSAND:.1f} thousand deg/h"
