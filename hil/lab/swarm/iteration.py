"""Iterations of the swarm, for Python objectives and for compiled objectives."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled, compiled_here
from hil.lab.numeric_core import inner
from hil.lab.swarm.behaviour import copy_point, find_partners, move_fish, request_points, start_iteration, store_costs
from hil.lab.swarm.records import BatchObjective, Floats
from hil.lab.swarm.shoal import Behaviour, Shoal


class SearchConstants(NamedTuple):
    """Constants of a search; initial vision and step in side lengths of the unit box."""

    low: Floats
    high: Floats
    stages: NDArray[np.int64]
    vision: float
    step: float
    shrink: float
    congestion: float
    skips_after_improvement: bool
    iterations: int
    max_evaluations: int


class HistoryRows(NamedTuple):
    """The rows of the history, and the buffers for points and costs in the units of the objective."""

    best_value: Floats
    median_value: Floats
    evaluations: NDArray[np.int64]
    vision: Floats
    moves: NDArray[np.int64]
    points_in_units: Floats
    costs: Floats


@compiled
def run_stage(
    shoal: Shoal, constants: SearchConstants, history: HistoryRows, row: int, stage: int, cost_count: int
) -> int:
    """Store the costs of the previous stage, and request the points of a stage; return their number.

    The stage after the last one requests no points and moves the fish. If the evaluations are used up, the last fish
    get no result. Row 0 of the history is the start, which requests the initial positions.
    """
    if row == 0:
        return run_start_stage(shoal, constants, history, stage)
    behaviour = current_behaviour(constants, row - 1, history.evaluations[row - 1])
    if stage == 0:
        history.evaluations[row] = history.evaluations[row - 1]
        start_iteration(shoal)
        find_partners(shoal, behaviour.vision)
    else:
        history.evaluations[row] += cost_count
        store_costs(shoal, cost_count, history.costs)
    if stage == constants.stages.shape[0]:
        move_fish(shoal, history.moves[row])
        write_row(shoal, constants, history, row)
        return 0
    count = request_points(
        shoal, constants.stages[stage, 0], constants.stages[stage, 1], constants.stages[stage, 2], behaviour
    )
    count = min(count, int(constants.max_evaluations - history.evaluations[row]))
    convert_points(shoal, count, constants, history)
    return count


@inner
def run_start_stage(shoal: Shoal, constants: SearchConstants, history: HistoryRows, stage: int) -> int:
    """Request the initial positions of the fish (stage 0), or store their costs."""
    fish = shoal.cost.size
    if stage == 0:
        for i in range(fish):
            copy_point(shoal.position[i], shoal.point[i])
        convert_points(shoal, fish, constants, history)
        return fish
    copy_point(shoal.position[0], shoal.best_position)
    for i in range(fish):
        cost = history.costs[i]
        shoal.cost[i] = np.inf if math.isnan(cost) else cost
        if shoal.cost[i] < shoal.best_cost[0]:
            shoal.best_cost[0] = cost
            copy_point(shoal.position[i], shoal.best_position)
    history.evaluations[0] = fish
    write_row(shoal, constants, history, 0)
    return 0


@inner
def current_behaviour(constants: SearchConstants, iteration: int, evaluations: int) -> Behaviour:
    """Return vision and step of an iteration, which decrease during the search."""
    used_fraction = max(iteration / constants.iterations, evaluations / constants.max_evaluations)
    scale = constants.shrink**used_fraction
    return Behaviour(
        constants.vision * scale, constants.step * scale, constants.congestion, constants.skips_after_improvement
    )


@inner
def convert_points(shoal: Shoal, count: int, constants: SearchConstants, history: HistoryRows) -> None:
    """Convert the requested points to the units of the objective."""
    for number in range(count):
        for k in range(constants.low.size):
            span = constants.high[k] - constants.low[k]
            history.points_in_units[number, k] = min(
                constants.low[k] + shoal.point[number, k] * span, constants.high[k]
            )


@inner
def write_row(shoal: Shoal, constants: SearchConstants, history: HistoryRows, row: int) -> None:
    """Write a row of the history."""
    history.best_value[row] = shoal.best_cost[0]
    history.median_value[row] = median(shoal.cost)
    history.vision[row] = current_behaviour(constants, row, history.evaluations[row]).vision / math.sqrt(
        constants.low.size
    )


@inner
def median(values: np.ndarray) -> float:
    """Return the median; that of numpy takes numba seconds to compile."""
    size = values.size
    lower = upper = values[0]
    for i in range(size):
        smaller_count = equal_count = 0
        for j in range(size):
            smaller_count += values[j] < values[i]
            equal_count += values[j] == values[i]
        if smaller_count <= (size - 1) // 2 < smaller_count + equal_count:
            lower = values[i]
        if smaller_count <= size // 2 < smaller_count + equal_count:
            upper = values[i]
    return 0.5 * (lower + upper)  # type: ignore[no-any-return]


@inner
def stage_count(constants: SearchConstants, row: int) -> int:
    """Return the number of stages of a row of the history; the start has one."""
    return 1 if row == 0 else constants.stages.shape[0]


@inner
def has_evaluations_left(constants: SearchConstants, history: HistoryRows, row: int) -> bool:
    """Return whether evaluations are left for at least a part of this row."""
    return row == 0 or bool(history.evaluations[row - 1] < constants.max_evaluations)


@inner
def draw_numbers(shoal: Shoal, rng: np.random.Generator) -> None:
    """Draw the random numbers of an iteration, in the order of numpy."""
    for i in range(shoal.uniforms.shape[0]):
        for k in range(shoal.uniforms.shape[1]):
            shoal.uniforms[i, k] = rng.random()
    for i in range(shoal.normals.shape[0]):
        for number in range(shoal.normals.shape[1]):
            for k in range(shoal.normals.shape[2]):
                shoal.normals[i, number, k] = rng.standard_normal()


@compiled_here
def evaluate_each(objective: Any, data: Any, points: np.ndarray, values: np.ndarray) -> None:
    """Evaluate a compiled objective of one point."""
    for number in range(points.shape[0]):
        values[number] = objective(points[number], *data)


@compiled_here
def evaluate_all(objective: Any, data: Any, points: np.ndarray, values: np.ndarray) -> None:
    """Evaluate a compiled objective of many points."""
    objective(points, values, *data)


@compiled_here
def run_compiled_rows(
    evaluate: Any,
    objective: Any,
    data: Any,
    shoal: Shoal,
    constants: SearchConstants,
    history: HistoryRows,
    rng: np.random.Generator,
    row: int,
    end_row: int,
) -> int:
    """Compute the rows [row, end_row) of the history in compiled code; return the row reached."""
    while row < end_row and has_evaluations_left(constants, history, row):
        if row > 0:
            draw_numbers(shoal, rng)
        count = 0
        for stage in range(stage_count(constants, row) + 1):
            if count > 0:
                evaluate(objective, data, history.points_in_units[:count], history.costs[:count])
            count = run_stage(shoal, constants, history, row, stage, count)
        row += 1
    return row


class BatchRows:
    """Run the swarm with a Python objective, which is called once for each stage of an iteration."""

    def __init__(
        self, evaluate: BatchObjective, shoal: Shoal, constants: SearchConstants, history: HistoryRows
    ) -> None:
        """Store the objective, a function of points that returns their values."""
        self._evaluate = evaluate
        self._shoal = shoal
        self._constants = constants
        self._history = history

    def __call__(self, rng: np.random.Generator, row: int, end_row: int) -> int:
        """Compute the rows [row, end_row) of the history; return the row reached."""
        shoal, constants, history = self._shoal, self._constants, self._history
        while row < end_row and has_evaluations_left(constants, history, row):
            if row > 0:
                rng.random(out=shoal.uniforms)
                rng.standard_normal(out=shoal.normals)
            count = 0
            for stage in range(stage_count(constants, row) + 1):
                if count > 0:
                    # A copy, because the objective may change or store its argument.
                    history.costs[:count] = self._evaluate(history.points_in_units[:count].copy())
                count = run_stage(shoal, constants, history, row, stage, count)
            row += 1
        return row
