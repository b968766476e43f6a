"""Small plots as SVG within a page, with the colours (light or dark) and the width of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from hil.sim.truth import Array

# Sizes are in units of the viewBox.
WIDTH, HEIGHT, MARGIN, FOOT, HEAD = 340, 150, 10, 20, 8
BINS = 32
COUNT_WIDTH = 40  # width of the numbers beside a histogram
LINE = 22  # height of a row of intervals
NAME_WIDTH = 150
TAIL = 0.005  # share of the numbers at each side that is counted in the outermost bins


def card(title: str, picture: str, *lines: str) -> str:
    """Return a plot under its title, with lines of text below."""
    notes = "".join(f'<p class="note">{escape(line)}</p>' for line in lines)
    return f'<div class="card"><header>{escape(title)}</header>{picture}{notes}</div>'


def cards(items: Sequence[str]) -> str:
    """Return cards side by side."""
    return f'<div class="parts">{"".join(items)}</div>'


def histogram(values: Array, marks: Sequence[float] = ()) -> str:
    """Return a histogram with vertical lines at marks; outliers are counted in the outermost bins."""
    low, high = (float(np.quantile(values, share)) for share in (TAIL, 1.0 - TAIL))
    if not high - low > 1e-9 * max(1.0, abs(low)):
        low, high = low - 0.5, low + 0.5
    counts, _ = np.histogram(np.clip(values, low, high), BINS, (low, high))
    left, base, maximum = COUNT_WIDTH, HEIGHT - FOOT, int(counts.max())
    inner = WIDTH - left - MARGIN
    bar_width, bar_scale = inner / BINS, (base - HEAD) / maximum
    bars = "".join(
        f'<rect class="bar" x="{left + bar_width * index:.1f}" y="{base - bar_scale * count:.1f}"'
        f' width="{bar_width - 1:.1f}" height="{bar_scale * count:.1f}"/>'
        for index, count in enumerate(counts.tolist())
    )
    lines = "".join(
        f'<line class="cursor" x1="{x:.1f}" x2="{x:.1f}" y1="{HEAD}" y2="{base}"/>'
        for x in (left + inner * (mark - low) / (high - low) for mark in marks if low <= mark <= high)
    )
    return _svg(HEIGHT, bars + lines + _axis(low, high, left, inner, base) + _counts(maximum, left, base, bar_scale))


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its confidence interval; intervals that contain zero are drawn faint."""

    name: str
    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """True if the interval does not contain zero."""
        return self.low > 0.0 or self.high < 0.0


def intervals(rows: Sequence[Interval], limit: float | None = None) -> str:
    """Return a plot of confidence intervals around zero; the axis extends to `limit` on both sides."""
    maximum = limit or max((abs(end) for row in rows for end in (row.low, row.high) if math.isfinite(end)), default=1.0)
    maximum = maximum or 1.0
    inner = WIDTH - NAME_WIDTH - MARGIN
    centre, scale = NAME_WIDTH + inner / 2, inner / 2 / maximum
    base = LINE * len(rows) + HEAD
    parts = [f'<line class="zero" x1="{centre:.1f}" x2="{centre:.1f}" y1="{HEAD}" y2="{base}"/>']
    for index, row in enumerate(rows):
        y = HEAD + LINE * (index + 0.5)
        x, low, high = (centre + scale * max(-maximum, min(maximum, end)) for end in (row.value, row.low, row.high))
        class_suffix = "" if row.excludes_zero else " faint"
        parts.append(
            f'<text x="0" y="{y + 4:.1f}">{escape(row.name)}</text>'
            f'<line class="line{class_suffix}" x1="{low:.1f}" x2="{high:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<circle class="bar{class_suffix}" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
        )
    return _svg(base + FOOT, "".join(parts) + _axis(-maximum, maximum, NAME_WIDTH, inner, base))


def _axis(low: float, high: float, left: float, inner: float, base: float) -> str:
    texts = "".join(
        f'<text x="{left + inner * share:.1f}" y="{base + 14}" text-anchor="{anchor}">{format_number(value)}</text>'
        for share, value, anchor in ((0.0, low, "start"), (0.5, 0.5 * (low + high), "middle"), (1.0, high, "end"))
    )
    return f'<line class="frame" x1="{left}" x2="{left + inner}" y1="{base}" y2="{base}"/>{texts}'


def _counts(maximum: int, left: float, base: float, bar_scale: float) -> str:
    """Return a vertical axis of counts: zero, half of the maximum if whole, the maximum."""
    texts = "".join(
        f'<text x="{left - 4}" y="{base - bar_scale * count + 4:.1f}" text-anchor="end">{format_number(count)}</text>'
        for count in (0, *((maximum // 2,) if maximum % 2 == 0 else ()), maximum)
    )
    return f'<line class="frame" x1="{left}" x2="{left}" y1="{HEAD}" y2="{base}"/>{texts}'


def format_number(value: float) -> str:
    """Format a number with three digits or more, without an exponent if possible."""
    if abs(value) < 1e-12:
        return "0"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _svg(height: float, content: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {height:g}" role="img">{content}</svg>'
