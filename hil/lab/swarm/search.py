"""Search with the fish swarm until iterations or evaluations are used up."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from hil.lab.compiled import compiling
from hil.lab.swarm.iteration import (
    BatchRows,
    HistoryRows,
    SearchConstants,
    evaluate_all,
    evaluate_each,
    run_compiled_rows,
)
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

Callback = Callable[[SwarmProgress], bool | None]
RunRows = Callable[[np.random.Generator, int, int], int]

CHUNK_ITERATIONS = 16  # in one compiled call; limits the delay of an interrupt
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
        objective: function of points (m, d) that returns m values, or a CompiledObjective. NaN is treated as inf.
        low: the lower limits of the d coordinates, finite.
        high: the upper limits, above low.
        settings: settings of the search; SwarmSettings() if None.
        callback: called after each iteration; returning True ends the search.
        start: initial points (k, d) of the first k fish, within the box; the others start at random.
        workers: threads that share the points of each call. Only objectives that release the global interpreter lock,
            such as compiled ones, become faster; the result is the same to the last bit.

    Raises:
        SettingsError: wrong shape or size of the bounds, the start or the objective's values.
    """
    settings = SwarmSettings() if settings is None else settings
    low_limits, high_limits = _box(low, high)
    shoal = new_shoal(settings, low_limits.size)
    constants = _search_constants(settings, low_limits, high_limits)
    history = _empty_history(settings, shoal)
    rng = np.random.Generator(np.random.PCG64(settings.seed))
    scatter(shoal, rng)
    if start is not None:
        _set_start(shoal, np.asarray(start, float), constants, settings)
    if not (isinstance(workers, int) and 1 <= workers <= MAX_WORKERS):
        raise SettingsError(f"workers {workers}: give a whole number from 1 to {MAX_WORKERS}")
    with ThreadPoolExecutor(max(workers - 1, 1)) as pool:
        run_rows = _row_runner(objective, shoal, constants, history, pool if workers > 1 else None, workers)
        with compiling("the fish swarm"):
            row = run_rows(rng, 0, 1)
        stopped_by, row = _run_to_end(run_rows, rng, shoal, constants, history, row, callback)
    return SwarmResult(
        best=_in_units(shoal.best_position, constants),
        best_value=float(shoal.best_cost[0]),
        evaluations=int(history.evaluations[row - 1]),
        iterations=row - 1,
        stopped_by=stopped_by,
        seed=settings.seed,
        history=SwarmHistory(
            best_value=history.best_value[:row].copy(),
            median_value=history.median_value[:row].copy(),
            evaluations=history.evaluations[:row].copy(),
            vision=history.vision[:row].copy(),
            moves=history.moves[:row].copy(),
        ),
    )


def _run_to_end(
    run_rows: RunRows,
    rng: np.random.Generator,
    shoal: Shoal,
    constants: SearchConstants,
    history: HistoryRows,
    row: int,
    callback: Callback | None,
) -> tuple[StopReason, int]:
    """Run until the search ends; return the reason and the number of rows of the history."""
    chunk = CHUNK_ITERATIONS if callback is None else 1
    while row <= constants.iterations:
        next_row = run_rows(rng, row, min(row + chunk, constants.iterations + 1))
        if next_row == row:
            return "evaluations", row
        row = next_row
        if callback is not None and callback(
            SwarmProgress(
                iteration=row - 1,
                iterations=constants.iterations,
                evaluations=int(history.evaluations[row - 1]),
                best=_in_units(shoal.best_position, constants),
                best_value=float(shoal.best_cost[0]),
            )
        ):
            return "callback", row
    return "iterations", row


def _row_runner(
    objective: BatchObjective | CompiledObjective,
    shoal: Shoal,
    constants: SearchConstants,
    history: HistoryRows,
    pool: ThreadPoolExecutor | None,
    workers: int,
) -> RunRows:
    if not isinstance(objective, CompiledObjective):
        evaluate = _check_shape(objective)
    else:
        if not hasattr(objective.function, "py_func"):
            raise SettingsError("CompiledObjective needs a function compiled by numba; pass a plain function directly")
        kind = evaluate_all if objective.batch else evaluate_each
        function, data = objective.function, tuple(objective.data)
        if pool is None:
            return lambda rng, row, end: int(
                run_compiled_rows(kind, function, data, shoal, constants, history, rng, row, end)
            )

        def evaluate(points: Floats) -> Floats:
            values = np.empty(len(points))
            kind(function, data, points, values)
            return values

    return BatchRows(evaluate if pool is None else _share_work(evaluate, pool, workers), shoal, constants, history)


