"""The picture of an identification, in the manner of the paper's figures 4 to 7."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.identify.predict import Errors, Prediction
from hil.report.style import BAND, COMPASS, GOAL, HULL, finish, name_panel, new_figure

MEASURED, PREDICTED, RUDDER = COMPASS, GOAL, HULL
BAND_DEG = 10.0  # the paper's figure 5: nearly all errors lie within
MOST_COLUMNS = 3
MOST_POINTS = 6000


def draw(parts: Sequence[Errors], title: str, *, angular: bool = True) -> bytes:
    """Return a PNG: a column for each recording, with heading, its error, yaw rate and rudder.

    angular: the rudder column is an angle, and not a command of another unit.
    """
    shown = [part for part in parts if part.predictions][:MOST_COLUMNS]
    figure = new_figure(title, 4.0 + 4.6 * len(shown), 9.0)
    grid = figure.subplots(4, len(shown), sharex="col", squeeze=False, height_ratios=(1.5, 1.0, 1.0, 0.8))
    for column, part in enumerate(shown):
        axes = grid[:, column]
        name_panel(axes[0], Path(part.file).name)  # a long path would reach into the legend
        for number, prediction in enumerate(part.predictions):
            _stretch(axes, _thinned(prediction), first=number == 0, angular=angular)
        for panel in axes:
            finish(panel)
        axes[-1].set_xlabel("time, s")
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _stretch(axes: Any, prediction: Prediction, *, first: bool, angular: bool) -> None:
    degrees, time_s = DEGREES_PER_RADIAN, prediction.stretch.time_s

    def label(text: str) -> str | None:
        return text if first else None

    measured = prediction.stretch.heading_rad
    if measured is not None:
        axes[0].plot(time_s, measured * degrees, color=MEASURED, lw=2.0, label=label("measured"))
        error_deg = (measured - prediction.heading_rad) * degrees
        axes[1].axhspan(-BAND_DEG, BAND_DEG, color=BAND, lw=0, label=label(f"±{BAND_DEG:g} deg"))
        axes[1].plot(time_s, error_deg, color=RUDDER, lw=0.8)
    axes[0].plot(time_s, prediction.heading_rad * degrees, color=PREDICTED, lw=1.0, label=label("predicted"))
    if prediction.stretch.yaw_rate_rad_s is not None:
        rate = prediction.stretch.yaw_rate_rad_s
        axes[2].plot(time_s, rate * degrees, color=MEASURED, lw=1.2, label=label("measured"))
        # Waves and noise may be many times the hull's own turning: keep that in view.
        fastest = max(float(np.quantile(np.abs(rate), 0.98)), float(np.max(np.abs(prediction.yaw_rate_rad_s))))
        reach = 1.3 * fastest * degrees
        if np.isfinite(reach) and reach > 0.0:
            axes[2].set_ylim(-reach, reach)
    axes[2].plot(time_s, prediction.yaw_rate_rad_s * degrees, color=PREDICTED, lw=1.0, label=label("predicted"))
    rudder = prediction.stretch.rudder_rad * (degrees if angular else 1.0)
    axes[3].plot(time_s, rudder, color=RUDDER, lw=1.0, label=label("rudder"))
    if first:
        for panel, text in zip(
            axes,
            (
                "heading from start, deg",
                "heading error, deg",
                "yaw rate, deg/s",
                "rudder, deg" if angular else "command",
            ),
            strict=True,
        ):
            panel.set_ylabel(text)
            if panel.get_legend_handles_labels()[0]:
                # Above the panel, where there are no curves.
                panel.legend(
                    loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False, fontsize=8, borderaxespad=0.1
                )


def _thinned(prediction: Prediction) -> Prediction:
    """Leave out rows that a picture cannot resolve."""
    every = max(1, prediction.stretch.time_s.size // MOST_POINTS)
    if every == 1:
        return prediction

    chosen = slice(None, None, every)
    stretch = prediction.stretch.rows(chosen)
    return Prediction(stretch, prediction.heading_rad[chosen], prediction.yaw_rate_rad_s[chosen])
