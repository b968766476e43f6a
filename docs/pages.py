"""Write the generated parts of the Markdown pages, or check that they are up to date.

A generated part is between two HTML comments, which Markdown viewers do not show:

    <!-- figure: NAME -->12.3 ms<!-- end -->     a measured value of docs/figures.json, within a sentence or a table
    <!-- table: bench PREFIX -->                 a table of all figures PREFIX_*; also `reproduce`, `sources`,
                                                 `drivers`, `sentences`, `transducers`
    <!-- help: rambler run -->                   the help of a command
    <!-- output: rambler plan items -->          the Markdown that a command prints
    <!-- code: PATH -->                          a file
    <!-- code: PATH NAME -->                     one function, class, method or assignment
    <!-- code: PATH /FIRST/ /LAST/ -->           from the first line that begins with FIRST to one that begins with LAST

Start and end of all parts except figures are on lines without other text. The pages below params/ are generated as a
whole.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import difflib
import importlib
import io
import json
import math
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from firmware_py.common.options import OptionMeaning, meanings  # noqa: E402 - found by the path above
from firmware_py.devices import SECTIONS  # noqa: E402
from firmware_py.sensors import nmea_compass, nmea_depth, nmea_position, nmea_wind  # noqa: E402
from firmware_py.sensors.nmea_sentences import IGNORED  # noqa: E402
from firmware_py.sensors.nmea_sentences import TABLE as SENTENCES  # noqa: E402
from firmware_py.sensors.nmea_transducers import QUANTITIES, UNITS  # noqa: E402
from hil.lab.identify import nmea_capture  # noqa: E402

PROGRAMS = {"rambler": "firmware_py.__main__", "rambler-hil": "hil.__main__"}
GENERATED_PAGES = {
    "params/REFERENCE.md": "rambler params --markdown",
    "params/FAULTS.md": "rambler params --faults",
    "params/MESSAGES.md": "rambler params --messages",
    "params/TEXTS.md": "rambler params --texts",
}
COLUMNS = "88"
NO_BREAK = "\u00a0"
LANGUAGES = {".py": "python", ".toml": "toml"}
FIGURE = re.compile(r"<!-- figure: (\w+) -->[^\n]*?<!-- end -->")
BLOCK = re.compile(r"^( *)<!-- (table|help|output|code): (.*?) -->\n.*?^ *<!-- end -->$", re.MULTILINE | re.DOTALL)
MARKER = re.compile(r"<!-- (?:figure|table|help|output|code): .*?-->")

Entry = Mapping[str, Any]


def format_number(value: float | str) -> str:
    """Format a number with three significant digits and narrow spaces between thousands; return a text unchanged."""
    if isinstance(value, str):
        return value
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
    integer, _, decimals = f"{value:,.{digits}f}".partition(".")
    return ".".join(filter(None, (integer.replace(",", "\u202f"), decimals.rstrip("0"))))


def figure_text(entry: Entry) -> str:
    """Return a figure with its unit; a short unit stays on the line of the number."""
    unit = entry["unit"]
    return f"{format_number(entry['value'])}{' ' if ' ' in unit else NO_BREAK}{unit}".rstrip()


def bench_table(entries: list[Entry]) -> str:
    """Return the table of a group of measurements."""
    aim_texts = {True: ": met", False: ": **missed**", None: ""}
    rows = [
        (
            entry.get("name", ""),
            figure_text(entry),
            "" if entry.get("bare") is None else f"{format_number(entry['bare'])} {entry['unit']}",
            "" if entry.get("ratio") is None else format_number(entry["ratio"]),
            entry.get("aim", "").replace("<=", "≤").replace(">=", "≥") + aim_texts[entry.get("met")],
            entry.get("others", ""),
            entry.get("note", ""),
        )
        for entry in entries
    ]
    return table(("figure", "measured", "bare limit", "ratio", "aim", "others", "note"), rows)


def paper_table(entries: list[Entry]) -> str:
    """Return the table of the values of the paper and of Rambler."""
    return table(
        ("quantity", "the paper", "Rambler"),
        [(entry["name"], entry["others"], figure_text(entry)) for entry in entries],
    )


def source_table(entries: Mapping[str, Entry]) -> str:
    """Return the table of measurements: command, date, commit, machine and number of figures."""
    counts: dict[tuple[str, ...], int] = {}
    for entry in entries.values():
        key = (f"`{entry['command']}`", entry["when"], entry["commit"], entry["machine"], entry.get("remark", ""))
        counts[key] = counts.get(key, 0) + 1
    rows = [(*key, str(count)) for key, count in counts.items()]
    return table(("command", "date", "commit", "machine", "remark", "figures"), rows)


def driver_table() -> str:
    """Return the table of drivers with their options."""
    return table(("section", "driver", "device", "option", "meaning", "default", "allowed"), list(_driver_rows()))


def _driver_rows() -> Iterator[tuple[str, ...]]:
    for section, drivers in SECTIONS.items():
        if section.endswith("_b"):  # the same drivers as for the first device
            continue
        for name, driver in drivers.items():
            cells = (f"`[{section}]`", f"`{name}`", driver.device)
            defaults, options = driver.options(), meanings(driver.options)
            for option, meaning in options.items():
                yield (*cells, f"`{option}`", meaning.text, _default(getattr(defaults, option)), _allowed(meaning))
                cells = ("", "", "")
            if not options:
                yield (*cells, "", "", "", "")


def _default(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, int | float) else value if isinstance(value, str) else ""


def _allowed(meaning: OptionMeaning) -> str:
    if meaning.choices:
        return ", ".join(meaning.choices)
    return f"{meaning.minimum:g} to {meaning.maximum:g}" if meaning.maximum < math.inf else ""


def sentence_table() -> str:
    """Return the table of NMEA 0183 sentences with their decoded values and users."""
    users = {
        "`[compass]`": {*nmea_compass.HEADING_SENTENCES, *nmea_compass.ADDITIONAL_SENTENCES},
        "`[position]`": {*nmea_position.FIX_SENTENCES, *nmea_position.OTHER_SENTENCES},
        "`[wind]`": nmea_wind.WIND_SENTENCES,
        "`[depth]`": nmea_depth.DEPTH_SENTENCES,
        "`[rudder_angle]`": {"RSA"},
        "`rambler-hil identify`": nmea_capture.USED_SENTENCES,
    }
    rows = []
    for kind, layout in sorted(SENTENCES.items()):
        names = [name for name, _ in (*layout.numbers, *layout.letters, *layout.derived)]
        used_by = ", ".join(user for user, kinds in users.items() if kind in kinds)
        rows.append((kind, ", ".join(f"`{name}`" for name in names) or "see below", used_by))
    rows.append(("VDM, VDO", "messages of AIS", "`[ais]`"))
    rows += [
        (", ".join(kind for kind in IGNORED if IGNORED[kind] == text), f"ignored: {text}", "")
        for text in dict.fromkeys(IGNORED.values())
    ]
    return table(("sentence", "values of `rambler decode nmea`", "used by"), rows)


def transducer_table() -> str:
    """Return the table of the transducers of XDR by type, unit and name."""
    rows = []
    for value, quantity in QUANTITIES.items():
        units = " ".join(unit for kind, unit in UNITS if kind == quantity.kind)
        names = ", ".join(f"`{name}`" if name else "none" for name in quantity.names)
        rows.append((quantity.kind, units, names, f"`{value}`", f"{quantity.low:g} to {quantity.high:g}"))
    return table(("type", "units", "names", "value", "range"), rows)


def table(titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table without its empty columns."""
    if not rows:
        raise ValueError("no rows")
    used_columns = [column for column in range(len(titles)) if any(row[column] for row in rows)]
    lines = [[line[column] for column in used_columns] for line in (titles, ("---",) * len(titles), *rows)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


@cache
def output_of(command: str) -> str:
    """Return the output of a command line; raise ValueError if there is none."""
    program, *words = command.split()
    main = importlib.import_module(PROGRAMS[program]).main
    text = io.StringIO()
    os.environ["COLUMNS"] = COLUMNS
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        main(words)
    if not text.getvalue():
        raise ValueError(f"{command}: no output")
    return text.getvalue()


def read_excerpt(argument: str) -> str:
    """Return a fenced block with a file or a part of it; for the syntax see `code` in the docstring of this module."""
    path, _, selector = argument.partition(" ")
    lines = (ROOT / path).read_text(encoding="utf-8").splitlines()
    if match := re.fullmatch(r"/(.*)/ /(.*)/", selector):
        start = next(number for number, line in enumerate(lines) if line.strip().startswith(match[1]))
        end = next(number for number, line in enumerate(lines[start:], start) if line.strip().startswith(match[2]))
        lines = lines[start : end + 1]
    elif selector:
        node: ast.AST = ast.parse("\n".join(lines))
        for name in selector.split("."):
            node = next(child for child in ast.iter_child_nodes(node) if name in _assigned_names(child))
        decorators = [decorator.lineno for decorator in getattr(node, "decorator_list", [])]
        lines = lines[min([node.lineno, *decorators]) - 1 : node.end_lineno]  # type: ignore[attr-defined]
    return fence(textwrap.dedent("\n".join(lines)), LANGUAGES[Path(path).suffix])


def _assigned_names(node: ast.AST) -> list[str]:
    targets = getattr(node, "targets", [getattr(node, "target", None)])
    return [getattr(node, "name", ""), *(target.id for target in targets if isinstance(target, ast.Name))]


def fence(text: str, language: str) -> str:
    """Return a block of code."""
    return f"```{language}\n{text.rstrip()}\n```"


class Pages:
    """Generates the parts of pages from a set of figures."""

    def __init__(self, figures: Mapping[str, Entry]) -> None:
        """Store the entries of docs/figures.json by name."""
        self._figures = figures
        self._makers: Mapping[str, Callable[[str], str]] = {
            "table": self._table,
            "help": lambda command: fence(output_of(f"{command} -h"), "text"),
            "output": output_of,
            "code": read_excerpt,
        }

    def fill(self, text: str) -> str:
        """Return a page with new generated parts; raise an error for a part that cannot be generated."""
        if invalid := re.search(r"^ *<!-- figure:.*", text, re.MULTILINE):
            raise ValueError(f"a figure begins a line, which Markdown takes for HTML: {invalid[0]}")
        filled, figures = FIGURE.subn(self._figure, text)
        filled, blocks = BLOCK.subn(self._block, filled)
        if figures + blocks != len(MARKER.findall(text)):
            raise ValueError("a generated part has no end, or shares its line with text")
        return filled

    def _figure(self, match: re.Match[str]) -> str:
        return f"<!-- figure: {match[1]} -->{figure_text(self._figures[match[1]])}<!-- end -->"

    def _block(self, match: re.Match[str]) -> str:
        indent, kind, argument = match.groups()
        text = f"<!-- {kind}: {argument} -->\n\n{self._makers[kind](argument).strip()}\n\n<!-- end -->"
        return textwrap.indent(text, indent)

    def _table(self, argument: str) -> str:
        kind, _, prefix = argument.partition(" ")
        makers = {"drivers": driver_table, "sentences": sentence_table, "transducers": transducer_table}
        if kind in makers:
            return makers[kind]()
        if kind == "sources":
            return source_table(self._figures)
        entries = [entry for name, entry in self._figures.items() if name.startswith(f"{prefix or kind}_")]
        return {"bench": bench_table, "reproduce": paper_table}[kind](entries)


def expected_pages() -> Iterator[tuple[Path, str]]:
    """Yield each page with its up-to-date text."""
    pages = Pages(json.loads((ROOT / "docs/figures.json").read_text(encoding="utf-8")))
    for name, command in GENERATED_PAGES.items():
        yield ROOT / name, output_of(command)
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        if "_build" in path.parts:
            continue
        try:
            yield path, pages.fill(path.read_text(encoding="utf-8"))
        except (KeyError, ValueError, OSError, StopIteration, ImportError) as error:
            raise SystemExit(f"{path.relative_to(ROOT)}: {error!r}") from error


def main() -> int:
    """Write the pages, or print the differences."""
    parser = argparse.ArgumentParser(description="write the generated parts of the Markdown pages")
    parser.add_argument("--check", action="store_true", help="write nothing, exit with 1 if a page is out of date")
    check = parser.parse_args().check
    changed = []
    for path, text in expected_pages():
        old = path.read_text(encoding="utf-8") if path.exists() else ""
        if text == old or (check and text.split() == old.split()):  # argparse breaks lines as its Python does
            continue
        name = path.relative_to(ROOT).as_posix()
        changed.append(name)
        if check:
            sys.stdout.writelines(difflib.unified_diff(old.splitlines(True), text.splitlines(True), name, name, n=1))
        else:
            path.write_text(text, encoding="utf-8")
    if changed:
        result = "out of date, run `make pages`" if check else "written"
        sys.stdout.write(f"{result}: {', '.join(changed)}\n")
    return int(check and bool(changed))


if __name__ == "__main__":
    sys.exit(main())
