"""A directive that writes the table of drivers and their options from the registry, while the pages are built."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

from firmware_py.common.options import OptionMeaning, meanings
from firmware_py.devices import SECTIONS

HEAD = ("section", "driver", "device", "option", "what it says", "default", "allowed")


def rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each option of each driver, one without an option for a driver that has none."""
    for section, drivers in SECTIONS.items():
        if section.endswith("_b"):  # the same as of the first
            continue
        for name, driver in drivers.items():
            place = (f"`[{section}]`", f"`{name}`", driver.device)
            defaults = {row.name: row.default for row in dataclasses.fields(driver.options)}
            options = meanings(driver.options)
            for option, meaning in options.items():
                yield (*place, f"`{option}`", meaning.text, _default(defaults[option]), _allowed(meaning))
                place = ("", "", "")
            if not options:
                yield (*place, "", "", "", "")


def _default(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:g}" if isinstance(value, int | float) else ""


def _allowed(meaning: OptionMeaning) -> str:
    if meaning.choices:
        return ", ".join(meaning.choices)
    return f"{meaning.minimum:g} to {meaning.maximum:g}" if meaning.maximum < float("inf") else ""


def markdown() -> str:
    """Return the table."""
    lines = (HEAD, ("---",) * len(HEAD), *rows())
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


class DriverTable(Directive):
    """The table, as part of the page."""

    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Read it as if it stood in the page."""
        table = nodes.container()
        self.state.nested_parse(StringList(markdown().splitlines(), "devices.py"), self.content_offset, table)
        return table.children


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the directive."""
    app.add_directive("driver-table", DriverTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
