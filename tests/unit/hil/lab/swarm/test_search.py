"""The search with the fish swarm: determinism, limits, history and errors."""

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
        offset = (point[k] - low[k]) / (high[k] - low[k]) - (0.3, 0.8, 0.5)[k]
        total += offset * offset
    return total


@compiled
def bowl_of_many(points, values, low, high):
    for number in range(points.shape[0]):
        values[number] = bowl_of_one(points[number], low, high)


DATA = (np.array(LOW), np.array(HIGH))


def is_identical(first_result, second_result):
    return pickle.dumps(first_result) == pickle.dumps(second_result)


@pytest.mark.parametrize("variant", VARIANTS)
def test_seed_determines_the_result(variant):
    first = minimise(bowl, LOW, HIGH, variant)
    assert is_identical(first, minimise(bowl, LOW, HIGH, variant))
    assert not np.array_equal(first.best, minimise(bowl, LOW, HIGH, replace(variant, seed=6)).best)


@pytest.mark.proof  # each process compiles the swarm with such an objective, for 16 s
def test_compiled_objective_gives_the_same_result_to_the_last_bit():
    for function, many in ((bowl_of_one, False), (bowl_of_many, True)):
        objective = CompiledObjective(function, DATA, batch=many)
        for variant in VARIANTS:
            assert is_identical(minimise(bowl, LOW, HIGH, variant), minimise(objective, LOW, HIGH, variant))
        for workers in (2, 3, 50):
            assert is_identical(
                minimise(bowl, LOW, HIGH, QUICK), minimise(objective, LOW, HIGH, QUICK, workers=workers)
            )
        interrupted = minimise(objective, LOW, HIGH, QUICK, lambda progress: progress.iteration == 3)
        assert (interrupted.iterations, interrupted.stopped_by) == (3, "callback")


@pytest.mark.parametrize("workers", [2, 3, 50])
def test_number_of_workers_does_not_change_the_result(workers):
    assert is_identical(minimise(bowl, LOW, HIGH, QUICK), minimise(bowl, LOW, HIGH, QUICK, workers=workers))


@pytest.mark.parametrize("workers", [0, 257, 1.5])
def test_invalid_number_of_workers_is_refused(workers):
    with pytest.raises(SettingsError, match="workers"):
        minimise(bowl, LOW, HIGH, QUICK, workers=workers)


def test_callback_is_called_for_each_iteration_and_does_not_change_the_result():
    reports = []
    variant = replace(QUICK, iterations=40)
    with_callback = minimise(bowl, LOW, HIGH, variant, reports.append)
    assert is_identical(with_callback, minimise(bowl, LOW, HIGH, variant))
    assert [progress.iteration for progress in reports] == list(range(1, 41))
    assert [progress.evaluations for progress in reports] == with_callback.history.evaluations[1:].tolist()
    assert reports[-1].best_value == with_callback.best_value
    np.testing.assert_array_equal(reports[-1].best, with_callback.best)


def test_callback_ends_the_search():
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


def test_compiled_swarm_equals_the_plain_one_to_the_last_bit():
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
def test_only_the_order_of_the_values_matters(variant, change):
    """A strictly increasing function of the objective gives the same search."""

    # Whole numbers, so that different values remain different.
    def steps(points):
        return np.floor(1000.0 * bowl(points))

    plain = minimise(steps, LOW, HIGH, variant)
    changed = minimise(lambda points: change(steps(points)), LOW, HIGH, variant)
    assert plain.best.tobytes() == changed.best.tobytes()
    np.testing.assert_array_equal(plain.history.moves, changed.history.moves)


class RecordingObjective:
    """An objective that stores the requested points and returns the values of a function."""

    def __init__(self, function):
        self.points = []
        self.answer = function

    def __call__(self, points):
        self.points.append(points)
        return self.answer(points)


limits = st.floats(-1e300, 1e300)
box_strategy = st.lists(st.tuples(limits, limits), min_size=1, max_size=4).map(
    lambda pairs: [sorted(pair) for pair in pairs if pair[0] != pair[1]] or [[0.0, 5e-324]]
)


@given(box_strategy, st.sampled_from(VARIANTS), st.integers(0, 2**64 - 1))
def test_all_points_are_within_the_box(box, variant, seed):
    low, high = np.array(box).T
    recorder = RecordingObjective(lambda points: np.sin(points[:, 0]))
    result = minimise(recorder, low, high, replace(variant, seed=seed))
    points = np.vstack(recorder.points)
    assert np.all((points >= low) & (points <= high))
    assert np.all((result.best >= low) & (result.best <= high))
    assert result.evaluations == len(points)
    assert result.best_value == np.min(np.sin(points[:, 0]))


@given(st.sampled_from(VARIANTS), st.integers(0, 1000), st.lists(st.floats(), min_size=1, max_size=5))
def test_nan_infinite_and_equal_values_are_accepted(variant, seed, values_list):
    """Also subnormal values and plateaus."""
    recorder = RecordingObjective(lambda points: np.resize(values_list, len(points)))
    result = minimise(recorder, LOW, HIGH, replace(variant, seed=seed))
    given_values = np.resize(values_list, max(len(points) for points in recorder.points))
    assert result.best_value == np.min(np.where(np.isnan(given_values), np.inf, given_values))
    assert np.all(np.diff(result.history.evaluations) >= QUICK.fish)
    assert np.all(result.history.moves.sum(axis=1)[1:] == QUICK.fish)
    assert np.all((result.best >= LOW) & (result.best <= HIGH))


