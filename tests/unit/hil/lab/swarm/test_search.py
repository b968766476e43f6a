"""The search as a whole: what it promises whatever the objective."""

import os
import pickle
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.lab.compiled import compiled
from hil.lab.swarm import CompiledObjective, SettingsError, SwarmSettings, minimise
from support.paths import ROOT

QUICK = SwarmSettings(fish=8, iterations=12, tries=3, seed=5)
LOW, HIGH = (-2.0, 0.0, 10.0), (3.0, 1e-3, 1e4)
VARIANTS = [
    replace(QUICK, strategy=strategy, prey=prey) for strategy in ("optimal", "progress") for prey in ("best", "first")
]


def bowl(points):
    unit = (points - LOW) / np.subtract(HIGH, LOW)
    x, y, z = unit[:, 0] - 0.3, unit[:, 1] - 0.8, unit[:, 2] - 0.5
    return x * x + y * y + z * z


@compiled
def bowl_of_one(point, low, high):
    total = 0.0
    for k in range(point.size):
        way = (point[k] - low[k]) / (high[k] - low[k]) - (0.3, 0.8, 0.5)[k]
        total += way * way
    return total


@compiled
def bowl_of_many(points, values, low, high):
    for number in range(points.shape[0]):
        values[number] = bowl_of_one(points[number], low, high)


DATA = (np.array(LOW), np.array(HIGH))


def same(one, other):
    return pickle.dumps(one) == pickle.dumps(other)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_seed_determines_the_result(variant):
    first = minimise(bowl, LOW, HIGH, variant)
    assert same(first, minimise(bowl, LOW, HIGH, variant))
    assert not np.array_equal(first.best, minimise(bowl, LOW, HIGH, replace(variant, seed=6)).best)


@pytest.mark.proof  # each process compiles the swarm around such an objective, for 16 s
def test_the_compiled_swarm_is_the_batch_swarm_to_the_last_bit():
    for function, many in ((bowl_of_one, False), (bowl_of_many, True)):
        objective = CompiledObjective(function, DATA, batch=many)
        for variant in VARIANTS:
            assert same(minimise(bowl, LOW, HIGH, variant), minimise(objective, LOW, HIGH, variant))
        for workers in (2, 3, 50):
            assert same(minimise(bowl, LOW, HIGH, QUICK), minimise(objective, LOW, HIGH, QUICK, workers=workers))
        ended = minimise(objective, LOW, HIGH, QUICK, lambda progress: progress.iteration == 3)
        assert (ended.iterations, ended.stopped_by) == (3, "callback")


@pytest.mark.parametrize("workers", [2, 3, 50])
def test_workers_change_nothing(workers):
    assert same(minimise(bowl, LOW, HIGH, QUICK), minimise(bowl, LOW, HIGH, QUICK, workers=workers))


@pytest.mark.parametrize("workers", [0, 257, 1.5])
def test_an_invalid_number_of_workers_is_refused(workers):
    with pytest.raises(SettingsError, match="workers"):
        minimise(bowl, LOW, HIGH, QUICK, workers=workers)


def test_a_callback_gets_every_iteration_and_changes_nothing():
    reports = []
    variant = replace(QUICK, iterations=40)
    with_callback = minimise(bowl, LOW, HIGH, variant, reports.append)
    assert same(with_callback, minimise(bowl, LOW, HIGH, variant))
    assert [progress.iteration for progress in reports] == list(range(1, 41))
    assert [progress.evaluations for progress in reports] == with_callback.history.evaluations[1:].tolist()
    assert reports[-1].best_value == with_callback.best_value
    np.testing.assert_array_equal(reports[-1].best, with_callback.best)


def test_a_callback_ends_the_search():
    result = minimise(bowl, LOW, HIGH, QUICK, lambda progress: progress.iteration == 3)
    assert (result.iterations, result.stopped_by) == (3, "callback")
    assert len(result.history.best_value) == 4


PLAIN = """
import sys, pickle, numpy as np
sys.path[:0] = {folders!r}
from test_search import LOW, HIGH, VARIANTS, bowl
from hil.lab.swarm import minimise
sys.stdout.buffer.write(pickle.dumps([minimise(bowl, LOW, HIGH, variant) for variant in VARIANTS]))
"""


