"""An iteration of the swarm, for Python and for compiled objectives."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled, compiled_here
from hil.lab.numeric_core import inner
from hil.lab.swarm.behaviour import begin, copy, find_partners, move_fish, request_points, store_costs
from hil.lab.swarm.records import BatchObjective, Floats
from hil.lab.swarm.shoal import Behaviour, Shoal


class Course(NamedTuple):
    """Constants of a search; initial vision and step in lengths of the unit box."""

    low: Floats
    high: Floats
    stages: NDArray[np.int64]
    vision: float
    step: float
    shrink: float
    congestion: float
    content: bool
    iterations: int
    max_evaluations: int


class Log(NamedTuple):
    """The rows of the history, and the buffers between the shoal and the objective."""

    best_value: Floats
    median_value: Floats
    evaluations: NDArray[np.int64]
    vision: Floats
    moves: NDArray[np.int64]
    world: Floats
    costs: Floats


@compiled
def turn(shoal: Shoal, course: Course, log: Log, row: int, stage: int, answered: int) -> int:
    """Store the results of the previous stage, and request the points of a stage; return their number.

    An iteration has the stages from 0 to one after the last, which requests nothing and moves the fish. If the
    evaluations run out, the last fish get no result. Row 0 of the history is the start: it requests the places of the
    fish.
    """
    if row == 0:
        return start(shoal, course, log, stage)
    behaviour = behaviour_now(course, row - 1, log.evaluations[row - 1])
    if stage == 0:
        log.evaluations[row] = log.evaluations[row - 1]
        begin(shoal)
        find_partners(shoal, behaviour.reach)
    else:
        log.evaluations[row] += answered
        store_costs(shoal, answered, log.costs)
    if stage == course.stages.shape[0]:
        move_fish(shoal, log.moves[row])
        note(shoal, course, log, row)
        return 0
    count = request_points(shoal, course.stages[stage, 0], course.stages[stage, 1], course.stages[stage, 2], behaviour)
    count = min(count, int(course.max_evaluations - log.evaluations[row]))
    place_in_world(shoal, count, course, log)
    return count


@inner
def start(shoal: Shoal, course: Course, log: Log, stage: int) -> int:
    """Request the start places of the fish, or store their costs."""
    fish = shoal.cost.size
    if stage == 0:
        for i in range(fish):
            copy(shoal.place[i], shoal.point[i])
        place_in_world(shoal, fish, course, log)
        return fish
    copy(shoal.place[0], shoal.best_place)
    for i in range(fish):
        cost = log.costs[i]
        shoal.cost[i] = np.inf if math.isnan(cost) else cost
        if shoal.cost[i] < shoal.best_cost[0]:
            shoal.best_cost[0] = cost
            copy(shoal.place[i], shoal.best_place)
    log.evaluations[0] = fish
    note(shoal, course, log, 0)
    return 0


@inner
def behaviour_now(course: Course, iteration: int, evaluations: int) -> Behaviour:
    """Return vision and step of an iteration, which shrink with the progress of the search."""
    used = max(iteration / course.iterations, evaluations / course.max_evaluations)
    scale = course.shrink**used
    return Behaviour(course.vision * scale, course.step * scale, course.congestion, course.content)


@inner
def place_in_world(shoal: Shoal, count: int, course: Course, log: Log) -> None:
    """Convert the requested points to the units of the objective."""
    for number in range(count):
        for k in range(course.low.size):
            span = course.high[k] - course.low[k]
            log.world[number, k] = min(course.low[k] + shoal.point[number, k] * span, course.high[k])


@inner
def note(shoal: Shoal, course: Course, log: Log, row: int) -> None:
    """Write a row of the history."""
    log.best_value[row] = shoal.best_cost[0]
    log.median_value[row] = median(shoal.cost)
    log.vision[row] = behaviour_now(course, row, log.evaluations[row]).reach / math.sqrt(course.low.size)


@inner
def median(values: np.ndarray) -> float:
    """Return the median (numba takes seconds to compile that of numpy)."""
    size = values.size
    lower = upper = values[0]
    for i in range(size):
        below = same = 0
        for j in range(size):
            below += values[j] < values[i]
            same += values[j] == values[i]
        if below <= (size - 1) // 2 < below + same:
            lower = values[i]
        if below <= size // 2 < below + same:
            upper = values[i]
    return 0.5 * (lower + upper)  # type: ignore[no-any-return]


@inner
def stages_of(course: Course, row: int) -> int:
    """Return the number of stages of a row of the history; the start has one."""
    return 1 if row == 0 else course.stages.shape[0]


@inner
def may_go_on(course: Course, log: Log, row: int) -> bool:
    """Return whether evaluations are left for at least a part of another iteration."""
    return row == 0 or bool(log.evaluations[row - 1] < course.max_evaluations)


@inner
def draw(shoal: Shoal, rng: np.random.Generator) -> None:
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
def swim(
    evaluate: Any,
    objective: Any,
    data: Any,
    shoal: Shoal,
    course: Course,
    log: Log,
    rng: np.random.Generator,
    row: int,
    end_row: int,
) -> int:
    """Run from one row of the history to another in compiled code; return the row reached."""
    while row < end_row and may_go_on(course, log, row):
        if row > 0:
            draw(shoal, rng)
        count = 0
        for stage in range(stages_of(course, row) + 1):
            if count > 0:
                evaluate(objective, data, log.world[:count], log.costs[:count])
            count = turn(shoal, course, log, row, stage, count)
        row += 1
    return row


class BatchSwimmer:
    """Runs the swarm with a Python objective, called once for each stage of an iteration."""

    def __init__(self, evaluate: BatchObjective, shoal: Shoal, course: Course, log: Log) -> None:
        """Store the objective, a function of points that returns their values."""
        self._evaluate = evaluate
        self._shoal = shoal
        self._course = course
        self._log = log

    def __call__(self, rng: np.random.Generator, row: int, end_row: int) -> int:
        """Run from one row of the history to another; return the row reached."""
        shoal, course, log = self._shoal, self._course, self._log
        while row < end_row and may_go_on(course, log, row):
            if row > 0:
                rng.random(out=shoal.uniforms)
                rng.standard_normal(out=shoal.normals)
            count = 0
            for stage in range(stages_of(course, row) + 1):
                if count > 0:
                    # A copy, because the objective may store its argument.
                    log.costs[:count] = self._evaluate(log.world[:count].copy())
                count = turn(shoal, course, log, row, stage, count)
            row += 1
        return row