@pytest.mark.parametrize("variant", VARIANTS)
def test_history_agrees_with_the_evaluations(variant):
    recorder = RecordingObjective(bowl)
    result = minimise(recorder, LOW, HIGH, variant)
    history = result.history
    assert (result.iterations, result.stopped_by, result.seed) == (12, "iterations", 5)
    assert len(history.best_value) == len(history.vision) == len(history.moves) == 13
    assert np.all(np.diff(history.best_value) <= 0.0)
    assert history.best_value[-1] == result.best_value == bowl(result.best[None])[0]
    assert np.all(history.median_value >= history.best_value)
    assert history.evaluations[0] == variant.fish
    assert history.evaluations[-1] == result.evaluations == sum(len(points) for points in recorder.points)
    np.testing.assert_allclose(history.vision, variant.vision * variant.shrink ** (np.arange(13) / 12))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("max_evaluations", [8, 9, 60, 500])
def test_all_allowed_evaluations_are_used(variant, max_evaluations):
    variant = replace(variant, iterations=1000, max_evaluations=max_evaluations)
    recorder = RecordingObjective(bowl)
    result = minimise(recorder, LOW, HIGH, variant)
    points = np.vstack(recorder.points)
    assert result.stopped_by == "evaluations"
    assert len(points) == result.evaluations == max_evaluations
    assert result.best_value == np.min(bowl(points))


@pytest.mark.parametrize("variant", VARIANTS)
def test_vision_shrinks_also_with_a_limit_of_evaluations(variant):
    result = minimise(bowl, LOW, HIGH, replace(variant, iterations=1000, max_evaluations=500))
    assert result.history.vision[-1] < variant.vision * variant.shrink**0.8


def test_vision_is_constant_without_shrinking():
    assert set(minimise(bowl, LOW, HIGH, replace(QUICK, shrink=1.0)).history.vision) == {QUICK.vision}


def test_all_tries_of_the_shoal_are_evaluated_in_one_call():
    recorder = RecordingObjective(bowl)
    minimise(recorder, LOW, HIGH, replace(QUICK, iterations=1, strategy="optimal", prey="best"))
    start, tries, *moves = recorder.points
    assert len(start) == QUICK.fish
    assert len(tries) >= QUICK.fish * QUICK.tries
    assert len(moves) <= 2


def test_start_points_are_used():
    recorder = RecordingObjective(bowl)
    start = [(0.5, 5e-4, 4000.0), HIGH]
    minimise(recorder, LOW, HIGH, QUICK, start=start)
    np.testing.assert_allclose(recorder.points[0][:2], start)
    minimise(recorder, LOW, HIGH, QUICK, start=start[0])


def test_the_objective_may_change_its_arguments():
    def destroying_bowl(points):
        values = bowl(points)
        points[:] = np.nan
        return values

    assert is_identical(minimise(destroying_bowl, LOW, HIGH, QUICK), minimise(bowl, LOW, HIGH, QUICK))


@pytest.mark.proof
def test_memory_increases_only_by_the_history():
    def peak(iterations):
        tracemalloc.start()
        result = minimise(bowl, LOW, HIGH, replace(QUICK, iterations=iterations))
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size, result.evaluations

    peak(10)
    (small_bytes, few_evaluations), (many, many_evaluations) = peak(50), peak(850)
    assert many_evaluations > 12 * few_evaluations
    row_bytes = 8 * (4 + 4)
    assert many - small_bytes < 800 * row_bytes * 2 + 20_000  # the history once, and its copy in the result


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
def test_invalid_box_is_refused(low, high, remedy):
    with np.errstate(over="ignore"), pytest.raises(SettingsError, match=remedy):
        minimise(bowl, low, high)


@pytest.mark.parametrize("function", [lambda points: 1.0, lambda points: points, lambda points: points[:-1, 0]])
def test_values_of_a_wrong_shape_are_refused(function):
    with pytest.raises(SettingsError, match="one value for each"):
        minimise(function, LOW, HIGH, QUICK)


@pytest.mark.parametrize("start", [[[0.0]], [[0.0] * 3] * 9, [(9.0, 0.0, 10.0)], [(np.nan, 0.0, 10.0)], [[[0.0] * 3]]])
def test_invalid_start_is_refused(start):
    with pytest.raises(SettingsError, match="start"):
        minimise(bowl, LOW, HIGH, QUICK, start=start)


def test_plain_function_in_a_compiled_objective_is_refused():
    with pytest.raises(SettingsError, match="compiled by numba"):
        minimise(CompiledObjective(bowl), LOW, HIGH, QUICK)


def test_error_of_the_objective_is_raised():
    def failing_objective(points):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        minimise(failing_objective, LOW, HIGH, QUICK)