def _check_shape(objective: BatchObjective) -> BatchObjective:
    def evaluate_checked(points: Floats) -> Floats:
        values = np.asarray(objective(points), float)
        if values.shape != points.shape[:1]:
            raise SettingsError(
                f"the objective returned shape {values.shape} for points {points.shape}; "
                f"it must return {points.shape[:1]}, one value for each"
            )
        return values

    return evaluate_checked


def _share_work(evaluate: BatchObjective, pool: ThreadPoolExecutor, workers: int) -> BatchObjective:
    def values(points: Floats) -> Floats:
        # Multiples of LANES points, so that each worker uses full SIMD registers.
        size = -(-len(points) // (workers * LANES)) * LANES
        first, *other_parts = (points[begin : begin + size] for begin in range(0, len(points), size))
        futures = [pool.submit(evaluate, part) for part in other_parts]
        # This thread evaluates the first part: submitting a part takes as long as simulating a dozen fish.
        return np.concatenate([evaluate(first), *(future.result() for future in futures)])

    return values


def _box(low: ArrayLike, high: ArrayLike) -> tuple[Floats, Floats]:
    low_limits = np.array(low, float, ndmin=1)
    high_limits = np.array(high, float, ndmin=1)
    if low_limits.ndim != 1 or low_limits.shape != high_limits.shape or low_limits.size == 0:
        raise SettingsError(
            f"bounds of shapes {low_limits.shape}, {high_limits.shape}: give one low and one high for each coordinate"
        )
    if not (np.all(np.isfinite(low_limits)) and np.all(np.isfinite(high_limits - low_limits))):
        raise SettingsError("bounds and their difference must be finite")
    invalid = np.flatnonzero(~(low_limits < high_limits))
    if invalid.size:
        index = int(invalid[0])
        raise SettingsError(f"coordinate {index}: low {low_limits[index]:g} is not below high {high_limits[index]:g}")
    return low_limits, high_limits


def _search_constants(settings: SwarmSettings, low: Floats, high: Floats) -> SearchConstants:
    limit = NO_LIMIT if settings.max_evaluations is None else settings.max_evaluations
    return SearchConstants(
        low=low,
        high=high,
        stages=schedule(settings),
        vision=settings.vision * diagonal(low.size),
        step=settings.step * diagonal(low.size),
        shrink=settings.shrink,
        congestion=settings.congestion,
        skips_after_improvement=settings.strategy == "progress",
        iterations=settings.iterations,
        max_evaluations=limit,
    )


def _empty_history(settings: SwarmSettings, shoal: Shoal) -> HistoryRows:
    rows = settings.iterations + 1
    if settings.max_evaluations is not None:
        # Each fish needs at least one evaluation in each iteration except the last one.
        rows = min(rows, settings.max_evaluations // settings.fish + 2)
    return HistoryRows(
        best_value=np.zeros(rows),
        median_value=np.zeros(rows),
        evaluations=np.zeros(rows, np.int64),
        vision=np.zeros(rows),
        moves=np.zeros((rows, MOVES), np.int64),
        points_in_units=np.zeros_like(shoal.point),
        costs=np.zeros(shoal.owner.size),
    )


def _set_start(shoal: Shoal, start: Floats, constants: SearchConstants, settings: SwarmSettings) -> None:
    start = np.atleast_2d(start)
    if start.ndim != 2 or start.shape[1] != constants.low.size or len(start) > settings.fish:
        raise SettingsError(f"start of shape {start.shape}: give up to {settings.fish} rows of {constants.low.size}")
    if not np.all((start >= constants.low) & (start <= constants.high)):
        raise SettingsError("a start is outside the box; clip it, or widen the bounds")
    shoal.position[: len(start)] = (start - constants.low) / (constants.high - constants.low)


def _in_units(position: Floats, constants: SearchConstants) -> Floats:
    return np.minimum(constants.low + position * (constants.high - constants.low), constants.high)
