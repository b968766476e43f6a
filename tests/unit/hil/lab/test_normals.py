"""Normal numbers of compiled code are identical to those of numpy."""

import numpy as np
import pytest

from hil.lab import normals

pytestmark = pytest.mark.timeout(300)  # compiles


@pytest.mark.parametrize("seed", range(3))
def test_numbers_and_final_state_equal_those_of_numpy(seed):
    source, numbers = np.random.Generator(np.random.PCG64(seed)), np.zeros(500_000)
    state = normals.state_of(source)
    normals.fill(state, numbers)
    assert np.array_equal(numbers, source.standard_normal(numbers.size))
    assert np.array_equal(state, normals.state_of(source))
    assert np.abs(numbers).max() > normals.TAIL  # so that numbers of the tail are compared


def test_draw_normals_does_not_advance_the_generator():
    source = np.random.Generator(np.random.PCG64(4))
    assert np.array_equal(normals.draw_normals(source, 10), source.standard_normal(10))