def test_the_compiled_swarm_is_its_own_source_run_plain_to_the_last_bit():
    plain = subprocess.run(
        [sys.executable, "-c", PLAIN.format(folders=[str(Path(__file__).parent), str(ROOT / "tests")])],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=True,
        capture_output=True,
    ).stdout
    assert plain == pickle.dumps([minimise(bowl, LOW, HIGH, variant) for variant in VARIANTS])


CHANGES = [lambda y: y - 1e6, lambda y: -1.0 / (1.0 + y), lambda y: np.exp(0.01 * y), lambda y: 1e250 * (y - 1000.0)]


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("variant", VARIANTS)
def test_only_the_order_of_values_matters_not_their_sign_or_scale(variant, change):
    """Whether 1/J is maximised, J is minimised or something is added to it: the fish swim alike."""

    # Whole numbers, so that no two different values become one.
    def steps(points):
        return np.floor(1000.0 * bowl(points))

    plain = minimise(steps, LOW, HIGH, variant)
    changed = minimise(lambda points: change(steps(points)), LOW, HIGH, variant)
    assert plain.best.tobytes() == changed.best.tobytes()
    np.testing.assert_array_equal(plain.history.moves, changed.history.moves)


class Watch:
    """An objective that remembers what it was asked, and answers what it is reports to."""

    def __init__(self, answer):
        self.points = []
        self.answer = answer

    def __call__(self, points):
        self.points.append(points)
        return self.answer(points)


ends = st.floats(-1e300, 1e300)
boxes = st.lists(st.tuples(ends, ends), min_size=1, max_size=4).map(
    lambda pairs: [sorted(pair) for pair in pairs if pair[0] != pair[1]] or [[0.0, 5e-324]]
)


@given(boxes, st.sampled_from(VARIANTS), st.integers(0, 2**64 - 1))
def test_every_point_is_within_any_box(box, variant, seed):
    low, high = np.array(box).T
    watch = Watch(lambda points: np.sin(points[:, 0]))
    result = minimise(watch, low, high, replace(variant, seed=seed))
    points = np.vstack(watch.points)
    assert np.all((points >= low) & (points <= high))
    assert np.all((result.best >= low) & (result.best <= high))
    assert result.evaluations == len(points)
    assert result.best_value == np.min(np.sin(points[:, 0]))


@given(st.sampled_from(VARIANTS), st.integers(0, 1000), st.lists(st.floats(), min_size=1, max_size=5))
def test_any_values_are_accepted(variant, seed, answers):
    """NaN, both infinities, subnormals, plateaus."""
    watch = Watch(lambda points: np.resize(answers, len(points)))
    result = minimise(watch, LOW, HIGH, replace(variant, seed=seed))
    given_values = np.resize(answers, max(len(points) for points in watch.points))
    assert result.best_value == np.min(np.where(np.isnan(given_values), np.inf, given_values))
    assert np.all(np.diff(result.history.evaluations) >= QUICK.fish)
    assert np.all(result.history.moves.sum(axis=1)[1:] == QUICK.fish)
    assert np.all((result.best >= LOW) & (result.best <= HIGH))


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_history_is_the_searchs(variant):
    watch = Watch(bowl)
    result = minimise(watch, LOW, HIGH, variant)
    history = result.history
    assert (result.iterations, result.stopped_by, result.seed) == (12, "iterations", 5)
    assert len(history.best_value) == len(history.vision) == len(history.moves) == 13
    assert np.all(np.diff(history.best_value) <= 0.0)
    assert history.best_value[-1] == result.best_value == bowl(result.best[None])[0]
    assert np.all(history.median_value >= history.best_value)
    assert history.evaluations[0] == variant.fish
    assert history.evaluations[-1] == result.evaluations == sum(len(points) for points in watch.points)
    np.testing.assert_allclose(history.vision, variant.vision * variant.shrink ** (np.arange(13) / 12))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("most", [8, 9, 60, 500])
