"""The standard functions that searches are tried on, each with its usual box.

Those whose optimum usually lies in the middle of the box are shifted out of it, by a different
part of the box in each coordinate: a search that drifts to the middle must not look good.
All take points (m, d) and return m values; the least value is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil.lab.swarm.records import BatchObjective, Floats

SCHWEFEL_PLACE = 420.968746359982
SCHWEFEL_VALUE = 418.98288727243374


@dataclass(frozen=True, slots=True)
class StandardFunction:
    """A function, the ends of its box in every coordinate, and what makes it hard."""

    name: str
    function: BatchObjective
    low: float
    high: float
    text: str


def optimum(name: str, dimensions: int) -> Floats:
    """Return where the least value of a function lies."""
    if name == "schwefel":
        return np.full(dimensions, SCHWEFEL_PLACE)
    if name == "rosenbrock":
        return np.ones(dimensions)
    row = next(row for row in TABLE if row.name == name)
    return np.asarray(_shift(dimensions) * (row.high - row.low))


def _shift(dimensions: int) -> Floats:
    """Return the shift in parts of the box: from -0.35 to 0.35, spread evenly by the golden ratio."""
    return np.asarray(0.7 * ((np.arange(1, dimensions + 1) * 0.618033988749895) % 1.0 - 0.5))


def sphere(points: Floats) -> Floats:
    """Sum of squares: smooth and round."""
    way = points - optimum("sphere", points.shape[1])
    return np.sum(way**2, axis=1)  # type: ignore[no-any-return]


def rosenbrock(points: Floats) -> Floats:
    """A curved, flat valley."""
    here, after = points[:, :-1], points[:, 1:]
    return np.sum(100.0 * (after - here**2) ** 2 + (1.0 - here) ** 2, axis=1)  # type: ignore[no-any-return]


def rastrigin(points: Floats) -> Floats:
    """A bowl with a regular lattice of some 10^d hollows."""
    way = points - optimum("rastrigin", points.shape[1])
    return np.sum(way**2 - 10.0 * np.cos(2.0 * math.pi * way) + 10.0, axis=1)  # type: ignore[no-any-return]


def ackley(points: Floats) -> Floats:
    """A nearly flat plain of hollows around a funnel."""
    way = points - optimum("ackley", points.shape[1])
    far = np.sqrt(np.mean(way**2, axis=1))
    ripple = np.mean(np.cos(2.0 * math.pi * way), axis=1)
    return np.maximum(-20.0 * np.exp(-0.2 * far) - np.exp(ripple) + 20.0 + math.e, 0.0)  # type: ignore[no-any-return]


def griewank(points: Floats) -> Floats:
    """A wide bowl with many shallow hollows that hang together."""
    way = points - optimum("griewank", points.shape[1])
    number = np.sqrt(np.arange(1, points.shape[1] + 1))
    return np.sum(way**2, axis=1) / 4000.0 - np.prod(np.cos(way / number), axis=1) + 1.0  # type: ignore[no-any-return]


def schwefel(points: Floats) -> Floats:
    """Deep hollows whose best lies in a corner, far from the second best."""
    waves = points * np.sin(np.sqrt(np.abs(points)))
    return np.sum(SCHWEFEL_VALUE - waves, axis=1)  # type: ignore[no-any-return]


TABLE = (
    StandardFunction("sphere", sphere, -5.12, 5.12, "smooth and round"),
    StandardFunction("rosenbrock", rosenbrock, -2.048, 2.048, "a curved, flat valley"),
    StandardFunction("rastrigin", rastrigin, -5.12, 5.12, "a bowl with a lattice of hollows"),
    StandardFunction("ackley", ackley, -32.768, 32.768, "a plain of hollows around a funnel"),
    StandardFunction("griewank", griewank, -600.0, 600.0, "a wide bowl with shallow hollows"),
    StandardFunction("schwefel", schwefel, -500.0, 500.0, "deep hollows, the best in a corner"),
)
