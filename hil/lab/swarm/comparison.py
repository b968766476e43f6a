"""Compare the fish swarm with other searches on standard functions, with equal numbers of evaluations.

The others are scipy's differential_evolution (by generations, without the final gradient search) and cma's CMA-ES
(bounded, from a random point with a standard deviation of 0.3 boxes, restarted with a larger population after
convergence). The baseline is uniform random points ("chance"). The error of a run is the smallest value among its first
`evaluations` evaluations. The default settings of the fish swarm were chosen on these functions; the others use the
settings of their authors.
"""

from __future__ import annotations

import math
import statistics
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hil.lab.swarm.records import MAX_ITERATIONS, BatchObjective, Floats, SwarmSettings
from hil.lab.swarm.search import minimise

SCHWEFEL_POSITION = 420.968746359982
SCHWEFEL_VALUE = 418.98288727243374


@dataclass(frozen=True, slots=True)
class StandardFunction:
    """A function, the limits of its box in each coordinate, and a text on its difficulty."""

    name: str
    function: BatchObjective
    low: float
    high: float
    text: str


def optimum(name: str, dimensions: int) -> Floats:
    """Return the position of the minimum of a function."""
    if name == "schwefel":
        return np.full(dimensions, SCHWEFEL_POSITION)
    if name == "rosenbrock":
        return np.ones(dimensions)
    row = next(row for row in TABLE if row.name == name)
    return np.asarray(_shift(dimensions) * (row.high - row.low))


def _shift(dimensions: int) -> Floats:
    """Return the shift of the minimum relative to the box: -0.35 to 0.35, distributed by the golden ratio."""
    return np.asarray(0.7 * ((np.arange(1, dimensions + 1) * 0.618033988749895) % 1.0 - 0.5))


def sphere(points: Floats) -> Floats:
    """Return the sum of squares: smooth and round."""
    offset = points - optimum("sphere", points.shape[1])
    return np.sum(offset**2, axis=1)  # type: ignore[no-any-return]


def rosenbrock(points: Floats) -> Floats:
    """Return Rosenbrock's function: a curved, flat valley."""
    current, following = points[:, :-1], points[:, 1:]
    return np.sum(100.0 * (following - current**2) ** 2 + (1.0 - current) ** 2, axis=1)  # type: ignore[no-any-return]


def rastrigin(points: Floats) -> Floats:
    """Return Rastrigin's function: a bowl with a regular lattice of about 10^d minima."""
    offset = points - optimum("rastrigin", points.shape[1])
    return np.sum(offset**2 - 10.0 * np.cos(2.0 * math.pi * offset) + 10.0, axis=1)  # type: ignore[no-any-return]


def ackley(points: Floats) -> Floats:
    """Return Ackley's function: an almost flat plain of minima around a funnel."""
    offset = points - optimum("ackley", points.shape[1])
    distance = np.sqrt(np.mean(offset**2, axis=1))
    ripple = np.mean(np.cos(2.0 * math.pi * offset), axis=1)
    return np.maximum(-20.0 * np.exp(-0.2 * distance) - np.exp(ripple) + 20.0 + math.e, 0.0)  # type: ignore[no-any-return]


def griewank(points: Floats) -> Floats:
    """Return Griewank's function: a wide bowl with many shallow connected minima."""
    offset = points - optimum("griewank", points.shape[1])
    root_index = np.sqrt(np.arange(1, points.shape[1] + 1))
    return np.sum(offset**2, axis=1) / 4000.0 - np.prod(np.cos(offset / root_index), axis=1) + 1.0  # type: ignore[no-any-return]


def schwefel(points: Floats) -> Floats:
    """Return Schwefel's function: deep minima, the best one in a corner, far from the second best."""
    waves = points * np.sin(np.sqrt(np.abs(points)))
    return np.sum(SCHWEFEL_VALUE - waves, axis=1)  # type: ignore[no-any-return]


TABLE = (
    StandardFunction("sphere", sphere, -5.12, 5.12, "smooth and round"),
    StandardFunction("rosenbrock", rosenbrock, -2.048, 2.048, "a curved, flat valley"),
    StandardFunction("rastrigin", rastrigin, -5.12, 5.12, "a bowl with a lattice of minima"),
    StandardFunction("ackley", ackley, -32.768, 32.768, "a plain of minima around a funnel"),
    StandardFunction("griewank", griewank, -600.0, 600.0, "a wide bowl with shallow minima"),
    StandardFunction("schwefel", schwefel, -500.0, 500.0, "deep minima, the best in a corner"),
)


MAX_SOLVED_ERROR = 1e-6
COLUMNS = ("function", "d", "evaluations")


class _SpentError(Exception):
    """Raised by an objective when the budget is used up, to end the search."""


