"""The plot of a run: heading, error, yaw rate and rudder over time, and the track."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.report.figures import STEADY_AFTER_S, GoalFigures, goal_spans
from hil.report.style import (
    BAND,
    COMMAND,
    COMPASS,
    GOAL,
    GRID,
    HULL,
    INK,
    add_headroom,
    add_legend,
    finish,
    name_panel,
    new_figure,
)
from hil.sim.truth import Truth

SIZE_INCHES = (13.0, 8.4)
TABLE_ROWS = 4


def draw(truth: Truth, goals: Sequence[GoalFigures], title: str, path: Path) -> None:
    """Write the plot of a truth, which should be thinned if it is long, as a PNG file."""
    figure = new_figure(title, *SIZE_INCHES)
    left, right = figure.subfigures(1, 2, width_ratios=(2.2, 1.0))
    _draw_panels(left, truth)
    track, table = right.subplots(2, 1, height_ratios=(4.0, 1.0))
    _draw_track(track, truth, goals)
    finish(track)
    _draw_table(table, goals)
    figure.savefig(path)


def _draw_panels(figure: Any, truth: Truth) -> None:
    columns = figure.subplots(len(PANELS), 1, sharex=True, height_ratios=(1.5, 1.0, 0.8, 1.0))
    for axes, panel in zip(columns, PANELS, strict=True):
        panel(axes, truth)
        finish(axes)
    columns[-1].set_xlim(float(truth.time_s[0]), max(float(truth.time_s[-1]), 1.0))
    columns[-1].set_xlabel("time, s")


def _draw_heading(axes: Any, truth: Truth) -> None:
    degrees = DEGREES_PER_RADIAN
    if not np.array_equal(truth.heading_rad, truth.heading_low_rad):
        axes.plot(truth.time_s, truth.heading_rad * degrees, color=COMPASS, lw=0.5, label="with wave yaw")
    axes.plot(truth.time_s, truth.heading_low_rad * degrees, color=HULL, lw=1.6, label="hull")
    axes.plot(truth.time_s, truth.goal_rad * degrees, color=GOAL, lw=1.2, ls="--", label="goal")
    axes.set_ylabel("heading, deg")
    add_legend(axes, 3)
    add_headroom(axes)


def _draw_error(axes: Any, truth: Truth) -> None:
    error_deg = (truth.heading_low_rad - truth.goal_rad) * DEGREES_PER_RADIAN
    axes.axhspan(-3.0, 3.0, color=BAND, lw=0, label="±3 deg")
    axes.axhline(0.0, color=GRID, lw=0.8)
    axes.plot(truth.time_s, error_deg, color=HULL, lw=1.2)
    steady = [error_deg[first:last][truth.time_s[first:last] >= truth.time_s[first] + STEADY_AFTER_S]
              for first, last in goal_spans(truth.goal_rad)]  # fmt: skip
    max_error_deg = max((float(np.max(np.abs(error))) for error in steady if error.size), default=0.0)
    limit_deg = max(6.0, 1.5 * max_error_deg)
    axes.set_ylim(-limit_deg, limit_deg)
    axes.set_ylabel("error, deg")
    add_legend(axes)


def _draw_yaw_rate(axes: Any, truth: Truth) -> None:
    axes.axhline(0.0, color=GRID, lw=0.8)
    axes.plot(truth.time_s, truth.yaw_rate_rad_s * DEGREES_PER_RADIAN, color=HULL, lw=1.0)
    axes.set_ylabel("yaw rate, deg/s")


def _draw_rudder(axes: Any, truth: Truth) -> None:
    axes.axhline(0.0, color=GRID, lw=0.8)
    axes.plot(truth.time_s, truth.rudder_command_rad * DEGREES_PER_RADIAN, color=COMMAND, lw=1.8, label="commanded")
    axes.plot(truth.time_s, truth.rudder_rad * DEGREES_PER_RADIAN, color=HULL, lw=0.8, label="angle")
    axes.set_ylabel("rudder, deg")
    add_legend(axes, 2)
    add_headroom(axes)


def _draw_track(axes: Any, truth: Truth, goals: Sequence[GoalFigures]) -> None:
    axes.plot(truth.east_m, truth.north_m, color=HULL, lw=1.8)
    axes.plot(truth.east_m[:1], truth.north_m[:1], "o", color=HULL, ms=6)
    axes.annotate("start", (truth.east_m[0], truth.north_m[0]), (7, -3), textcoords="offset points", color=INK)
    middle_m = 0.5 * (float(np.min(truth.east_m)) + float(np.max(truth.east_m)))
    for figures in goals:
        row = int(np.searchsorted(truth.time_s, figures.t_s))
        if abs(figures.step_deg) < 1.0:
            continue
        is_left = truth.east_m[row] <= middle_m
        axes.plot(truth.east_m[row], truth.north_m[row], "D", color=GOAL, ms=5)
        axes.annotate(
            f"{figures.goal_deg:.0f}° at {figures.t_s:.0f} s",
            (truth.east_m[row], truth.north_m[row]),
            (8 if is_left else -8, -3),
            textcoords="offset points",
            ha="left" if is_left else "right",
            color=GOAL,
            fontsize=9,
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.15)
    name_panel(axes, "track over the ground", x="east, m", y="north, m")


def _draw_table(axes: Any, goals: Sequence[GoalFigures]) -> None:
    """Write the main figures beside the plots."""
    rows = [("goal", "overshoot", "settled", "rms error")]
    for goal in goals[:TABLE_ROWS]:
        settling_text = "never" if goal.settling_s is None else f"{goal.settling_s:.0f} s"
        rows.append(
            (f"{goal.goal_deg:.0f}°", f"{goal.overshoot_deg:.2f}°", settling_text, f"{goal.rms_error_deg:.2f}°")
        )
    for line, row in enumerate(rows):
        for column, cell in enumerate(row):
            axes.text(
                0.16 + 0.27 * column,
                0.92 - 0.2 * line,
                cell,
                ha="right",
                va="top",
                color=INK,
                fontsize=9,
                fontweight="bold" if line == 0 else "normal",
                transform=axes.transAxes,
            )
    axes.set_axis_off()


PANELS: tuple[Callable[[Any, Truth], None], ...] = (_draw_heading, _draw_error, _draw_yaw_rate, _draw_rudder)
