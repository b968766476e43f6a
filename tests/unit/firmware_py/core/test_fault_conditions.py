"""Faults of two compasses: which is frozen, which jumps, and whether they disagree."""

import math
import random

import pytest

from firmware_py.common.angles import radians
from firmware_py.core.fault_conditions import frozen_or_jumping
from firmware_py.estimate.sources import Source, SourceState, TrueHeadingSample, add_sample, compasses_disagree, select

FROZEN, JUMPING, DISAGREE = (True, False, False), (False, True, False), (False, False, True)
WELL, BOTH = (False, False, False), (False, True, True)
FROZEN_S, TIMEOUTS_S = 30.0, (1.0, 1.0)


class Compasses:
    """Two compasses around an estimate, ten times a second, and what was said of them."""

    def __init__(self):
        self.state, self.rng, self.ticks = SourceState(), random.Random(3), 0

    def run(self, seconds, a_deg=0.0, b_deg=0.0, *, spread_deg=0.3):
        """Go on with each so far off the estimate, None is silent; return what was said, each once, in order."""
        reports = []
        for _ in range(round(10 * seconds)):
            expected_rad = 1.0 if self.ticks else math.nan
            self.ticks += 1
            now_s = 0.1 * self.ticks
            for source, off_deg in ((0, a_deg), (1, b_deg)):
                if off_deg is not None:
                    heading_rad = 1.0 + radians(self.rng.gauss(off_deg, spread_deg if source else 0.3))
                    sample = TrueHeadingSample(now_s, heading_rad, heading_rad, source)
                    self.state = add_sample(self.state, sample, expected_rad)
            self.state = select(self.state, now_s, FROZEN_S, TIMEOUTS_S, False)
            found = (*frozen_or_jumping(FROZEN_S, self.state, TIMEOUTS_S, now_s), compasses_disagree(self.state))
            reports += [found] if reports[-1:] != [found] else []
        return reports


@pytest.mark.parametrize("off_deg", [16.0, 18.0, 22.0, 25.0, -24.0, 90.0])
def test_compasses_that_differ_from_the_start_disagree_without_a_jump(off_deg):
    both = Compasses()
    assert both.run(60.0, b_deg=off_deg)[-1] == DISAGREE
    assert both.state.in_use is Source.COMPASS_A
    assert JUMPING not in (reports := both.run(60.0, b_deg=off_deg))
    assert BOTH not in reports
    both.run(20.0)
    assert both.run(20.0) == [WELL]


def test_compasses_that_drift_apart_disagree_without_a_jump():
    both = Compasses()
    both.run(20.0)
    reports = [both.run(5.0, b_deg=float(off_deg)) for off_deg in range(41)]
    assert reports[-1] == [DISAGREE]
    assert not any(JUMPING in one or BOTH in one for one in reports)
    both.run(20.0, b_deg=18.0)
    assert both.run(20.0, b_deg=18.0) == [DISAGREE]


def test_a_sudden_difference_is_a_jump_and_then_also_a_disagreement():
    both = Compasses()
    both.run(20.0)
    assert both.run(1.0, b_deg=22.0) == [WELL]
    assert both.run(60.0, b_deg=22.0) == [WELL, JUMPING, BOTH]
    both.run(20.0)
    assert both.run(20.0) == [WELL]
    both.run(5.0, a_deg=180.0)
    assert both.run(5.0, a_deg=180.0) == [BOTH]
    assert both.state.in_use is Source.COMPASS_B


def test_a_compass_with_random_headings_jumps():
    both = Compasses()
    both.run(20.0)
    assert any(jumping for _, jumping, _ in both.run(60.0, b_deg=180.0, spread_deg=80.0))


def test_a_silent_compass_does_not_disagree_and_a_single_one_can_jump():
    both = Compasses()
    both.run(20.0, b_deg=25.0)
    assert both.run(30.0, a_deg=None, b_deg=25.0)[-1] == JUMPING
    assert both.run(5.0, a_deg=0.0, b_deg=None)[-1] == WELL
