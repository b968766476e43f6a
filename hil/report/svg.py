"""Small plots as SVG within a page, with the page's colours, light or dark, and its width."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from hil.sim.truth import Array

WIDTH, HEIGHT, MARGIN, FOOT, HEAD = 340, 150, 10, 20, 8
BINS = 32
COUNT_WIDTH = 40  # of the numbers beside a histogram
LINE = 22  # of a row of intervals
NAME_WIDTH = 150
TAIL = 0.005  # share of the numbers at each side that a histogram counts in its outermost bins


def card(title: str, picture: str, *lines: str) -> str:
    """Return a plot under its title, with lines of text below."""
    notes = "".join(f'<p class="note">{escape(line)}</p>' for line in lines)
    return f'<div class="card"><header>{escape(title)}</header>{picture}{notes}</div>'


def cards(each: Sequence[str]) -> str:
    """Return cards beside each other, as many as fit."""
    return f'<div class="parts">{"".join(each)}</div>'


def histogram(values: Array, marks: Sequence[float] = ()) -> str:
    """Return a histogram with vertical lines at marks; outliers are counted in the outermost bins."""
    low, high = (float(np.quantile(values, share)) for share in (TAIL, 1.0 - TAIL))
    if not high - low > 1e-9 * max(1.0, abs(low)):
        low, high = low - 0.5, low + 0.5
    counts, _ = np.histogram(np.clip(values, low, high), BINS, (low, high))
    left, base, most = COUNT_WIDTH, HEIGHT - FOOT, int(counts.max())
    inner = WIDTH - left - MARGIN
    wide, tall = inner / BINS, (base - HEAD) / most
    bars = "".join(
        f'<rect class="bar" x="{left + wide * place:.1f}" y="{base - tall * count:.1f}" width="{wide - 1:.1f}"'
        f' height="{tall * count:.1f}"/>'
        for place, count in enumerate(counts.tolist())
    )
    lines = "".join(
        f'<line class="cursor" x1="{x:.1f}" x2="{x:.1f}" y1="{HEAD}" y2="{base}"/>'
        for x in (left + inner * (mark - low) / (high - low) for mark in marks if low <= mark <= high)
    )
    return _svg(HEIGHT, bars + lines + _axis(low, high, left, inner, base) + _counts(most, left, base, tall))


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its confidence interval; intervals that contain zero are drawn faint."""

    name: str
    value: float
    low: float
    high: float

    @property
    def sure(self) -> bool:
        """Whether zero lies outside."""
        return self.low > 0.0 or self.high < 0.0


def intervals(rows: Sequence[Interval], reach: float | None = None) -> str:
    """Return confidence intervals one below the other around zero, up to `reach` to either side."""
    most = reach or max((abs(end) for row in rows for end in (row.low, row.high) if math.isfinite(end)), default=1.0)
    most = most or 1.0
    inner = WIDTH - NAME_WIDTH - MARGIN
    middle, scale = NAME_WIDTH + inner / 2, inner / 2 / most
    base = LINE * len(rows) + HEAD
    parts = [f'<line class="zero" x1="{middle:.1f}" x2="{middle:.1f}" y1="{HEAD}" y2="{base}"/>']
    for place, row in enumerate(rows):
        y = HEAD + LINE * (place + 0.5)
        x, low, high = (middle + scale * max(-most, min(most, end)) for end in (row.value, row.low, row.high))
        kind = "" if row.sure else " faint"
        parts.append(
            f'<text x="0" y="{y + 4:.1f}">{escape(row.name)}</text>'
            f'<line class="line{kind}" x1="{low:.1f}" x2="{high:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<circle class="bar{kind}" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
        )
    return _svg(base + FOOT, "".join(parts) + _axis(-most, most, NAME_WIDTH, inner, base))


def _axis(low: float, high: float, left: float, inner: float, base: float) -> str:
    texts = "".join(
        f'<text x="{left + inner * share:.1f}" y="{base + 14}" text-anchor="{anchor}">{formatted(number)}</text>'
        for share, number, anchor in ((0.0, low, "start"), (0.5, 0.5 * (low + high), "middle"), (1.0, high, "end"))
    )
    return f'<line class="frame" x1="{left}" x2="{left + inner}" y1="{base}" y2="{base}"/>{texts}'


def _counts(most: int, left: float, base: float, tall: float) -> str:
    """Return a vertical axis of counts: zero, half of the maximum if whole, the maximum."""
    texts = "".join(
        f'<text x="{left - 4}" y="{base - tall * count + 4:.1f}" text-anchor="end">{formatted(count)}</text>'
        for count in (0, *((most // 2,) if most % 2 == 0 else ()), most)
    )
    return f'<line class="frame" x1="{left}" x2="{left}" y1="{HEAD}" y2="{base}"/>{texts}'


def formatted(value: float) -> str:
    """Return a number with three digits or more, without an exponent if possible."""
    if abs(value) < 1e-12:
        return "0"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _svg(height: float, content: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {height:g}" role="img">{content}</svg>'
