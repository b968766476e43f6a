"""The report of an identification as one self-contained HTML page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN
from hil.lab.identify.identify import Identification
from hil.lab.identify.predict import Errors, Prediction
from hil.lab.identify.report import format_estimate
from hil.lab.identify.verdict import IDENTIFIABLE, Estimate
from hil.report import page
from hil.report.page import Cell
from hil.report.style import BAND, COMPASS, GOAL, HULL, finish, name_panel, new_figure

TABLE_HEADER = ("", "value", "95 % interval", Cell("verdict"))
MEASURED_COLOUR, PREDICTED_COLOUR, RUDDER_COLOUR = COMPASS, GOAL, HULL
ERROR_BAND_DEG = 10.0  # contains almost all errors in figure 5 of the paper (docs/explanation/physics.md)
MAX_PLOT_COLUMNS = 3
MAX_CURVE_POINTS = 6000


def page_of(result: Identification, text: str, image: bytes, title: str, *, is_angle: bool) -> str:
    """Return the page, with the table of the estimates, the plot and the text of the terminal.

    is_angle: the rudder column is an angle, not a command of another unit.
    """
    rows = [_row(name, estimate, is_angle=is_angle) for name, estimate in result.judgement.estimates.items()]
    return page.page(
        title,
        [
            page.table([TABLE_HEADER, *rows]),
            page.heading("Measured and predicted"),
            page.image(image, "heading, error, yaw rate and rudder"),
            page.heading("Report"),
            page.verbatim(text),
        ],
    )


def _row(name: str, estimate: Estimate, *, is_angle: bool) -> tuple[str | Cell, ...]:
    value, interval, unit = format_estimate(name, estimate, is_angle=is_angle)
    style = "words good" if estimate.verdict == IDENTIFIABLE else "words bad"
    text = f"{value} {unit.replace('^2', '²')}".rstrip()
    return (name, text, interval, Cell(estimate.verdict, style, estimate.reason))


def draw(all_errors: Sequence[Errors], title: str, *, is_angle: bool = True) -> bytes:
    """Return a PNG: a column for each recording, with heading, its error, yaw rate and rudder.

    Only the first MAX_PLOT_COLUMNS recordings with predictions are drawn. is_angle: the rudder column is an angle, not
    a command of another unit.
    """
    plotted_errors = [errors for errors in all_errors if errors.predictions][:MAX_PLOT_COLUMNS]
    figure = new_figure(title, 4.0 + 4.6 * len(plotted_errors), 9.0)
    grid = figure.subplots(4, len(plotted_errors), sharex="col", squeeze=False, height_ratios=(1.5, 1.0, 1.0, 0.8))
    for column, errors in enumerate(plotted_errors):
        axes = grid[:, column]
        name_panel(axes[0], Path(errors.file).name)  # a long path would overlap the legend
        for number, prediction in enumerate(errors.predictions):
            _draw_stretch(axes, _thin(prediction), with_labels=number == 0, is_angle=is_angle)
        for panel in axes:
            finish(panel)
        axes[-1].set_xlabel("time, s")
    image = io.BytesIO()
    figure.savefig(image, format="png")
    return image.getvalue()


def _draw_stretch(axes: Any, prediction: Prediction, *, with_labels: bool, is_angle: bool) -> None:
    time_s = prediction.stretch.time_s

    def label(text: str) -> str | None:
        return text if with_labels else None

    measured = prediction.stretch.heading_rad
    if measured is not None:
        axes[0].plot(time_s, measured * DEGREES_PER_RADIAN, color=MEASURED_COLOUR, lw=2.0, label=label("measured"))
        error_deg = (measured - prediction.heading_rad) * DEGREES_PER_RADIAN
        axes[1].axhspan(-ERROR_BAND_DEG, ERROR_BAND_DEG, color=BAND, lw=0, label=label(f"±{ERROR_BAND_DEG:g} deg"))
        axes[1].plot(time_s, error_deg, color=RUDDER_COLOUR, lw=0.8)
    axes[0].plot(
        time_s, prediction.heading_rad * DEGREES_PER_RADIAN, color=PREDICTED_COLOUR, lw=1.0, label=label("predicted")
    )
    if prediction.stretch.yaw_rate_rad_s is not None:
        rate = prediction.stretch.yaw_rate_rad_s
        axes[2].plot(time_s, rate * DEGREES_PER_RADIAN, color=MEASURED_COLOUR, lw=1.2, label=label("measured"))
        # The yaw rate of waves and noise may be much larger than that of the turns: limit the axis.
        max_rate_rad_s = max(float(np.quantile(np.abs(rate), 0.98)), float(np.max(np.abs(prediction.yaw_rate_rad_s))))
        half_range = 1.3 * max_rate_rad_s * DEGREES_PER_RADIAN
        if np.isfinite(half_range) and half_range > 0.0:
            axes[2].set_ylim(-half_range, half_range)
    axes[2].plot(
        time_s, prediction.yaw_rate_rad_s * DEGREES_PER_RADIAN, color=PREDICTED_COLOUR, lw=1.0, label=label("predicted")
    )
    rudder = prediction.stretch.rudder_rad * (DEGREES_PER_RADIAN if is_angle else 1.0)
    axes[3].plot(time_s, rudder, color=RUDDER_COLOUR, lw=1.0, label=label("rudder"))
    if with_labels:
        rudder_label = "rudder, deg" if is_angle else "command"
        axis_labels = ("heading from start, deg", "heading error, deg", "yaw rate, deg/s", rudder_label)
        for panel, text in zip(axes, axis_labels, strict=True):
            panel.set_ylabel(text)
            if panel.get_legend_handles_labels()[0]:
                # Above the panel, outside the curves.
                panel.legend(
                    loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False, fontsize=8, borderaxespad=0.1
                )


def _thin(prediction: Prediction) -> Prediction:
    """Remove rows that a plot cannot resolve."""
    step = max(1, prediction.stretch.time_s.size // MAX_CURVE_POINTS)
    if step == 1:
        return prediction
    row_slice = slice(None, None, step)
    stretch = prediction.stretch.rows(row_slice)
    return Prediction(stretch, prediction.heading_rad[row_slice], prediction.yaw_rate_rad_s[row_slice])
