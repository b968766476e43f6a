"""Parameter table: names, limits and the reference page."""

from firmware_py.cli.parameter_page import markdown
from firmware_py.common.parameter_row import to_single
from firmware_py.common.parameter_table import TABLE
from support.paths import ROOT


def test_reference_page_shows_the_table():
    assert markdown() == (ROOT / "params/REFERENCE.md").read_text(), "write it with make pages"


def test_names_are_short_unique_and_sorted():
    names = [row.name for row in TABLE]
    assert all(1 <= len(name) <= 16 and name.isascii() for name in names)
    assert names == sorted(set(names))


def test_default_and_limits_of_each_row_are_valid():
    for row in TABLE:
        assert row.check(row.default) == row.default
        assert [row.check(limit) for limit in (row.minimum, row.maximum)] == [
            to_single(row.minimum),
            to_single(row.maximum),
        ]


def test_counters_and_constants_are_read_only():
    read_only_rows = [row for row in TABLE if row.read_only]
    assert [row.name for row in read_only_rows] == ["ARMING_CHECK", "ARMING_SKIPCHK", "STAT_BOOTCNT"]
    assert all("Read-only." in line for line in markdown().splitlines() if line.startswith("| `STAT_BOOTCNT`"))
