"""A quotient by an inverse has the bits of the division."""

import numpy as np
import pytest

from hil.lab import lane_division
from hil.lab.compiled import compiled_here
from hil.lab.lane_division import inverse_rest, quotient
from hil.lab.lane_rows import lanes_of, put_lanes
from hil.lab.lanes import COUNT

pytestmark = pytest.mark.timeout(300)  # compiles

NUMBERS = 200_000


def divide_all(numbers, divisors, found):
    for row in range(numbers.shape[0]):
        divisor = lanes_of(divisors, row)
        inverse = 1.0 / divisor
        by = quotient(lanes_of(numbers, row), divisor, inverse, inverse_rest(divisor, inverse))
        put_lanes(found, row, by)


def divided(numbers, divisors, compute):
    shape, found = (-1, COUNT), np.zeros(numbers.size)
    compute(numbers.reshape(shape), divisors.reshape(shape), found.reshape(shape))
    return found.view(np.uint64).tolist()


def drawn(seed):
    source = np.random.default_rng(seed)
    sizes = 10.0 ** source.uniform(-80.0, 80.0, (2, NUMBERS))
    return source.choice((1.0, -1.0), NUMBERS) * sizes[0], sizes[1]


@pytest.mark.parametrize("processor", ["", "+sse2"])
def test_a_quotient_is_rounded_as_a_division_rounds_it(monkeypatch, processor):
    if processor:  # one that rounds a product before it adds to it
        monkeypatch.setattr(lane_division.config, "CPU_FEATURES", processor)
    compute = compiled_here(divide_all)
    for numbers, divisors in (drawn(1), drawn(2)):
        assert divided(numbers, divisors, compute) == (numbers / divisors).view(np.uint64).tolist()


def test_quotients_that_lie_almost_between_two_numbers_are_rounded_to_the_nearer():
    # Divisors a little below a power of two, and above it, have the inverses that are hardest to round.
    steps = np.arange(1.0, NUMBERS + 1.0)
    divisors = np.where(steps % 2.0 > 0.0, 2.0 - 2.0**-52 * steps, 1.0 + 2.0**-52 * steps)
    middles = (1.0 + 2.0**-52 * steps[::-1]) * divisors
    compute = compiled_here(divide_all)
    for numbers in (middles, np.nextafter(middles, 9.0), np.nextafter(middles, 0.0), 1.0 + 0.0 * steps):
        assert divided(numbers, divisors, compute) == (numbers / divisors).view(np.uint64).tolist()


def test_nothing_by_something_is_nothing_of_the_same_sign():
    numbers, divisors = np.array([0.0, -0.0] * (COUNT // 2)), np.full(COUNT, 3.0)
    found = divided(numbers, divisors, compiled_here(divide_all))
    assert found == numbers.view(np.uint64).tolist()
