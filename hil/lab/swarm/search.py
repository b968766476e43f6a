"""The search: iterations of the shoal until iterations or evaluations are used up."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from hil.lab.compiled import compiling
from hil.lab.swarm.records import (
    BatchObjective,
    CompiledObjective,
    Floats,
    SettingsError,
    StopReason,
    SwarmHistory,
    SwarmProgress,
    SwarmResult,
    SwarmSettings,
)
from hil.lab.swarm.shoal import MOVES, Shoal, diagonal, new_shoal, scatter, schedule
from hil.lab.swarm.swim import BatchSwimmer, Course, Log, evaluate_all, evaluate_each, swim

Callback = Callable[[SwarmProgress], bool | None]
Swimmer = Callable[[np.random.Generator, int, int], int]

CHUNK = 16  # iterations in one compiled call, which limits the delay of an interrupt
NO_LIMIT = 2**62
MAX_WORKERS = 256
LANES = 8


def minimise(
    objective: BatchObjective | CompiledObjective,
    low: ArrayLike,
    high: ArrayLike,
    settings: SwarmSettings | None = None,
    callback: Callback | None = None,
    *,
    start: ArrayLike | None = None,
    workers: int = 1,
) -> SwarmResult:
    """Minimise an objective within the box from low to high.

    Args:
        objective: takes points (m, d) and returns their m values; or a CompiledObjective. NaN counts as inf.
        low: the lower limits of the d coordinates, finite.
        high: the upper limits, above low.
        settings: settings of the search; SwarmSettings() if None.
        callback: called after each iteration; returning True ends the search.
        start: places (k, d) within the box of the first k fish; the others start at random.
        workers: threads that share the points of each call. Only objectives that release the global interpreter lock,
            such as compiled ones, become faster; the result is the same to the last bit.

    Raises:
        SettingsError: wrong shape or size of the bounds, the start or the objective's values.
    """
    settings = SwarmSettings() if settings is None else settings
    low_end, high_end = _box(low, high)
    shoal = new_shoal(settings, low_end.size)
    course = _course(settings, low_end, high_end)
    log = _empty_log(settings, shoal)
    rng = np.random.Generator(np.random.PCG64(settings.seed))
    scatter(shoal, rng)
    if start is not None:
        _place(shoal, np.asarray(start, float), course, settings)
    if not (isinstance(workers, int) and 1 <= workers <= MAX_WORKERS):
        raise SettingsError(f"workers {workers}: give a whole number from 1 to {MAX_WORKERS}")
    with ThreadPoolExecutor(max(workers - 1, 1)) as pool:
        swimmer = _swimmer(objective, shoal, course, log, pool if workers > 1 else None, workers)
        with compiling("the fish swarm"):
            row = swimmer(rng, 0, 1)
        stopped_by, row = _swim_on(swimmer, rng, shoal, course, log, row, callback)
    return SwarmResult(
        best=_in_world(shoal.best_place, course),
        best_value=float(shoal.best_cost[0]),
        evaluations=int(log.evaluations[row - 1]),
        iterations=row - 1,
        stopped_by=stopped_by,
        seed=settings.seed,
        history=SwarmHistory(
            best_value=log.best_value[:row].copy(),
            median_value=log.median_value[:row].copy(),
            evaluations=log.evaluations[:row].copy(),
            vision=log.vision[:row].copy(),
            moves=log.moves[:row].copy(),
        ),
    )


def _swim_on(
    swimmer: Swimmer,
    rng: np.random.Generator,
    shoal: Shoal,
    course: Course,
    log: Log,
    row: int,
    callback: Callback | None,
) -> tuple[StopReason, int]:
    """Run to the end; return the reason of the end and the number of rows of the history."""
    chunk = CHUNK if callback is None else 1
    while row <= course.iterations:
        reached = swimmer(rng, row, min(row + chunk, course.iterations + 1))
        if reached == row:
            return "evaluations", row
        row = reached
        if callback is not None and callback(
            SwarmProgress(
                iteration=row - 1,
                iterations=course.iterations,
                evaluations=int(log.evaluations[row - 1]),
                best=_in_world(shoal.best_place, course),
                best_value=float(shoal.best_cost[0]),
            )
        ):
            return "callback", row
    return "iterations", row


def _swimmer(
    objective: BatchObjective | CompiledObjective,
    shoal: Shoal,
    course: Course,
    log: Log,
    pool: ThreadPoolExecutor | None,
    workers: int,
) -> Swimmer:
    if not isinstance(objective, CompiledObjective):
        evaluate = _checked(objective)
    else:
        if not hasattr(objective.function, "py_func"):
            raise SettingsError("CompiledObjective needs a function compiled by numba; pass a plain function directly")
        kind = evaluate_all if objective.batch else evaluate_each
        function, data = objective.function, tuple(objective.data)
        if pool is None:
            return lambda rng, row, end: int(swim(kind, function, data, shoal, course, log, rng, row, end))

        def evaluate(points: Floats) -> Floats:
            values = np.empty(len(points))
            kind(function, data, points, values)
            return values

    return BatchSwimmer(evaluate if pool is None else _shared(evaluate, pool, workers), shoal, course, log)


def _checked(objective: BatchObjective) -> BatchObjective:
    def checked(points: Floats) -> Floats:
        values = np.asarray(objective(points), float)
        if values.shape != points.shape[:1]:
            raise SettingsError(
                f"the objective returned shape {values.shape} for points {points.shape}; "
                f"it must return {points.shape[:1]}, one value for each"
            )
        return values

    return checked


def _shared(evaluate: BatchObjective, pool: ThreadPoolExecutor, workers: int) -> BatchObjective:
    def values(points: Floats) -> Floats:
        # Full SIMD registers for each worker.
        size = -(-len(points) // (workers * LANES)) * LANES
        first, *others = (points[begin : begin + size] for begin in range(0, len(points), size))
        pending = [pool.submit(evaluate, part) for part in others]
        # This thread works, too: submitting work takes as long as simulating a dozen fish.
        return np.concatenate([evaluate(first), *(each.result() for each in pending)])

    return values


def _box(low: ArrayLike, high: ArrayLike) -> tuple[Floats, Floats]:
    low_end = np.array(low, float, ndmin=1)
    high_end = np.array(high, float, ndmin=1)
    if low_end.ndim != 1 or low_end.shape != high_end.shape or low_end.size == 0:
        raise SettingsError(
            f"bounds of shapes {low_end.shape}, {high_end.shape}: give one low and one high for each coordinate"
        )
    if not (np.all(np.isfinite(low_end)) and np.all(np.isfinite(high_end - low_end))):
        raise SettingsError("bounds and their difference must be finite")
    wrong = np.flatnonzero(~(low_end < high_end))
    if wrong.size:
        number = int(wrong[0])
        raise SettingsError(f"coordinate {number}: low {low_end[number]:g} is not below high {high_end[number]:g}")
    return low_end, high_end


def _course(settings: SwarmSettings, low: Floats, high: Floats) -> Course:
    limit = NO_LIMIT if settings.max_evaluations is None else settings.max_evaluations
    return Course(
        low=low,
        high=high,
        stages=schedule(settings),
        vision=settings.vision * diagonal(low.size),
        step=settings.step * diagonal(low.size),
        shrink=settings.shrink,
        congestion=settings.congestion,
        content=settings.strategy == "progress",
        iterations=settings.iterations,
        max_evaluations=limit,
    )


def _empty_log(settings: SwarmSettings, shoal: Shoal) -> Log:
    rows = settings.iterations + 1
    if settings.max_evaluations is not None:
        # Every fish needs at least one evaluation in each iteration except the last.
        rows = min(rows, settings.max_evaluations // settings.fish + 2)
    return Log(
        best_value=np.zeros(rows),
        median_value=np.zeros(rows),
        evaluations=np.zeros(rows, np.int64),
        vision=np.zeros(rows),
        moves=np.zeros((rows, MOVES), np.int64),
        world=np.zeros_like(shoal.point),
        costs=np.zeros(shoal.owner.size),
    )


def _place(shoal: Shoal, start: Floats, course: Course, settings: SwarmSettings) -> None:
    start = np.atleast_2d(start)
    if start.ndim != 2 or start.shape[1] != course.low.size or len(start) > settings.fish:
        raise SettingsError(f"start of shape {start.shape}: give up to {settings.fish} rows of {course.low.size}")
    if not np.all((start >= course.low) & (start <= course.high)):
        raise SettingsError("a start is outside the box; clip it, or widen the bounds")
    shoal.place[: len(start)] = (start - course.low) / (course.high - course.low)


def _in_world(place: Floats, course: Course) -> Floats:
    return np.minimum(course.low + place * (course.high - course.low), course.high)
