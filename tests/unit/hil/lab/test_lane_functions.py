"""exp, sine, cosine, tanh and log1p of numbers side by side have the bits that Python gives them."""

import math
import random

import numpy as np
import pytest

from hil.lab import lane_math  # noqa: F401 - gives the functions their meaning for lanes
from hil.lab.compiled import compiled_here
from hil.lab.lane_functions import (
    ANGLE_REACH,
    ANGLES,
    EXP_REACH,
    HALF_TURN,
    LOG1P_ABOVE,
    LOG1P_REACH,
    NEXT_ABOVE,
    NEXT_BELOW,
    NO_LN2,
    ONE_LN2,
    PLAIN,
    SMALL,
    TANH_REACH,
    TINY,
    UNHALVED,
    angles,
    powers,
)
from hil.lab.lane_rows import lanes_of, put_lanes
from hil.lab.lanes import COUNT

pytestmark = pytest.mark.timeout(300)  # compiles

EDGES = [0.0, 5e-324, 1e-310, 2.0**-54, 2.0**-27, SMALL, PLAIN, 1.0, math.pi / 4, math.pi / 2, HALF_TURN, math.pi, 7.0]
EDGES += [0.5 * NO_LN2, 0.5 * ONE_LN2, 0.75, 5.0]
BATCHES = 500


@compiled_here
def each(given, found):
    for row in range(given.shape[0]):
        number = lanes_of(given, row)
        put_lanes(found, 4 * row, math.exp(number))
        put_lanes(found, 4 * row + 1, math.sin(number))
        put_lanes(found, 4 * row + 2, math.cos(number))
        put_lanes(found, 4 * row + 3, math.tanh(number))


@compiled_here
def logarithms(given, found):
    for row in range(given.shape[0]):
        put_lanes(found, row, math.log1p(lanes_of(given, row)))


def computed(numbers):
    """Return exp, sine, cosine and tanh of numbers, which are computed a batch at a time."""
    given = np.resize(np.array(numbers), (-(-len(numbers) // COUNT), COUNT))
    found = np.zeros((4 * len(given), COUNT))
    each(given, found)
    return found.reshape(-1, 4, COUNT).swapaxes(0, 1).reshape(4, -1)[:, : len(numbers)]


def differ(numbers):
    """Return the numbers of which a function differs from Python's."""
    alone = [[function(number) for number in numbers] for function in (math.exp, math.sin, math.cos, math.tanh)]
    other = np.array(alone).view(np.uint64) != np.ascontiguousarray(computed(numbers)).view(np.uint64)
    return [numbers[k] for k in np.flatnonzero(other.any(0))]


@pytest.mark.parametrize("reach", [SMALL, PLAIN, TANH_REACH, 3.0, EXP_REACH])
def test_what_is_within_reach_has_the_bits_of_python(reach):
    source = random.Random(5)
    assert differ([source.uniform(-reach, reach) for _ in range(BATCHES * COUNT)]) == []


def test_small_numbers_and_edges_have_the_bits_of_python():
    source = random.Random(6)
    edges = [sign * near for edge in EDGES for near in (edge, math.nextafter(edge, 9.0)) for sign in (1.0, -1.0)]
    small = [source.choice((1.0, -1.0)) * 10.0 ** source.uniform(-30.0, 2.0) for _ in range(BATCHES * COUNT)]
    assert differ(edges + small) == []


@pytest.mark.parametrize("far", [EXP_REACH, -EXP_REACH, 709.7, -745.2, -800.0])
def test_a_number_out_of_reach_is_computed_beside_the_others(far):
    assert differ([far, *[0.1 * lane for lane in range(COUNT - 1)]]) == []


@pytest.mark.parametrize("far", [1e6, ANGLE_REACH, -1e15, 1e300])
def test_a_huge_angle_is_computed_beside_the_others(far):
    given = [far, *[0.3 * lane for lane in range(COUNT - 1)]]
    found = computed(given)
    assert found[1].tolist() == [math.sin(number) for number in given]
    assert found[2].tolist() == [math.cos(number) for number in given]


def test_what_is_no_number_leaves_the_others_as_they_are():
    found = computed([math.nan, *[0.3 * lane for lane in range(COUNT - 1)]])
    assert np.isnan(found).sum(1).tolist() == [1, 1, 1, 1]
    assert found[1, 1:].tolist() == [math.sin(0.3 * lane) for lane in range(COUNT - 1)]


def test_a_logarithm_has_the_bits_of_python():
    source = random.Random(7)
    numbers = [source.uniform(LOG1P_ABOVE, 5.0) for _ in range(BATCHES * COUNT)]
    numbers += [source.choice((0.2, -0.2)) * 10.0 ** source.uniform(-20.0, 0.0) for _ in range(BATCHES * COUNT)]
    numbers += [10.0 ** source.uniform(0.0, 12.0) for _ in range(BATCHES * COUNT)]
    # Next to powers of two, and at every edge.
    numbers += [2.0 ** source.randrange(40) * (1.0 + source.uniform(-2e-6, 2e-6)) - 1.0 for _ in range(BATCHES * COUNT)]
    edges = [*EDGES, TINY, -TINY, UNHALVED, NEXT_ABOVE, NEXT_BELOW, 1.0 + 2.0 * NEXT_ABOVE, 1.0 + 2.0 * NEXT_BELOW]
    for edge in (*edges, LOG1P_ABOVE, LOG1P_REACH, -0.75, 1e300):
        numbers += [edge, math.nextafter(edge, math.inf), math.nextafter(edge, -math.inf)]
    numbers += [0.0] * (-len(numbers) % COUNT)
    given, found = np.array(numbers).reshape(-1, COUNT), np.zeros((len(numbers) // COUNT, COUNT))
    logarithms(given, found)
    expected = np.array([math.log1p(number) for number in numbers])
    assert np.array_equal(found.ravel().view(np.uint64), expected.view(np.uint64))


def test_the_tables_hold_what_they_are_of():
    assert powers()[:2] == (0.0, 1.0)
    sine, cosine = np.array(angles()).reshape(-1, 4)[: ANGLES + 1, ::2].T
    assert np.allclose(sine, np.sin(np.arange(ANGLES + 1) / 128.0), rtol=1e-15)
    assert np.allclose(cosine, np.cos(np.arange(ANGLES + 1) / 128.0), rtol=1e-15)
