"""Normal numbers of compiled code are identical to those of numpy."""

import numpy as np
import pytest

from hil.lab import normals

pytestmark = pytest.mark.timeout(300)  # compiles


@pytest.mark.parametrize("seed", range(3))
def test_numbers_and_final_state_are_those_of_numpy(seed):
    source, found = np.random.Generator(np.random.PCG64(seed)), np.zeros(500_000)
    state = normals.state_of(source)
    normals.fill(state, found)
    assert np.array_equal(found, source.standard_normal(found.size))
    assert np.array_equal(state, normals.state_of(source))
    assert np.abs(found).max() > normals.TAIL  # also the tail


def test_drawing_does_not_advance_the_generator():
    source = np.random.Generator(np.random.PCG64(4))
    assert np.array_equal(normals.drawn(source, 10), source.standard_normal(10))
