"""What the bench compares the tools with does the same work; no figure is judged."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil.bench import first_use, hour, objective, swarm, zigzag
from hil.bench.setting import quick
from hil.bench.turns import Turns, in_turns
from hil.errors import HilError

LOG = zigzag.zigzag(20.0)


def points(count):
    low, high = np.array(zigzag.LOW), np.array(zigzag.HIGH)
    return low + np.random.default_rng(3).random((count, 3)) * (high - low)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 33])
def test_the_objective_of_many_fish_is_that_of_each_and_that_in_python(count):
    asked = points(count)
    many = zigzag.compiled_many(LOG)(asked)
    one, plain, careful = zigzag.compiled_one(LOG), zigzag.plain_one(LOG), zigzag.careful_one(LOG)
    assert many.tolist() == [one(point) for point in asked]
    # These do not count time in turning lags, so they round otherwise.
    assert many == pytest.approx([plain(point) for point in asked], rel=1e-9)
    assert many == pytest.approx([careful(point) for point in asked], rel=1e-9)


def test_the_objective_is_least_at_the_truth():
    values = zigzag.compiled_many(LOG)(np.vstack([[zigzag.TRUTH], points(50)]))
    assert np.argmin(values) == 0


@pytest.mark.skipif(objective.compiler() is None, reason="no C compiler here")
def test_the_objective_in_c_is_the_identifications_objective(tmp_path):
    loaded = objective.library(objective.compiler(), tmp_path)
    for fish in (1, 30):
        _, _, samples = objective.calls(loaded, fish)
        assert samples >= 1000


def test_an_objective_in_c_that_has_drifted_is_told():
    with pytest.raises(HilError, match="up to date"):
        objective.check_agreement(np.array([1.0, 2.0]), np.array([1.0, 2.1]))


def test_a_compiler_that_fails_is_told(tmp_path):
    with pytest.raises(HilError, match="does not compile"):
        objective.library("false", tmp_path)


def test_without_a_compiler_the_row_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(objective, "compiler", lambda: None)
    finding = objective.measure(replace(quick(tmp_path), pairs=1))
    assert [figure.bare for figure in finding.figures] == [None, None]
    assert [figure.met for figure in finding.figures] == [None, None]
    assert all(figure.value > 0.0 for figure in finding.figures)
    assert "no C compiler" in finding.notes[0]


def test_both_swarms_make_the_same_number_of_evaluations(monkeypatch):
    # Its import insists on being the first to choose how processes start.
    monkeypatch.setattr("multiprocessing.set_start_method", lambda *_method, **_force: None)
    pytest.importorskip("sko")
    calls = []

    def count(point):
        calls.append(point)
        return float(point[0])

    turns = swarm.beside(LOG, count, 900, 1, 2)
    made = swarm.ours(LOG, 900, 0, 1)[1] + swarm.ours(LOG, 900, 1, 1)[1]
    assert len(calls) == made
    assert all(seconds > 0.0 for seconds in (*turns.ours, *turns.theirs))
    assert np.all((np.array(zigzag.LOW) <= calls) & (calls <= np.array(zigzag.HIGH)))


def test_the_swarms_figures_have_their_aims():
    figures = swarm.figures_of(
        alone=Turns((1e-6,), (16e-6,)),
        shared=Turns((2e-6,), (16e-6,)),
        plain=Turns((1e-6,), (1.1e-3,)),
        careful=Turns((1e-6,), (5e-4,)),
        workers=2,
    )
    assert [figure.met for figure in figures] == [None, True, None, True, None]
    assert [figure.unit for figure in figures] == ["us", "times", "times", "times", "times"]
    assert (figures[0].value, figures[0].bare) == (pytest.approx(1.0), pytest.approx(16.0))


def test_without_scikit_opt_memory_is_told_all_the_same(monkeypatch, tmp_path):
    def absent(*_arguments):
        raise ModuleNotFoundError

    monkeypatch.setattr(swarm, "theirs", absent)
    finding = swarm.measure(replace(quick(tmp_path), fish_evaluations=1000))
    assert [figure.unit for figure in finding.figures] == ["MiB"]
    assert "pip install scikit-opt" in finding.notes[-1]


def test_an_hours_figures_have_their_aim():
    passed, used = hour.figures_of([1.9, 9.0, 1.8], [1.5, 1.6, 1.7])
    assert (passed.value, passed.met) == (1.9, True)
    assert (used.value, used.met) == (1.6, None)


def test_ratios_are_those_of_neighbours():
    order = []

    def run(name, seconds):
        return lambda number: order.append((name, number)) or seconds[number]

    # In the second pair the machine was ten times as slow, for both.
    turns = in_turns(run("ours", [1.0, 10.0, 1.1]), run("theirs", [2.0, 20.0, 2.0]), 3)
    assert order == [("ours", 0), ("theirs", 0), ("ours", 1), ("theirs", 1), ("ours", 2), ("theirs", 2)]
    assert turns.ratio == 0.5
    assert turns.ratios == pytest.approx([0.5, 0.5, 0.55])
    assert turns.figure("x", "s", 1.0, 0.5).met
    assert turns.times_faster("x", 2.0).met
    assert turns.spread_text().startswith("1.82 to 2 times in 3 pairs")
    assert turns.quartiles == pytest.approx((0.5, 0.525))


def test_uses_are_told_with_the_longest_silence():
    shown, again, piped = (
        first_use.Use(30.0, 1.0, "compiling"),
        first_use.Use(3.0, 0.1, ""),
        first_use.Use(29.0, 29.0, ""),
    )
    figures = first_use.figures_of(shown, again, piped)
    assert [figure.met for figure in figures] == [None, True, None]
    assert figures[0].ratio == 10.0
    assert "said nothing" in first_use.notes_of(piped)[0]
    assert "9 characters" in first_use.notes_of(shown)[0]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_use_is_heard_to_its_end(tmp_path, terminal):
    heard = first_use.use(["similarity", "--speeds", "0.4"], tmp_path, terminal=terminal)
    assert heard.said == ""
    assert 0.0 < heard.silence_s <= heard.seconds
    with pytest.raises(HilError, match=r"ended with 2: .*speeds"):
        first_use.use(["similarity", "--speeds", "nonsense"], tmp_path, terminal=terminal)


def test_the_log_of_the_first_use_is_a_manoeuvre_file(tmp_path):
    first_use.manoeuvre(tmp_path / "log.csv", objective.hour())
    lines = (tmp_path / "log.csv").read_text().splitlines()
    assert lines[0] == first_use.COLUMNS
    assert len(lines) == 1 + first_use.ROWS
    assert all(math.isfinite(float(cell)) for cell in lines[-1].rstrip(",").split(","))
