"""Numbers side by side: what is computed of them is what is computed of each."""

import numpy as np
import pytest

from firmware_py.model.kt import rk4_step
from hil.lab.compiled import compiled_here
from hil.lab.lane_rows import ALIGNED_BYTES, aligned, lanes_of, lent, put_lanes
from hil.lab.lanes import COUNT, lanes, let, where

pytestmark = pytest.mark.timeout(300)  # compiles


@compiled_here
def computed(given, found):
    a, b, c = lanes_of(given, 0), lanes_of(given, 1), lanes_of(given, 2)
    put_lanes(found, 0, a + b * c)
    put_lanes(found, 1, 2.0 * a - b / c)
    put_lanes(found, 2, -a)
    put_lanes(found, 3, where(a - b, a, 3))
    turned, rate = rk4_step(a, b, c, 0.02, 0.05, 4.0, 17.0, 0.01)
    put_lanes(found, 4, turned)
    put_lanes(found, 5, rate)


def test_every_lane_has_the_bits_that_it_has_alone():
    given, found = np.random.default_rng(1).normal(size=(3, COUNT)), np.zeros((6, COUNT))
    computed(given, found)
    for lane, (a, b, c) in enumerate(given.T.tolist()):
        turned, rate = rk4_step(a, b, c, 0.02, 0.05, 4.0, 17.0, 0.01)
        alone = [a + b * c, 2.0 * a - b / c, -a, a if a > b else 3.0, turned, rate]
        assert found[:, lane].tolist() == alone


class Negative:
    """A function as numpy before 2.2 has them: no one knows of which module."""

    def __call__(self, number):
        return -number

    def __getattribute__(self, name):
        if name == "__module__":
            raise AttributeError(name)
        return super().__getattribute__(name)


def test_a_function_of_no_module_has_a_meaning_for_lanes():
    negative = Negative()
    let(negative, lambda _context, builder, number: builder.fneg(number), lanes, lanes)

    @compiled_here
    def computed(numbers):
        put_lanes(numbers, 1, negative(lanes_of(numbers, 0)))

    numbers = np.ones((2, COUNT))
    computed(numbers)
    assert numbers[1].tolist() == [-1.0] * COUNT


@compiled_here
def copied(given, found):
    for row in range(6):
        put_lanes(found, row, lanes_of(lent(given), row))


def test_rows_are_counted_through_all_axes_but_the_last():
    given, found = np.arange(6.0 * COUNT).reshape(2, 3, COUNT), np.zeros((6, COUNT))
    copied(given, found)
    assert np.array_equal(found, given.reshape(6, COUNT))


def test_what_is_none_is_not_above_zero():
    @compiled_here
    def chosen(numbers):
        put_lanes(numbers, 1, where(lanes_of(numbers, 0), 1.0, 2.0))

    numbers = np.zeros((2, COUNT))
    numbers[0, :4] = np.nan, np.inf, 1e-300, -0.0
    chosen(numbers)
    assert numbers[1, :4].tolist() == [2.0, 1.0, 1.0, 2.0]


def test_records_begin_where_a_register_does():
    kind = np.dtype([("p", np.float64, (3,))])
    rooms = [aligned(kind, 5) for _ in range(4)]
    for room in rooms:
        assert (room.ctypes.data % ALIGNED_BYTES, room.size, room["p"].any()) == (0, 5, False)
