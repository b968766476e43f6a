"""The picture of a reproduction, in the manner of the paper's figures 4 to 7 and of its trials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.reproduce.chain import Chain, Voyage
from hil.lab.reproduce.rows import WITHIN_DEG
from hil.report.style import (
    BAND,
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

SIZE_INCHES = (13.0, 9.4)
COLOURS = {"paper": GOAL, "tuned": HULL}


def draw(chain: Chain, path: Path) -> None:
    """Write the picture as a PNG file."""
    figure = new_figure("From manoeuvre to closed loop, on synthetic tank data", *SIZE_INCHES)
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
        finish(axes)
    figure.savefig(path)


def _prediction(axes: Any, chain: Chain) -> None:
    held = chain.held_out
    axes.plot(held.time_s, held.heading_rad * DEGREES_PER_RADIAN, color=COMPASS, lw=1.6, label="compass")
    axes.plot(held.time_s, chain.prediction_rad * DEGREES_PER_RADIAN, color=HULL, lw=1.0, label="predicted")
    name_panel(axes, "heading of a zigzag that the model has not seen", y="deg")
    add_legend(axes, 2)
    add_headroom(axes)


def _prediction_error(axes: Any, chain: Chain) -> None:
    axes.axhspan(-10.0, 10.0, color=BAND, lw=0, label="the paper's ±10°")
    axes.plot(chain.held_out.time_s, chain.prediction_error_deg, color=HULL, lw=0.7)
    axes.set_ylim(-15.0, 15.0)
    name_panel(axes, "prediction error", x="time, s", y="deg")
    add_legend(axes)


def _planned_rudder(axes: Any, chain: Chain) -> None:
    held = chain.held_out
    axes.plot(held.time_s, held.rudder_rad * DEGREES_PER_RADIAN, color=COMMAND, lw=1.0)
    name_panel(axes, "rudder of that zigzag", x="time, s", y="deg")


def _spread(axes: Any, chain: Chain) -> None:
    error = chain.prediction_error_deg
    axes.hist(error, bins=np.linspace(-10.0, 10.0, 81), color=COMPASS)
    mean = float(np.mean(error))
    axes.axvline(mean, color=HULL, lw=1.4, label=f"mean {mean:+.2f}°")
    axes.axvline(-0.6, color=GOAL, lw=1.2, ls="--", label="the paper's mean -0.6°")
    name_panel(axes, "prediction error, how often", x="deg", y="samples")
    add_legend(axes)


def _headings(axes: Any, voyages: list[Voyage]) -> None:
    truth = voyages[0].truth
    axes.plot(truth.time_s, truth.goal_rad * DEGREES_PER_RADIAN, color=INK, lw=1.0, ls="--", label="goal")
    for voyage in voyages:
        heading_deg = voyage.truth.heading_low_rad * DEGREES_PER_RADIAN
        axes.plot(voyage.truth.time_s, heading_deg, color=COLOURS[voyage.gains], lw=1.2, label=f"{voyage.gains} gains")
    name_panel(axes, f"{voyages[0].scenario}: heading", y="deg")
    add_legend(axes, 3)
    add_headroom(axes)


def _errors(axes: Any, voyages: list[Voyage]) -> None:
    within = WITHIN_DEG[voyages[0].scenario]
    axes.axhspan(-within, within, color=BAND, lw=0, label=f"the paper's ±{within:g}°")
    for voyage in voyages:
        truth = voyage.truth
        error_deg = (truth.heading_low_rad - truth.goal_rad) * DEGREES_PER_RADIAN
        axes.plot(truth.time_s, error_deg, color=COLOURS[voyage.gains], lw=0.9)
    axes.set_ylim(-1.6 * within, 1.6 * within)
    name_panel(axes, f"{voyages[0].scenario}: error", x="time, s", y="deg")
    add_legend(axes)
