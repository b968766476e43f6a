"""Entries of the file of measured figures, and their merging."""

import json
import math

import pytest

from hil.report.figure_file import COUNTED, entry, key_of, merge, origin

SOURCE = {"when": "2026-01-02", "commit": "abc1234", "machine": "a machine", "command": "a command"}


def read(path):
    return json.loads(path.read_text())


@pytest.mark.parametrize(
    ("words", "key"),
    [(("trips", "PARAM_SET, p50"), "trips_param_set_p50"), (("lateness", "10 Hz, p99.9"), "lateness_10_hz_p99_9")],
)
def test_key_has_lower_case_letters_digits_and_underscores(words, key):
    assert key_of(*words) == key


def test_entry_contains_rounded_value_and_valid_details():
    details = {"bare": None, "aim": "", "met": False, "others": "14"}
    assert entry(2.0 / 3.0, "ms", SOURCE, **details) == {
        "value": 0.666667, "unit": "ms", "met": False, "others": "14", **SOURCE
    }  # fmt: skip
    assert "bare" not in entry(1.5, "ms", SOURCE, bare=math.nan)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_value_that_is_not_finite_is_rejected(value):
    with pytest.raises(ValueError, match="not a finite"):
        entry(value, "ms", SOURCE)


def test_new_figures_are_appended_together(tmp_path):
    path = tmp_path / "figures.json"
    merge(path, {"b": entry(1.0, "s", SOURCE), "a": entry(2.0, "s", SOURCE)})
    merge(path, {"b": entry(3.0, "s", SOURCE)})
    assert [(name, figure["value"]) for name, figure in read(path).items()] == [("a", 2.0), ("b", 3.0)]


def test_value_is_the_largest_case(tmp_path):
    path = tmp_path / "figures.json"
    for case, value in (("seed 1", 0.4), ("seed 2", 0.9), ("seed 3", 0.1)):
        merge(path, {"worst": entry(value, "deg", SOURCE, cases={case: value})})
    assert read(path)["worst"]["value"] == 0.9
    assert len(read(path)["worst"]["cases"]) == 3


def test_cases_of_another_commit_are_replaced(tmp_path):
    path = tmp_path / "figures.json"
    merge(path, {"worst": entry(0.9, "deg", SOURCE, cases={"seed 1": 0.9})})
    merge(path, {"worst": entry(0.4, "deg", {**SOURCE, "commit": "def5678"}, cases={"seed 2": 0.4})})
    assert read(path)["worst"]["cases"] == {"seed 2": 0.4}
    assert read(path)["worst"]["value"] == 0.4


@pytest.mark.parametrize(("unit", "repeats"), [("ms", [1.0, 1.2, 2.0]), (COUNTED, [2.0])])
def test_repeats_are_appended_except_those_of_counts(tmp_path, unit, repeats):
    path = tmp_path / "figures.json"
    merge(path, {"a": entry(1.1, unit, SOURCE, repeats=[1.0, 1.2])})
    merge(path, {"a": entry(2.0, unit, SOURCE, repeats=[2.0])})
    assert read(path)["a"]["repeats"] == repeats


def test_origin_has_date_commit_machine_and_command():
    source = origin("a command", "a machine")
    assert list(source) == ["when", "commit", "machine", "command"]
    assert all(source.values())
