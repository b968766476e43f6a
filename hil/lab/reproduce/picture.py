"""The picture of a reproduction, in the manner of the paper's figures 4 to 7 and of its trials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.reproduce.chain import Chain, Voyage
from hil.lab.reproduce.rows import WITHIN_DEG
from hil.report.picture import BAND, COMMAND, COMPASS, GOAL, GRID, HULL, INK

SIZE_INCHES = (13.0, 9.4)
DOTS_PER_INCH = 120
COLOURS = {"paper": GOAL, "tuned": HULL}


def draw(chain: Chain, path: Path) -> None:
    """Write the picture as a PNG file."""
    figure = Figure(figsize=SIZE_INCHES, dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(
        "From manoeuvre to closed loop, on synthetic tank data", x=0.01, ha="left", fontsize=13, fontweight="bold",
        color=INK,
    )  # fmt: skip
    grid = figure.subplots(4, 2, height_ratios=(1.3, 1.0, 1.3, 1.0))
    _prediction(grid[0][0], chain)
    _prediction_error(grid[1][0], chain)
    _planned_rudder(grid[0][1], chain)
    _spread(grid[1][1], chain)
    for column, sea in enumerate(("tank", "sea")):
        voyages = [voyage for voyage in chain.voyages if voyage.scenario == sea]
        _headings(grid[2][column], voyages)
        _errors(grid[3][column], voyages)
    for axes in grid.ravel():
        _finish(axes)
    figure.savefig(path)


def _prediction(axes: Any, chain: Chain) -> None:
    held = chain.held_out
    axes.plot(held.time_s, held.heading_rad * DEGREES_PER_RADIAN, color=COMPASS, lw=1.6, label="compass")
    axes.plot(held.time_s, chain.prediction_rad * DEGREES_PER_RADIAN, color=HULL, lw=1.0, label="predicted")
    _named(axes, "heading of a zigzag that the model has not seen", "deg")
    axes.legend(loc="upper right", ncols=2, frameon=False, fontsize=8)
    _headroom(axes)


def _prediction_error(axes: Any, chain: Chain) -> None:
    axes.axhspan(-10.0, 10.0, color=BAND, lw=0, label="the paper's ±10°")
    axes.plot(chain.held_out.time_s, chain.prediction_error_deg, color=HULL, lw=0.7)
    axes.set_ylim(-15.0, 15.0)
    _named(axes, "prediction error", "deg")
    axes.set_xlabel("time, s")
    axes.legend(loc="upper right", frameon=False, fontsize=8)


def _planned_rudder(axes: Any, chain: Chain) -> None:
    held = chain.held_out
    axes.plot(held.time_s, held.rudder_rad * DEGREES_PER_RADIAN, color=COMMAND, lw=1.0)
    _named(axes, "rudder of that zigzag", "deg")
    axes.set_xlabel("time, s")


def _spread(axes: Any, chain: Chain) -> None:
    error = chain.prediction_error_deg
    axes.hist(error, bins=np.linspace(-10.0, 10.0, 81), color=COMPASS)
    mean = float(np.mean(error))
    axes.axvline(mean, color=HULL, lw=1.4, label=f"mean {mean:+.2f}°")
    axes.axvline(-0.6, color=GOAL, lw=1.2, ls="--", label="the paper's mean -0.6°")
    _named(axes, "prediction error, how often", "samples")
    axes.set_xlabel("deg")
    axes.legend(loc="upper right", frameon=False, fontsize=8)


def _headings(axes: Any, voyages: list[Voyage]) -> None:
    truth = voyages[0].truth
    axes.plot(truth.time_s, truth.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    for voyage in voyages:
        heading_deg = voyage.truth.heading_low_rad * DEGREES_PER_RADIAN
        axes.plot(voyage.truth.time_s, heading_deg, color=COLOURS[voyage.gains], lw=1.2, label=f"{voyage.gains} gains")
    _named(axes, f"{voyages[0].scenario}: heading", "deg")
    axes.legend(loc="upper right", ncols=3, frameon=False, fontsize=8)
    _headroom(axes)


def _errors(axes: Any, voyages: list[Voyage]) -> None:
    within = WITHIN_DEG[voyages[0].scenario]
    axes.axhspan(-within, within, color=BAND, lw=0, label=f"the paper's ±{within:g}°")
    for voyage in voyages:
        truth = voyage.truth
        error_deg = (truth.heading_low_rad - truth.goal_rad) * DEGREES_PER_RADIAN
        axes.plot(truth.time_s, error_deg, color=COLOURS[voyage.gains], lw=0.9)
    axes.set_ylim(-1.6 * within, 1.6 * within)
    _named(axes, f"{voyages[0].scenario}: error", "deg")
    axes.set_xlabel("time, s")
    axes.legend(loc="upper right", frameon=False, fontsize=8)


def _named(axes: Any, title: str, unit: str) -> None:
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    axes.set_ylabel(unit)


def _headroom(axes: Any) -> None:
    """Leave room above the lines for the legend."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))


def _finish(axes: Any) -> None:
    axes.grid(visible=True, color=GRID, lw=0.6, alpha=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=8)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(GRID)
