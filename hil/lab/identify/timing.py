"""How long the search's objective takes, for `rambler-hil bench`."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from hil.lab.identify.digest import digests
from hil.lab.identify.objective import output_error
from hil.lab.identify.recording import Floats
from hil.lab.identify.search import scan
from hil.lab.identify.stretch import Data

REPEATS = 5


def objective(data: Data, fish: int) -> tuple[Callable[[], None], int, Floats]:
    """Return the search's objective of so many fish on data, to be called; its samples; and where it puts the values.

    It is what the swarm calls: objective.output_error on the averaged log.
    """
    record = digests(data)[-1]
    box = scan(record)
    low, high = box.bounds(cubic=True)
    points = box.points(low + (high - low) * np.random.default_rng(0).random((fish, low.size)))
    values = np.empty(fish)
    arguments = record.arguments(box.sign)

    def call() -> None:
        output_error(points, values, *arguments)

    call()
    return call, int(record.flags.size), values


def nanoseconds_per_sample_and_fish(data: Data, fish: int = 64) -> float:
    """Return the least of a few measurements of the objective, compiled beforehand."""
    call, samples, _ = objective(data, fish)
    best_s = np.inf
    for _ in range(REPEATS):
        began_s = time.perf_counter()
        call()
        best_s = min(best_s, time.perf_counter() - began_s)
    return float(best_s / (samples * fish) * 1e9)
