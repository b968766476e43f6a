"""How the documentation shows measured figures."""

import importlib.util
import json
import sys

import pytest

from support.paths import ROOT

SOURCE = {"when": "2026-01-02", "commit": "abc1234", "machine": "a machine", "command": "a command"}


@pytest.fixture(scope="module")
def figures():
    spec = importlib.util.spec_from_file_location("docs_figures", ROOT / "docs/extensions/figures.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def shown(figures, tmp_path):
    """What pages may name when the file holds some entries."""

    def make(**entries):
        path = tmp_path / "figures.json"
        path.write_text(json.dumps({name: {**SOURCE, **entry} for name, entry in entries.items()}))
        return figures.substitutions(path)

    return make


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.018, "0.018"),
        (3.5, "3.5"),
        (1.0, "1"),
        (33.74, "33.7"),
        (561.4, "561"),
        (-2.3, "-2.3"),
        (49500.0, "49\u202f500"),
        (1221.0, "1\u202f221"),
        ("2.7 to 3.7", "2.7 to 3.7"),
    ],
)
def test_a_number_has_three_digits_that_mean_something(figures, value, text):
    assert figures.number(value) == text


def test_a_figure_is_shown_with_its_unit(shown):
    found = shown(a={"value": 1.25, "unit": "deg"}, b={"value": 3.0, "unit": ""})["figures"]
    assert str(found["a"]) == "1.25\u00a0deg"
    assert str(found["b"]) == "3"


def test_a_table_of_the_bench_tells_a_missed_aim_and_leaves_empty_columns_out(shown):
    entry = {"name": "CPU", "value": 3.5, "unit": "%", "aim": "<= 1.5 %", "met": False}
    table = shown(load_cpu=entry)["bench_tables"]["load"].splitlines()
    assert table[0] == "| figure | measured | aim |"
    assert table[2] == "| CPU | 3.5\u00a0% | ≤ 1.5 %: **missed** |"


def test_the_table_of_sources_counts_what_was_measured_together(shown):
    table = shown(a={"value": 1.0, "unit": "s"}, b={"value": 2.0, "unit": "s"})["figure_sources"].splitlines()
    assert table[2:] == ["| `a command` | 2026-01-02 | abc1234 | a machine | 2 |"]
