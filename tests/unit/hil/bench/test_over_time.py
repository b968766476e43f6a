"""Medians and repeats of figures, and comparison with a baseline."""

import json
import math
import random

import pytest

from hil.bench import over_time
from hil.bench.figure import TIMES, Figure, Finding
from hil.bench.report import as_entries
from hil.errors import UsageError
from hil.report.figure_file import COUNTED, merge, origin, read

REPEATS = (1.9, 2.1, 2.0, 2.05, 1.95, 2.0, 2.02)


def finding(*values, bare=1.0, **options):
    return [Finding("Load", (Figure("processor", "ms", value, bare, **options),)) for value in values]


def verdict(now, repeats=REPEATS, **options):
    baseline = over_time.baseline_of({"load_processor": {"value": 2.0, "repeats": list(repeats)}})
    (compared,) = over_time.compare(baseline, {"load": finding(now, **options)[0]})
    return compared


def test_figure_of_repeats_is_the_median():
    repeats = [*finding(8.0, bare=2.0), *finding(1.0), *finding(9.0, bare=3.0)]
    (figure,) = over_time.median(repeats).figures
    assert (figure.value, figure.bare, figure.ratio) == (9.0, 3.0, 3.0)
    assert figure.repeats == (4.0, 1.0, 3.0)
    (single,) = over_time.median(finding(2.0)).figures
    assert single.repeats == ()


def test_value_beyond_the_scatter_is_worse():
    assert [verdict(now).is_worse for now in (1.0, 2.0, 2.1, 3.0, math.nan)] == [False, False, False, True, True]
    assert "2.00x before, 3.00x now (at most" in verdict(3.0).text
    assert "WORSE" in verdict(3.0).text


def test_limit_grows_with_the_scatter():
    precise, scattered = verdict(2.0), verdict(2.0, (1.0, 3.0, 2.0, 1.5, 2.5, 2.0, 2.2))
    assert precise.limit < 2.5 < scattered.limit


def test_count_within_the_tolerance_is_not_worse():
    baseline = over_time.baseline_of({"work_a_tick": {"value": 2.0, "repeats": [2.1] * 7}})

    def now(value, unit=COUNTED):
        (compared,) = over_time.compare(baseline, {"work": Finding("Work", (Figure("a tick", unit, value, 1.0),))})
        return compared

    assert [now(value).is_worse for value in (2.0, 2.1, 2.13, 2.2, 1.15 * 2.1)] == [False, False, False, True, True]
    assert (now(2.1).is_count, now(2.1, "ms").is_count) == (True, False)


def test_lower_value_is_worse_if_more_is_better():
    baseline = over_time.baseline_of({"swarm_faster": {"value": 20.0, "repeats": [20.0, 21.0, 19.0, 20.5, 19.5]}})

    def now(value):
        result = Finding("Swarm", (Figure("faster", TIMES, value, minimum=15.0),))
        (compared,) = over_time.compare(baseline, {"swarm": result})
        return compared

    assert [now(value).is_worse for value in (40.0, 20.0, 19.0, 10.0)] == [False, False, False, True]
    assert "at least" in now(10.0).text


@pytest.mark.proof
def test_false_alarms_have_their_rate():
    rng = random.Random(1)

    def draw():
        return math.exp(rng.gauss(0.0, 0.1))

    alarms = sum(verdict(draw(), [draw() for _ in range(7)]).is_worse for _ in range(4000))
    # 1 % of 4000, within four standard deviations.
    assert 15 <= alarms <= 65


@pytest.mark.parametrize("repeats", [None, [], [1.0] * 4, [1.0, 2.0, 3.0, 4.0, "5"], [1.0, 2.0, 3.0, 4.0, 0.0], 7.0])
def test_invalid_repeats_are_no_baseline(repeats):
    assert over_time.baseline_of({"load_processor": {"value": 2.0, "repeats": repeats}, "other": 3.0}) == {}


def test_measurements_are_those_in_the_baseline():
    baseline = over_time.baseline_of({"first_use_time": {"repeats": list(REPEATS)}, "load_processor": {"value": 2.0}})
    assert over_time.measurements_in(baseline, ("load", "first-use")) == ["first-use"]
    with pytest.raises(UsageError, match="--repeat 7 --figures"):
        over_time.measurements_in(baseline, ("load",))


def test_repeats_are_stored_in_the_figure_file(tmp_path):
    path = tmp_path / "figures.json"
    findings = {"load": over_time.median(finding(*REPEATS))}
    merge(path, as_entries(findings, origin("rambler-hil bench --repeat 7", "here")))
    assert json.loads(path.read_text())["load_processor"]["value"] == 2.0
    assert over_time.baseline_of(read("--against", path)) == {"load_processor": REPEATS}


def test_repeats_are_appended_and_limited(tmp_path):
    path = tmp_path / "figures.json"
    for value in (1.0, 2.0, 3.0):
        findings = {"load": over_time.median(finding(*(value,) * 7))}
        merge(path, as_entries(findings, origin("rambler-hil bench --repeat 7", "here")))
    entry = json.loads(path.read_text())["load_processor"]
    assert (entry["value"], entry["repeats"]) == (3.0, [2.0] * 7 + [3.0] * 7)


def test_missing_file_raises_an_error(tmp_path):
    with pytest.raises(UsageError, match=r"--against .*missing\.json cannot be read"):
        read("--against", tmp_path / "missing.json")