def test_the_evaluations_are_used_to_the_last(variant, most):
    variant = replace(variant, iterations=1000, max_evaluations=most)
    watch = Watch(bowl)
    result = minimise(watch, LOW, HIGH, variant)
    points = np.vstack(watch.points)
    assert result.stopped_by == "evaluations"
    assert len(points) == result.evaluations == most
    assert result.best_value == np.min(bowl(points))


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_limit_of_evaluations_gets_as_fine_a_search_as_iterations_do(variant):
    result = minimise(bowl, LOW, HIGH, replace(variant, iterations=1000, max_evaluations=500))
    assert result.history.vision[-1] < variant.vision * variant.shrink**0.8


def test_the_plain_algorithm_keeps_its_vision():
    assert set(minimise(bowl, LOW, HIGH, replace(QUICK, shrink=1.0)).history.vision) == {QUICK.vision}


def test_all_tries_of_the_whole_shoal_are_one_call():
    watch = Watch(bowl)
    minimise(watch, LOW, HIGH, replace(QUICK, iterations=1, strategy="optimal", prey="best"))
    start, looks, *moves = watch.points
    assert len(start) == QUICK.fish
    assert len(looks) >= QUICK.fish * QUICK.tries
    assert len(moves) <= 2


def test_start_places_are_used():
    watch = Watch(bowl)
    start = [(0.5, 5e-4, 4000.0), HIGH]
    minimise(watch, LOW, HIGH, QUICK, start=start)
    np.testing.assert_allclose(watch.points[0][:2], start)
    minimise(watch, LOW, HIGH, QUICK, start=start[0])


def test_the_objective_may_change_its_arguments():
    def spoiling(points):
        values = bowl(points)
        points[:] = np.nan
        return values

    assert same(minimise(spoiling, LOW, HIGH, QUICK), minimise(bowl, LOW, HIGH, QUICK))


@pytest.mark.proof
def test_memory_grows_by_the_history_alone():
    def peak(iterations):
        tracemalloc.start()
        result = minimise(bowl, LOW, HIGH, replace(QUICK, iterations=iterations))
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size, result.evaluations

    peak(10)
    (few, few_evaluations), (many, many_evaluations) = peak(50), peak(850)
    assert many_evaluations > 12 * few_evaluations
    row_bytes = 8 * (4 + 4)
    assert many - few < 800 * row_bytes * 2 + 20_000  # the history once, and its copy in the result


@pytest.mark.parametrize(
    ("low", "high", "remedy"),
    [
        ([], [], "give one low and one high"),
        ([0.0], [1.0, 2.0], "give one low and one high"),
        ([[0.0]], [[1.0]], "give one low and one high"),
        ([0.0, 1.0], [1.0, 1.0], "coordinate 1: low 1 is not below high 1"),
        ([0.0], [np.nan], "must be finite"),
        ([-np.inf], [0.0], "must be finite"),
        ([-1.7e308], [1.7e308], "bounds and their difference must be finite"),
    ],
)
def test_an_invalid_box_is_refused(low, high, remedy):
    with np.errstate(over="ignore"), pytest.raises(SettingsError, match=remedy):
        minimise(bowl, low, high)


@pytest.mark.parametrize("answer", [lambda points: 1.0, lambda points: points, lambda points: points[:-1, 0]])
def test_values_of_a_wrong_shape_are_refused(answer):
    with pytest.raises(SettingsError, match="one value for each"):
        minimise(answer, LOW, HIGH, QUICK)


@pytest.mark.parametrize("start", [[[0.0]], [[0.0] * 3] * 9, [(9.0, 0.0, 10.0)], [(np.nan, 0.0, 10.0)], [[[0.0] * 3]]])
def test_an_invalid_start_is_refused(start):
    with pytest.raises(SettingsError, match="start"):
        minimise(bowl, LOW, HIGH, QUICK, start=start)


def test_a_plain_function_is_not_a_compiled_objective():
    with pytest.raises(SettingsError, match="compiled by numba"):
        minimise(CompiledObjective(bowl), LOW, HIGH, QUICK)


def test_an_error_of_the_objective_comes_through():
    def broken(points):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        minimise(broken, LOW, HIGH, QUICK)
