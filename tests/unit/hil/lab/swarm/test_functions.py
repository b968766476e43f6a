"""The standard functions, and what the fish find on them."""

import numpy as np
import pytest

from hil.lab.swarm import SwarmSettings, minimise
from hil.lab.swarm.comparison import TABLE, optimum


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
@pytest.mark.parametrize("dimensions", [2, 5])
def test_the_minimum_is_zero_at_the_optimum(row, dimensions):
    best = optimum(row.name, dimensions)
    assert np.all((best > row.low) & (best < row.high))
    assert row.function(best[None])[0] == pytest.approx(0.0, abs=1e-9)
    rng = np.random.default_rng(1)
    others = np.clip(best + rng.normal(0.0, 0.02 * (row.high - row.low), (1000, dimensions)), row.low, row.high)
    assert np.all(row.function(others) > 1e-6)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_the_optimum_is_not_in_the_middle_of_the_box(row):
    middle = 0.5 * (row.low + row.high)
    assert np.all(np.abs(optimum(row.name, 5) - middle) > 0.01 * (row.high - row.low))


# The largest error of ten seeds is held below these, of budgets of 6000 evaluations in 2 dimensions.
REACHED = {"sphere": 1e-4, "ackley": 0.1, "griewank": 0.2, "rosenbrock": 0.1, "rastrigin": 2.0, "schwefel": 250.0}


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_the_fish_come_close_in_two_dimensions(row):
    errors = [
        minimise(
            row.function,
            [row.low] * 2,
            [row.high] * 2,
            SwarmSettings(iterations=10_000, max_evaluations=6000, seed=seed),
        ).best_value
        for seed in range(10)
    ]
    assert max(errors) < REACHED[row.name]


# Not Schwefel's: there the fish do worse than chance in 5 dimensions (median error 692 to 469 over these seeds,
# 476 to 469 with an earlier choice of settings), for its second-best hollow is far from the best and they
# gather in whichever they find first. `rambler-hil swarm-table` shows it.
BETTER_THAN_CHANCE = [row for row in TABLE if row.name != "schwefel"]


def random_search(row, dimensions, evaluations, seed):
    points = np.random.default_rng(seed).uniform(row.low, row.high, (evaluations, dimensions))
    return float(row.function(points).min())


@pytest.mark.proof
@pytest.mark.parametrize("row", BETTER_THAN_CHANCE, ids=lambda row: row.name)
def test_the_fish_do_better_than_chance_in_five_dimensions(row):
    found, chance = [], []
    for seed in range(5):
        settings = SwarmSettings(iterations=10_000, max_evaluations=6000, seed=seed)
        found.append(minimise(row.function, [row.low] * 5, [row.high] * 5, settings).best_value)
        chance.append(random_search(row, 5, 6000, seed))
    assert np.median(found) < np.median(chance)


def test_shrinking_is_what_ends_the_stall_near_the_optimum():
    row = TABLE[0]

    def error(shrink):
        settings = SwarmSettings(iterations=10_000, max_evaluations=6000, shrink=shrink)
        return minimise(row.function, [row.low] * 2, [row.high] * 2, settings).best_value

    assert error(1e-4) < 1e-3 * error(1.0)
