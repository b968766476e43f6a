"""Ratios to the bare limit, targets, percentiles and pairs of runs."""

import math
import random

import numpy as np
import pytest

from hil.bench.figure import Figure, paired_figure, percentile


@pytest.mark.parametrize(
    ("figure", "met"),
    [
        (Figure("x", "ms", 2.0, maximum=2.0), True),
        (Figure("x", "ms", 2.1, maximum=2.0), False),
        (Figure("x", "us", 500.0, 100.0, maximum_ratio=5.0), True),
        (Figure("x", "us", 501.0, 100.0, maximum_ratio=5.0), False),
        (Figure("x", "us", 1.0, None, maximum_ratio=5.0), False),
        (Figure("x", "us", float("nan"), 100.0, maximum_ratio=5.0), False),
        (Figure("x", "us", float("nan"), maximum=5.0), False),
        (Figure("x", "us", 1e9, 1.0), None),
        (Figure("x", "times", 15.0, minimum=15.0), True),
        (Figure("x", "times", 14.9, minimum=15.0), False),
        (Figure("x", "times", float("nan"), minimum=15.0), False),
        (Figure("x", "us", 1.0, 1.0, maximum_ratio=0.5, paired_ratio=0.4), True),
        (Figure("x", "us", 0.1, 1.0, maximum_ratio=0.5, paired_ratio=0.6), False),
    ],
)
def test_target_is_met_up_to_its_limit(figure, met):
    assert figure.met is met


def test_figure_without_a_bare_limit_has_no_ratio():
    assert Figure("x", "ms", 3.0, 2.0).ratio == 1.5
    assert Figure("x", "ms", 3.0).ratio is None
    assert Figure("x", "ms", 3.0, 0.0).ratio is None


def test_percentiles_equal_numpy():
    rng = random.Random(3)
    samples = [rng.expovariate(1.0) for _ in range(997)]
    for percent in (0.0, 50.0, 95.0, 99.9, 100.0):
        assert percentile(samples, percent) == pytest.approx(np.percentile(samples, percent))
    assert percentile([2.0, 1.0], 25.0) == 1.25
    assert percentile([7.0], 99.0) == 7.0
    assert math.isnan(percentile([], 50.0))


def test_paired_ratio_is_the_median_of_neighbours():
    # During the second pair the machine is ten times slower.
    ours, bare = iter([1.0, 10.0, 1.1]), iter([2.0, 20.0, 2.0])
    order = []
    run_ours, run_bare = lambda: order.append("ours") or next(ours), lambda: order.append("bare") or next(bare)
    figure = paired_figure("x", "ms", run_ours, run_bare, 3, 1e3)
    assert order == ["ours", "bare"] * 3
    assert (figure.value, figure.bare, figure.ratio) == (1100.0, 2000.0, 0.5)
