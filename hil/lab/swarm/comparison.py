"""The fish beside two other searches, at the same number of evaluations, on the standard functions.

scipy's differential_evolution (a generation at a time, without its final gradient search, which
is no global one) and cma's CMA-ES (bounded, from a random point with a spread of 0.3 boxes, restarted
with a larger population when it has converged). Chance, as many points drawn evenly, is the mark that
any search ought to pass. All search the same box; each run's error is the least value among its
first `evaluations` evaluations. The fish's standard settings were picked on these very functions;
the others search with their authors' settings.
"""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hil.lab.swarm.functions import TABLE, StandardFunction
from hil.lab.swarm.records import BatchObjective, Floats
from hil.lab.swarm.search import minimise
from hil.lab.swarm.settings import MOST_ITERATIONS, SwarmSettings

SOLVED = 1e-6
COLUMNS = ("function", "d", "evaluations")


class _SpentError(Exception):
    """The budget is used up; ends a search from within its objective."""


class Budget:
    """Counts what a search asks for, and keeps the least value of the part that it has paid for."""

    def __init__(self, function: BatchObjective, evaluations: int) -> None:
        """Take the function, and how often it may be evaluated."""
        self.left = evaluations
        self.least = float("inf")
        self._function = function

    def __call__(self, points: Floats) -> Floats:
        """Evaluate points; raise when some are beyond the budget."""
        if self.left <= 0:
            raise _SpentError
        values = self._function(points[: self.left])
        self.left -= len(points)
        self.least = min(self.least, float(np.min(values)))
        if self.left < 0:
            raise _SpentError
        return values


Search = Callable[[Budget, Floats, Floats, int], None]


@dataclass(frozen=True, slots=True)
class Row:
    """The errors of every search, one for each seed, on one function."""

    function: str
    dimensions: int
    evaluations: int
    errors: dict[str, tuple[float, ...]]

    def median(self, search: str) -> float:
        """Return the middle error of a search."""
        return statistics.median(self.errors[search])

    def solved(self, search: str) -> int:
        """Return how many of its runs came within SOLVED of the optimum."""
        return sum(error <= SOLVED for error in self.errors[search])

    def winner(self) -> str:
        """Name the search that solved most runs; of equals the one with the least median error."""
        return min(self.errors, key=lambda search: (-self.solved(search), self.median(search)))


def fish(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Search with the fish swarm's standard settings."""
    settings = SwarmSettings(seed=seed, iterations=MOST_ITERATIONS // 10, most_evaluations=budget.left)
    minimise(budget, low, high, settings)


def differential_evolution(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Search with scipy's differential evolution."""
    from scipy import optimize  # noqa: PLC0415 - takes half a second, and only the comparison needs it

    optimize.differential_evolution(
        lambda points: budget(points.T),
        list(zip(low, high, strict=True)),
        maxiter=budget.left,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(seed),
    )


def cma_es(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
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
            asked = search.ask()
            search.tell(asked, list(budget(low + np.array(asked) * span)))


def chance(budget: Budget, low: Floats, high: Floats, seed: int) -> None:
    """Draw points evenly from the box."""
    budget(np.random.default_rng(seed).uniform(low, high, (budget.left, low.size)))


SEARCHES: dict[str, Search] = {"fish": fish, "DE": differential_evolution, "CMA-ES": cma_es, "chance": chance}


def compare(
    functions: Sequence[StandardFunction], dimensions: int, evaluations: int, seeds: Sequence[int]
) -> list[Row]:
    """Let every search try every function, once for each seed."""
    rows = []
    for row in functions:
        low, high = np.full(dimensions, row.low), np.full(dimensions, row.high)
        errors = {
            name: tuple(error(search, row.function, low, high, evaluations, seed) for seed in seeds)
            for name, search in SEARCHES.items()
        }
        rows.append(Row(row.name, dimensions, evaluations, errors))
    return rows


def error(search: Search, function: BatchObjective, low: Floats, high: Floats, evaluations: int, seed: int) -> float:
    """Return the least value that a search finds within the evaluations."""
    budget = Budget(function, evaluations)
    with warnings.catch_warnings():
        # Both others warn of converged or flat populations, which their restarts deal with.
        warnings.simplefilter("ignore")
        try:
            search(budget, low, high, seed)
        except _SpentError:
            pass
    return budget.least


def text(rows: Sequence[Row], runs: int) -> str:
    """Return the table: median error, runs solved, and who did best."""
    head = (*COLUMNS, *(f"{name} error (solved)" for name in SEARCHES), "best")
    cells = [head]
    for row in rows:
        found = (f"{row.median(name):.1e} ({row.solved(name)}/{runs})" for name in SEARCHES)
        cells.append((row.function, str(row.dimensions), str(row.evaluations), *found, row.winner()))
    widths = [max(len(line[column]) for line in cells) for column in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in cells]
    wins = ", ".join(f"{name} {sum(row.winner() == name for row in rows)}" for name in SEARCHES)
    lines.append(f"error: median of {runs} seeded runs; solved: error up to {SOLVED:g}; best of {len(rows)}: {wins}")
    return "\n".join(lines)


def standard_table(dimensions: Sequence[int], per_dimension: int, runs: int) -> list[Row]:
    """Compare on all standard functions, with a budget in proportion to the dimensions."""
    return [row for d in dimensions for row in compare(TABLE, d, per_dimension * d, range(1, runs + 1))]
