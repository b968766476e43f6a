"""What goes into the artificial fish swarm and what comes out of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BatchObjective = Callable[[Floats], Floats]
StopReason = Literal["iterations", "evaluations", "callback"]


@dataclass(frozen=True, slots=True)
class CompiledObjective:
    """An objective that compiled code calls, so that the whole swarm swims in one compiled function.

    function: compiled by numba; called as function(point, *data) and returns one number, or, when
        `batch`, as function(points, values, *data) and fills values, points being (m, d).
    data: what the function needs besides, such as the arrays of a log.

    Machine code that calls a given function cannot be kept, so each process compiles the swarm around it anew,
    some seconds long: worth it for cheap objectives and many searches. An objective that fills
    whole batches loses little when it is given as a function of points instead.
    """

    function: Callable[..., Any]
    data: tuple[Any, ...] = ()
    batch: bool = False


@dataclass(frozen=True, slots=True)
class SwarmProgress:
    """How far a search is; a callback gets one after each iteration and ends the search by returning True."""

    iteration: int
    iterations: int
    evaluations: int
    best: Floats
    best_value: float


@dataclass(frozen=True, slots=True)
class SwarmHistory:
    """One row per iteration, the start being row 0.

    best_value and evaluations are those so far; median_value is that of the shoal; vision in
    diagonals of the box; moves counts the fish that took each behaviour, in the order of BEHAVIOURS.
    """

    best_value: Floats
    median_value: Floats
    evaluations: NDArray[np.int64]
    vision: Floats
    moves: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SwarmResult:
    """The best point of all that were evaluated (the bulletin board), and how it was found."""

    best: Floats
    best_value: float
    evaluations: int
    iterations: int
    stopped_by: StopReason
    seed: int
    history: SwarmHistory


BEHAVIOURS = ("follow", "swarm", "prey", "random")
