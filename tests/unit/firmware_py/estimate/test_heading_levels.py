"""The noise levels of the heading filter after a scoring step: plain floats, which a checkpoint can hold."""

import pytest

from firmware_py.estimate import heading_filter
from firmware_py.estimate.heading_filter import LONGEST_MOVE, PRIOR


@pytest.mark.parametrize("score", [0.01, 100.0])
def test_a_step_of_the_levels_is_limited_and_of_floats(score):
    flat = (0.0,) * 21
    levels = heading_filter.stepped(PRIOR, flat, (score,) * 6, 15.0, 600.0)
    moves = [abs(after - before) for after, before in zip(levels, PRIOR, strict=True)]
    assert {type(level) for level in levels} == {float}
    assert 0.0 < max(moves) <= LONGEST_MOVE + 1e-12