class Budget:
    """Count the evaluations of a search, and store the smallest value within the budget."""

    def __init__(self, function: BatchObjective, evaluations: int) -> None:
        """Store the function and the number of evaluations."""
        self.remaining = evaluations
        self.minimum = float("inf")
        self._function = function

    def __call__(self, points: Floats) -> Floats:
        """Evaluate points; raise _SpentError if the budget is exceeded."""
        if self.remaining <= 0:
            raise _SpentError
        values = self._function(points[: self.remaining])
        self.remaining -= len(points)
        self.minimum = min(self.minimum, float(np.min(values)))
        if self.remaining < 0:
            raise _SpentError
        return values


Search = Callable[[Budget, Floats, Floats, int], None]


@dataclass(frozen=True, slots=True)
class Row:
    """The errors of all searches on one function, one for each seed."""

    function: str
    dimensions: int
    evaluations: int
    errors: dict[str, tuple[float, ...]]

    def median(self, search: str) -> float:
        """Return the median error of a search."""
        return statistics.median(self.errors[search])

    def solved(self, search: str) -> int:
        """Return the number of runs with an error of at most MAX_SOLVED_ERROR."""
        return sum(smallest_error <= MAX_SOLVED_ERROR for smallest_error in self.errors[search])

    def winner(self) -> str:
        """Return the search with the most solved runs; among equals the one with the smallest median error."""
        return min(self.errors, key=lambda search: (-self.solved(search), self.median(search)))


def search_with_fish(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Search with the fish swarm's standard settings."""
    settings = SwarmSettings(seed=seed, iterations=MAX_ITERATIONS // 10, max_evaluations=budget.remaining)
    minimise(budget, low, high, settings)


def search_with_differential_evolution(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Search with scipy's differential evolution."""
    from scipy import optimize  # noqa: PLC0415 - takes half a second, and only the comparison needs it

    optimize.differential_evolution(
        lambda points: budget(points.T),
        list(zip(low, high, strict=True)),
        maxiter=budget.remaining,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(seed),
    )


def search_with_cma_es(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Search with cma's CMA-ES and its restarts."""
    import cma  # type: ignore[import-untyped]  # noqa: PLC0415 - only the comparison needs it

    rng = np.random.default_rng(seed)
    span = high - low
    dimensions = low.size
    population = 4 + int(3 * np.log(dimensions))
    for restart in range(100):
        options = {
            "bounds": [[0.0] * dimensions, [1.0] * dimensions],
            "popsize": population * 2 ** min(restart, 8),
            "verbose": -9,
            "seed": 1 + seed * 1000 + restart,
        }
        search = cma.CMAEvolutionStrategy(rng.random(dimensions), 0.3, options)
        while not search.stop():
            points = search.ask()
            search.tell(points, list(budget(low + np.array(points) * span)))


def search_at_random(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Draw uniform random points from the box."""
    budget(np.random.default_rng(seed).uniform(low, high, (budget.remaining, low.size)))


SEARCHES: dict[str, Search] = {
    "fish": search_with_fish,
    "DE": search_with_differential_evolution,
    "CMA-ES": search_with_cma_es,
    "chance": search_at_random,
}


def compare(
    functions: Sequence[StandardFunction], dimensions: int, evaluations: int, seeds: Sequence[int]
) -> list[Row]:
    """Run all searches on all functions, once for each seed."""
    rows = []
    for row in functions:
        low, high = np.full(dimensions, row.low), np.full(dimensions, row.high)
        errors = {
            name: tuple(smallest_error(search, row.function, low, high, evaluations, seed) for seed in seeds)
            for name, search in SEARCHES.items()
        }
        rows.append(Row(row.name, dimensions, evaluations, errors))
    return rows


def smallest_error(
    search: Search, function: BatchObjective, low: Floats, high: Floats, evaluations: int, seed: int
) -> float:
    """Return the smallest value that a search finds within the evaluations."""
    budget = Budget(function, evaluations)
    with warnings.catch_warnings():
        # The other searches warn of converged or flat populations, which their restarts handle.
        warnings.simplefilter("ignore")
        try:
            search(budget, low, high, seed)
        except _SpentError:
            pass
    return budget.minimum


def text(rows: Sequence[Row], runs: int) -> str:
    """Return the table as text: median error, solved runs, and best search."""
    header = (*COLUMNS, *(f"{name} error (solved)" for name in SEARCHES), "best")
    cells = [header]
    for row in rows:
        result_cells = (f"{row.median(name):.1e} ({row.solved(name)}/{runs})" for name in SEARCHES)
        cells.append((row.function, str(row.dimensions), str(row.evaluations), *result_cells, row.winner()))
    widths = [max(len(line[column]) for line in cells) for column in range(len(header))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in cells]
    wins = ", ".join(f"{name} {sum(row.winner() == name for row in rows)}" for name in SEARCHES)
    lines.append(
        f"error: median of {runs} seeded runs; solved: error up to {MAX_SOLVED_ERROR:g}; best of {len(rows)}: {wins}"
    )
    return "\n".join(lines)


def standard_table(dimensions: Sequence[int], per_dimension: int, runs: int) -> list[Row]:
    """Compare on all standard functions, with a budget proportional to the dimensions."""
    return [row for d in dimensions for row in compare(TABLE, d, per_dimension * d, range(1, runs + 1))]
