"""Percentiles, against numpy's and at the edges."""

import math
import random

import numpy as np
import pytest

from hil.bench.spread import percentile, spread


def test_percentiles_are_numpys():
    chances = random.Random(3)
    samples = [chances.expovariate(1.0) for _ in range(997)]
    found = spread(samples)
    wanted = np.percentile(samples, [50.0, 95.0, 99.0, 99.9, 100.0])
    assert (found.p50, found.p95, found.p99, found.p999, found.max) == pytest.approx(tuple(wanted))
    assert found.count == 997


def test_one_sample_is_all_its_percentiles():
    found = spread([7.0])
    assert (found.p50, found.p999, found.max) == (7.0, 7.0, 7.0)


def test_between_two_samples_it_is_linear():
    assert percentile([1.0, 2.0], 25.0) == 1.25


def test_of_nothing_there_is_no_number():
    found = spread([])
    assert found.count == 0
    assert math.isnan(found.p50)
    assert math.isnan(found.max)
