"""The picture of an identification, in the manner of the paper's figures 4 to 7."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.identify.held_out import HeldOut, Prediction
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretch import Stretch

MEASURED, PREDICTED, RUDDER, BAND = "#9cc4e4", "#d1495b", "#0b4f8a", "#e9f5ec"
INK, GRID = "#333b44", "#dde3e8"
DOTS_PER_INCH = 110
BAND_DEG = 10.0  # the paper's figure 5: nearly all errors lie within
MOST_COLUMNS = 3
MOST_POINTS = 6000


def draw(parts: Sequence[HeldOut], title: str) -> bytes:
    """Return a PNG: a column for each recording, with heading, its error, yaw rate and rudder."""
    shown = [part for part in parts if part.predictions][:MOST_COLUMNS]
    figure = Figure(figsize=(4.0 + 4.6 * len(shown), 9.0), dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold", color=INK)
    grid: Any = figure.subplots(4, len(shown), sharex="col", squeeze=False, height_ratios=(1.5, 1.0, 1.0, 0.8))
    for column, part in enumerate(shown):
        axes = grid[:, column]
        axes[0].set_title(part.file, fontsize=10, color=INK, loc="left")
        for number, one in enumerate(part.predictions):
            _stretch(axes, _thinned(one), first=number == 0)
        for panel in axes:
            _finish(panel)
        axes[-1].set_xlabel("time, s")
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _stretch(axes: Any, one: Prediction, *, first: bool) -> None:
    degrees, time_s = DEGREES_PER_RADIAN, one.stretch.time_s

    def label(text: str) -> str | None:
        return text if first else None

    measured = one.stretch.heading_rad
    if measured is not None:
        axes[0].plot(time_s, measured * degrees, color=MEASURED, lw=2.0, label=label("measured"))
        error_deg = (measured - one.heading_rad) * degrees
        axes[1].axhspan(-BAND_DEG, BAND_DEG, color=BAND, lw=0, label=label(f"±{BAND_DEG:g} deg"))
        axes[1].plot(time_s, error_deg, color=RUDDER, lw=0.8)
    axes[0].plot(time_s, one.heading_rad * degrees, color=PREDICTED, lw=1.0, label=label("predicted"))
    if one.stretch.yaw_rate_rad_s is not None:
        rate = one.stretch.yaw_rate_rad_s
        axes[2].plot(time_s, rate * degrees, color=MEASURED, lw=1.2, label=label("measured"))
        # Waves and noise may be many times the hull's own turning: keep that in view.
        reach = 1.3 * max(float(np.quantile(np.abs(rate), 0.98)), float(np.max(np.abs(one.yaw_rate_rad_s)))) * degrees
        if np.isfinite(reach) and reach > 0.0:
            axes[2].set_ylim(-reach, reach)
    axes[2].plot(time_s, one.yaw_rate_rad_s * degrees, color=PREDICTED, lw=1.0, label=label("predicted"))
    axes[3].plot(time_s, one.stretch.rudder_rad * degrees, color=RUDDER, lw=1.0, label=label("rudder"))
    if first:
        for panel, text in zip(
            axes, ("heading from start, deg", "heading error, deg", "yaw rate, deg/s", "rudder, deg"), strict=True
        ):
            panel.set_ylabel(text)
            if panel.get_legend_handles_labels()[0]:
                # Above the panel, where there are no curves.
                panel.legend(
                    loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False, fontsize=8, borderaxespad=0.1
                )


def _thinned(one: Prediction) -> Prediction:
    """Leave out rows that nobody can tell apart in a picture."""
    every = max(1, one.stretch.time_s.size // MOST_POINTS)
    if every == 1:
        return one

    def some(values: Floats) -> Floats:
        return values[::every]

    full = one.stretch
    stretch = Stretch.of(
        full.name,
        some(full.time_s),
        some(full.rudder_rad),
        None if full.heading_rad is None else some(full.heading_rad),
        None if full.yaw_rate_rad_s is None else some(full.yaw_rate_rad_s),
        some(full.speed_ratio),
    )
    return Prediction(stretch, some(one.heading_rad), some(one.yaw_rate_rad_s))


def _finish(axes: Any) -> None:
    axes.grid(visible=True, color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=8)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(GRID)
