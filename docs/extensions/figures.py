"""The measured figures as pages name them: `{{ figures.name }}`, and tables of a group of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NO_BREAK = "\u00a0"
BENCH = (
    *("lateness", "sense", "replay", "load", "start", "trips", "transfers"),
    *("lockstep", "twin", "objective", "hour", "swarm", "first_use"),
)


@dataclass(frozen=True, slots=True)
class Shown:
    """One figure; as text it has its unit."""

    entry: Mapping[str, Any]

    @property
    def number(self) -> str:
        """The value without its unit."""
        return number(self.entry["value"])

    @property
    def source(self) -> str:
        """When, from which commit and by what command it was measured."""
        return "{when}, commit {commit}, `{command}`".format(**self.entry)

    def __str__(self) -> str:
        """Return the value and its unit, which stay on one line where the unit is short."""
        unit = self.entry["unit"]
        return f"{self.number}{' ' if ' ' in unit else NO_BREAK}{unit}" if unit else self.number


def substitutions(path: Path) -> dict[str, Any]:
    """Return what pages may name; a name that is not there fails the build."""
    entries: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return {
        "figures": {name: Shown(entry) for name, entry in entries.items()},
        "bench_tables": {group: _bench_table(_group(entries, group)) for group in BENCH},
        "reproduce_table": _paper_table(_group(entries, "reproduce")),
        "figure_sources": _source_table(entries),
    }


def number(value: float | str) -> str:
    """Write a number with three digits that mean something and thin spaces at the thousands; a text as it is."""
    if isinstance(value, str):
        return value
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
    whole, _, part = f"{value:,.{digits}f}".partition(".")
    return ".".join(filter(None, (whole.replace(",", "\u202f"), part.rstrip("0"))))


def _group(entries: Mapping[str, dict[str, Any]], prefix: str) -> list[dict[str, Any]]:
    return [entry for name, entry in entries.items() if name.startswith(f"{prefix}_")]


def _bench_table(entries: list[dict[str, Any]]) -> str:
    rows = []
    for entry in entries:
        unit, bare, ratio = entry["unit"], entry.get("bare"), entry.get("ratio")
        verdict = {True: ": met", False: ": **missed**", None: ""}[entry.get("met")]
        rows.append(
            (
                entry.get("name", ""),
                str(Shown(entry)),
                "" if bare is None else f"{number(bare)} {unit}",
                "" if ratio is None else number(ratio),
                entry.get("aim", "").replace("<=", "≤").replace(">=", "≥") + verdict,
                entry.get("others", ""),
                entry.get("note", ""),
            )
        )
    return _table(("figure", "measured", "bare limit", "ratio", "aim", "others", "note"), rows)


def _paper_table(entries: list[dict[str, Any]]) -> str:
    return _table(("", "the paper", "Rambler"), [(one["name"], one["others"], str(Shown(one))) for one in entries])


def _source_table(entries: Mapping[str, dict[str, Any]]) -> str:
    """Return each source once: what was measured together stands in one row."""
    counts: dict[tuple[str, ...], int] = {}
    for entry in entries.values():
        key = (f"`{entry['command']}`", entry["when"], entry["commit"], entry["machine"], entry.get("remark", ""))
        counts[key] = counts.get(key, 0) + 1
    rows = [(*key, str(count)) for key, count in counts.items()]
    return _table(("by", "when", "commit", "on", "remark", "figures"), rows)


def _table(titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table in Markdown, without the columns in which nothing stands."""
    full = [place for place in range(len(titles)) if any(row[place] for row in rows)]
    lines = [[line[place] for place in full] for line in (titles, ("---",) * len(titles), *rows)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
