"""The findings as a table on the terminal and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from hil.bench.figure import Figure, Finding
from hil.report.figure_file import entry, key_of

COLUMNS = ("", "ours", "bare limit", "ratio", "aim", "", "others")
NAME, VERDICT, OTHERS = 0, 5, 6
LEFT_ALIGNED = (NAME, VERDICT, OTHERS)
# Keys of the JSON output that differ from the names in Figure.
JSON_KEYS = {"maximum": "most", "maximum_ratio": "most_ratio", "minimum": "least"}


def table(findings: Sequence[Finding]) -> str:
    """Return all figures in aligned columns, in a block with notes for each finding."""
    rows = [_cells(figure) for finding in findings for figure in finding.figures]
    widths = [max(len(row[column]) for row in (COLUMNS, *rows)) for column in range(len(COLUMNS))]
    lines = [_line(COLUMNS, widths)]
    for finding in findings:
        lines += ["", finding.title]
        lines += [_line(_cells(figure), widths) for figure in finding.figures]
        lines += [f"    {note}" for note in finding.notes]
    return "\n".join(lines)


def as_json(findings: Sequence[Finding], circumstances: dict[str, Any]) -> str:
    """Return all findings as JSON; missing and invalid numbers are null."""
    content = {
        "circumstances": circumstances,
        "findings": [
            {"title": finding.title, "notes": finding.notes, "figures": [_row(figure) for figure in finding.figures]}
            for finding in findings
        ],
    }
    return json.dumps(content, indent=2) + "\n"


def as_entries(findings: Mapping[str, Finding], source: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the figures for docs/figures.json; the keys of `findings` are the names of the measurements."""
    return {
        key_of(measurement, figure.name): entry(
            figure.value, figure.unit, source, name=figure.name, bare=figure.bare, ratio=figure.ratio,
            aim=_aim(figure), met=figure.met, others=figure.peer, repeats=list(figure.repeats),
        )
        for measurement, finding in findings.items()
        for figure in finding.figures
        if math.isfinite(figure.value)
    }  # fmt: skip


def number(value: float | None) -> str:
    """Format a number with three significant digits; "-" for None."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def _row(figure: Figure) -> dict[str, Any]:
    row = {**asdict(figure), "ratio": figure.ratio, "met": figure.met}
    return {
        JSON_KEYS.get(name, name): None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in row.items()
    }


def _cells(figure: Figure) -> tuple[str, ...]:
    bare = "-" if figure.bare is None else f"{number(figure.bare)} {figure.unit}"
    ratio = "-" if figure.ratio is None else f"{number(figure.ratio)}x"
    verdict = {True: "met", False: "MISSED", None: ""}[figure.met]
    return f"  {figure.name}", f"{number(figure.value)} {figure.unit}", bare, ratio, _aim(figure), verdict, figure.peer


def _aim(figure: Figure) -> str:
    if figure.maximum is not None:
        return f"<= {figure.maximum:g} {figure.unit}"
    if figure.minimum is not None:
        return f">= {figure.minimum:g} {figure.unit}"
    return "" if figure.maximum_ratio is None else f"<= {figure.maximum_ratio:g}x bare"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = [
        cell.ljust(width) if column in LEFT_ALIGNED else cell.rjust(width)
        for column, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]
    return "  ".join(padded).rstrip()
