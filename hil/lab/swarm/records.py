"""Inputs and results of the artificial fish swarm."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

Strategy = Literal["optimal", "progress"]
Prey = Literal["best", "first"]

MAX_FISH = 10_000
MAX_ITERATIONS = 1_000_000
MAX_TRIES = 10_000


class SettingsError(ValueError):
    """An invalid setting, bound or objective; the text contains the remedy."""


@dataclass(frozen=True, slots=True)
class SwarmSettings:
    """Settings of the fish swarm; symbols of the paper in brackets.

    fish: number of fish (n).
    iterations: number of iterations (Kmax).
    tries: number of points that a preying fish tries (Tn).
    vision: vision of a fish (Vs), in diagonals of the box.
    step: maximum step (St), in diagonals of the box.
    congestion: crowding factor (kappa); 0: fish never avoid each other, 1: they always do.
    strategy: "optimal" takes the best behaviour, "progress" the first one that improves the cost, in the order follow,
        swarm, prey.
    prey: "best" evaluates all tries at once and takes the best; "first" evaluates them one by one and takes the first
        better one (as in the paper; fewer evaluations, more calls).
    shrink: vision and step decrease geometrically to this fraction at the end; with 1 they are constant.
    seed: seed of all random numbers.
    max_evaluations: number after which the swarm stops, also within an iteration; None: no limit.

    The defaults were chosen by hand near the best of 224 settings, each with three seeds on the standard functions in 2
    and 5 dimensions. Several settings are equal within the scatter of these seeds, and a comparison on the same
    functions (`rambler-hil swarm-table`) favours the fish swarm.

    With the default shrink, vision is less than half after a tenth of the search; the fish then refine the present
    minimum. For deep minima that are far apart (Schwefel's function in five dimensions, where these defaults are hardly
    better than random search), a shrink closer to 1 searches longer and ends less precisely.

    Raises SettingsError for invalid values.
    """

    fish: int = 20
    iterations: int = 100
    tries: int = 4
    vision: float = 0.5
    step: float = 0.3
    congestion: float = 0.01
    strategy: Strategy = "progress"
    prey: Prey = "best"
    shrink: float = 1e-4
    seed: int = 1
    max_evaluations: int | None = None

    def __post_init__(self) -> None:
        """Raise SettingsError for an invalid value."""
        integers = {
            "fish": (self.fish, 2, MAX_FISH),
            "iterations": (self.iterations, 1, MAX_ITERATIONS),
            "tries": (self.tries, 1, MAX_TRIES),
            "seed": (self.seed, 0, 2**64 - 1),
        }
        if self.max_evaluations is not None:
            integers["max_evaluations"] = (self.max_evaluations, self.fish, 2**62)
        for name, (number, minimum, maximum) in integers.items():
            if isinstance(number, bool) or not isinstance(number, int) or not minimum <= number <= maximum:
                raise SettingsError(f"{name} {number!r}: give a whole number from {minimum} to {maximum}")
        ranges = {
            "vision": (self.vision, 1e-12, 1.0),
            "step": (self.step, 1e-12, 1.0),
            "congestion": (self.congestion, 0.0, 1.0),
            "shrink": (self.shrink, 1e-12, 1.0),
        }
        for name, (value, low, high) in ranges.items():
            if not (math.isfinite(value) and low <= value <= high):
                raise SettingsError(f"{name} {value!r}: give a number from {low:g} to {high:g}")
        if self.strategy not in get_args(Strategy):
            raise SettingsError(f"strategy {self.strategy!r}: give one of {', '.join(get_args(Strategy))}")
        if self.prey not in get_args(Prey):
            raise SettingsError(f"prey {self.prey!r}: give one of {', '.join(get_args(Prey))}")


Floats = NDArray[np.float64]
BatchObjective = Callable[[Floats], Floats]
StopReason = Literal["iterations", "evaluations", "callback"]


@dataclass(frozen=True, slots=True)
class CompiledObjective:
    """An objective that compiled code calls, so that the whole swarm runs in one compiled function.

    function: compiled by numba; called as function(point, *data) and returns one number, or, with `batch`, as
        function(points, values, *data) and fills values; points are (m, d).
    data: other arguments of the function, such as the arrays of a log.

    Machine code that calls a function argument cannot be stored, so each process compiles the swarm again, which takes
    some seconds. This is useful for cheap objectives and many searches. An objective for whole batches is almost as
    fast if it is passed as a function of points instead.
    """

    function: Callable[..., Any]
    data: tuple[Any, ...] = ()
    batch: bool = False


@dataclass(frozen=True, slots=True)
class SwarmProgress:
    """Progress of a search, passed to the callback after each iteration; if it returns True, the search ends."""

    iteration: int
    iterations: int
    evaluations: int
    best: Floats
    best_value: float


@dataclass(frozen=True, slots=True)
class SwarmHistory:
    """One row per iteration; row 0 is the start.

    best_value and evaluations are cumulative; median_value is that of the shoal; vision is in diagonals of the box;
    moves is the number of fish of each behaviour, in the order of BEHAVIOURS.
    """

    best_value: Floats
    median_value: Floats
    evaluations: NDArray[np.int64]
    vision: Floats
    moves: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SwarmResult:
    """The best evaluated point (the bulletin board), and statistics of the search."""

    best: Floats
    best_value: float
    evaluations: int
    iterations: int
    stopped_by: StopReason
    seed: int
    history: SwarmHistory


BEHAVIOURS = ("follow", "swarm", "prey", "random")
