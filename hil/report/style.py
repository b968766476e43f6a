"""Common style of all plots: colours, the empty figure, and the style of a panel."""

from __future__ import annotations

from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HULL, COMPASS, GOAL, COMMAND, BAND = "#0b4f8a", "#9cc4e4", "#d1495b", "#e8a33d", "#e9f5ec"
INK, GRID = "#333b44", "#dde3e8"
DOTS_PER_INCH = 120
HEADROOM = 0.22  # of the height, for a legend in one row


def new_figure(title: str, width_in: float, height_in: float) -> Any:
    """Return an empty figure with its title at the left."""
    figure = Figure(figsize=(width_in, height_in), dpi=DOTS_PER_INCH, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold", color=INK)
    return figure


def name_panel(axes: Any, title: str, *, x: str = "", y: str = "") -> None:
    """Write a panel's title at its left, and the names of its axes."""
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def add_legend(axes: Any, columns: int = 1) -> None:
    """Add a legend without a frame in the upper right corner."""
    axes.legend(loc="upper right", ncols=columns, frameon=False, fontsize=8)


def add_headroom(axes: Any) -> None:
    """Extend the vertical axis so that the legend is above the lines."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + HEADROOM * (high - low))


def finish(axes: Any) -> None:
    """Set grid, spines and colours of a panel."""
    axes.grid(visible=True, color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=8)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(GRID)
