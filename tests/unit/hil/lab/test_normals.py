"""Normal numbers in compiled code are numpy's, to the last bit."""

import numpy as np
import pytest

from hil.lab import normals

pytestmark = pytest.mark.timeout(300)  # compiles


@pytest.mark.parametrize("seed", range(3))
def test_the_numbers_are_numpy_s_and_so_is_what_comes_after_them(seed):
    source, found = np.random.Generator(np.random.PCG64(seed)), np.zeros(500_000)
    state = normals.state_of(source)
    normals.fill(state, found)
    assert np.array_equal(found, source.standard_normal(found.size))
    assert np.array_equal(state, normals.state_of(source))
    assert np.abs(found).max() > normals.TAIL  # the rare ones too


def test_numbers_are_drawn_without_moving_the_generator():
    source = np.random.Generator(np.random.PCG64(4))
    assert np.array_equal(normals.drawn(source, 10), source.standard_normal(10))
