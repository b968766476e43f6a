"""The table and the JSON of the bench."""

import json
import math

import pytest

from hil.bench.figure import Figure, Finding
from hil.bench.report import as_json, number, table

FINDINGS = (
    Finding(
        "Speed",
        (
            Figure("first", "ms", 1.5, 0.5, maximum=2.0, peer="another 14"),
            Figure("second and longer", "us", 700.0, 100.0, maximum_ratio=5.0),
        ),
        ("the method",),
    ),
    Finding("Weight", (Figure("third", "MiB", 30.0),)),
)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.04406, "0.0441"), (2.7956, "2.80"), (29.14, "29.1"), (934.58, "935"), (12345.6, "12346"),
     (-2.5, "-2.50"), (None, "-"), (math.nan, "-"), (math.inf, "-")],
)  # fmt: skip
def test_number_has_three_digits(value, text):
    assert number(value) == text


def test_table_contains_values_ratios_targets_and_notes():
    lines = table(FINDINGS).splitlines()
    first, second, third = (next(line for line in lines if name in line) for name in ("first", "second", "third"))
    assert " ".join(first.split()) == "first 1.50 ms 0.500 ms 3.00x <= 2 ms met another 14"
    assert " ".join(second.split()) == "second and longer 700 us 100 us 7.00x <= 5x bare MISSED"
    assert " ".join(third.split()) == "third 30.0 MiB - -"
    assert lines.index("Speed") < lines.index(first) < lines.index("    the method") < lines.index("Weight")


def test_columns_of_the_table_are_aligned():
    lines = table(FINDINGS).splitlines()
    first, second = (next(line for line in lines if name in line) for name in ("first", "second"))
    assert first.index(" ms") == second.index(" us")
    assert first.index("3.00x") == second.index("7.00x")


def test_json_contains_titles_notes_and_figures():
    content = json.loads(as_json(FINDINGS, {"cores": 2}))
    assert content["circumstances"] == {"cores": 2}
    speed, weight = content["findings"]
    assert (speed["title"], speed["notes"]) == ("Speed", ["the method"])
    assert [(row["name"], row["ratio"], row["met"]) for row in speed["figures"]] == [
        ("first", 3.0, True),
        ("second and longer", 7.0, False),
    ]
    assert weight["figures"][0]["bare"] is None
    assert weight["figures"][0]["met"] is None


def test_nan_is_null_in_json():
    text = as_json([Finding("Nothing", (Figure("x", "s", math.nan, math.inf),))], {})
    assert json.loads(text, parse_constant=pytest.fail)["findings"][0]["figures"][0]["value"] is None


def test_table_marks_a_missed_lower_limit():
    text = table([Finding("speed", (Figure("faster", "times", 14.0, minimum=15.0),))])
    assert ">= 15 times" in text
    assert "MISSED" in text
