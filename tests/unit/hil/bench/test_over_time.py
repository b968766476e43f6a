"""What is kept of a figure's repeats, and when a ratio has worsened by more than they explain."""

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


def finding(*values, bare=1.0, **more):
    return [Finding("Load", (Figure("processor", "ms", value, bare, **more),)) for value in values]


def verdict(now, repeats=REPEATS, **more):
    baseline = over_time.baseline_of({"load_processor": {"value": 2.0, "repeats": list(repeats)}})
    (only,) = over_time.compare(baseline, {"load": finding(now, **more)[0]})
    return only


def test_median_of_repeats():
    repeats = [*finding(8.0, bare=2.0), *finding(1.0), *finding(9.0, bare=3.0)]
    (figure,) = over_time.median(repeats).figures
    assert (figure.value, figure.bare, figure.ratio) == (9.0, 3.0, 3.0)
    assert figure.repeats == (4.0, 1.0, 3.0)
    (alone,) = over_time.median(finding(2.0)).figures
    assert alone.repeats == ()


def test_worse_beyond_the_scatter():
    assert not verdict(2.0).worse
    assert not verdict(1.0).worse
    assert not verdict(2.1).worse
    assert verdict(3.0).worse
    assert verdict(math.nan).worse
    assert "2.00x before, 3.00x now (at most" in verdict(3.0).text
    assert "WORSE" in verdict(3.0).text


def test_limit_grows_with_the_scatter():
    steady, restless = verdict(2.0), verdict(2.0, (1.0, 3.0, 2.0, 1.5, 2.5, 2.0, 2.2))
    assert steady.allowed < 2.5 < restless.allowed


def test_tolerance_of_counts():
    baseline = over_time.baseline_of({"work_a_tick": {"value": 2.0, "repeats": [2.1] * 7}})

    def now(value, unit=COUNTED):
        (only,) = over_time.compare(baseline, {"work": Finding("Work", (Figure("a tick", unit, value, 1.0),))})
        return only

    assert [now(value).worse for value in (2.0, 2.1, 2.13, 2.2, 1.15 * 2.1)] == [False, False, False, True, True]
    assert (now(2.1).counted, now(2.1, "ms").counted) == (True, False)


def test_lower_is_worse():
    baseline = over_time.baseline_of({"swarm_faster": {"value": 20.0, "repeats": [20.0, 21.0, 19.0, 20.5, 19.5]}})

    def now(value):
        found = Finding("Swarm", (Figure("faster", TIMES, value, minimum=15.0),))
        (only,) = over_time.compare(baseline, {"swarm": found})
        return only

    assert [now(value).worse for value in (40.0, 20.0, 19.0, 10.0)] == [False, False, False, True]
    assert "at least" in now(10.0).text


@pytest.mark.proof
def test_false_alarm_rate():
    numbers = random.Random(1)

    def draw():
        return math.exp(numbers.gauss(0.0, 0.1))

    alarms = sum(verdict(draw(), [draw() for _ in range(7)]).worse for _ in range(4000))
    # The share that is meant is 1 %; four standard deviations of the count beside it.
    assert 15 <= alarms <= 65


@pytest.mark.parametrize("repeats", [None, [], [1.0] * 4, [1.0, 2.0, 3.0, 4.0, "5"], [1.0, 2.0, 3.0, 4.0, 0.0], 7.0])
def test_invalid_baselines(repeats):
    assert over_time.baseline_of({"load_processor": {"value": 2.0, "repeats": repeats}, "other": 3.0}) == {}


def test_measurements_of_the_baseline():
    baseline = over_time.baseline_of({"first_use_time": {"repeats": list(REPEATS)}, "load_processor": {"value": 2.0}})
    assert over_time.measured_in(baseline, ("load", "first-use")) == ["first-use"]
    with pytest.raises(UsageError, match="--repeat 7 --figures"):
        over_time.measured_in(baseline, ("load",))


def test_repeats_in_the_figure_file(tmp_path):
    path = tmp_path / "figures.json"
    found = {"load": over_time.median(finding(*REPEATS))}
    merge(path, as_entries(found, origin("rambler-hil bench --repeat 7", "here")))
    assert json.loads(path.read_text())["load_processor"]["value"] == 2.0
    assert over_time.baseline_of(read("--against", path)) == {"load_processor": REPEATS}


def test_repeats_are_appended_and_limited(tmp_path):
    path = tmp_path / "figures.json"
    for value in (1.0, 2.0, 3.0):
        found = {"load": over_time.median(finding(*(value,) * 7))}
        merge(path, as_entries(found, origin("rambler-hil bench --repeat 7", "here")))
    entry = json.loads(path.read_text())["load_processor"]
    assert (entry["value"], entry["repeats"]) == (3.0, [2.0] * 7 + [3.0] * 7)


def test_missing_file(tmp_path):
    with pytest.raises(UsageError, match=r"--against .*none\.json cannot be read"):
        read("--against", tmp_path / "none.json")
