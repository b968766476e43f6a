"""The file of measured figures: what is merged, what stays, what is refused."""

import json
import math

import pytest

from hil.report.figure_file import COUNTED, entry, key_of, merge, origin

SOURCE = {"when": "2026-01-02", "commit": "abc1234", "machine": "a machine", "command": "a command"}


def read(path):
    return json.loads(path.read_text())


def test_a_name_is_made_of_words():
    assert key_of("trips", "PARAM_SET, p50") == "trips_param_set_p50"
    assert key_of("lateness", "10 Hz, p99.9") == "lateness_10_hz_p99_9"


def test_an_entry_holds_where_it_comes_from_and_leaves_out_what_is_absent():
    made = entry(1.5, "ms", SOURCE, bare=None, aim="", met=False, others="14")
    assert made == {"value": 1.5, "unit": "ms", "met": False, "others": "14", **SOURCE}
    assert "bare" not in entry(1.5, "ms", SOURCE, bare=math.nan)


def test_digits_that_no_measurement_has_are_left_out():
    assert entry(2.0 / 3.0, "ms", SOURCE, bare=1.0 / 3.0)["value"] == 0.666667


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match="no figure"):
        entry(value, "ms", SOURCE)


def test_a_file_is_made_and_fresh_figures_stand_together_behind_the_others(tmp_path):
    path = tmp_path / "figures.json"
    merge(path, {"b": entry(1.0, "s", SOURCE), "a": entry(2.0, "s", SOURCE)})
    merge(path, {"b": entry(3.0, "s", SOURCE)})
    assert [(name, kept["value"]) for name, kept in read(path).items()] == [("a", 2.0), ("b", 3.0)]


def test_of_several_cases_the_largest_is_shown(tmp_path):
    path = tmp_path / "figures.json"
    for case, value in (("seed 1", 0.4), ("seed 2", 0.9), ("seed 3", 0.1)):
        merge(path, {"worst": entry(value, "deg", SOURCE, cases={case: value})})
    assert read(path)["worst"]["value"] == 0.9
    assert len(read(path)["worst"]["cases"]) == 3


def test_cases_of_another_commit_are_forgotten(tmp_path):
    path = tmp_path / "figures.json"
    merge(path, {"worst": entry(0.9, "deg", SOURCE, cases={"seed 1": 0.9})})
    merge(path, {"worst": entry(0.4, "deg", {**SOURCE, "commit": "def5678"}, cases={"seed 2": 0.4})})
    assert read(path)["worst"]["cases"] == {"seed 2": 0.4}
    assert read(path)["worst"]["value"] == 0.4


@pytest.mark.parametrize(("unit", "kept"), [("ms", [1.0, 1.2, 2.0]), (COUNTED, [2.0])])
def test_repeats_are_added_but_for_those_of_what_is_counted(tmp_path, unit, kept):
    """Those of before a change of the program left room for what it had gained."""
    path = tmp_path / "figures.json"
    merge(path, {"a": entry(1.1, unit, SOURCE, repeats=[1.0, 1.2])})
    merge(path, {"a": entry(2.0, unit, SOURCE, repeats=[2.0])})
    assert read(path)["a"]["repeats"] == kept


def test_the_origin_names_day_commit_machine_and_command():
    found = origin("a command", "a machine")
    assert list(found) == ["when", "commit", "machine", "command"]
    assert all(found.values())
