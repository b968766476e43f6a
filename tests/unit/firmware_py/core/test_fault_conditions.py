"""Faults of two compasses: frozen, jumping, disagreeing."""

import math
import random

import pytest

from firmware_py.common.angles import radians
from firmware_py.core.fault_conditions import find_compass_faults
from firmware_py.estimate.sources import Source, SourceState, TrueHeadingSample, add_sample, compasses_disagree, select

FROZEN, JUMPING, DISAGREE = (True, False, False), (False, True, False), (False, False, True)
NO_FAULT, JUMPING_AND_DISAGREE = (False, False, False), (False, True, True)
FROZEN_S, TIMEOUTS_S = 30.0, (1.0, 1.0)


class Compasses:
    """Two compasses at 10 Hz, and their faults."""

    def __init__(self):
        self.state, self.rng, self.ticks = SourceState(), random.Random(3), 0

    def run(self, seconds, a_deg=0.0, b_deg=0.0, *, spread_deg=0.3):
        """Run with compass headings that differ from the estimate (None: no data); return the changes of the faults."""
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
            faults = (*find_compass_faults(FROZEN_S, self.state, TIMEOUTS_S, now_s), compasses_disagree(self.state))
            reports += [faults] if reports[-1:] != [faults] else []
        return reports


@pytest.mark.parametrize("off_deg", [16.0, 18.0, 22.0, 25.0, -24.0, 90.0])
def test_compasses_that_differ_from_the_start_disagree_without_a_jump(off_deg):
    compasses = Compasses()
    assert compasses.run(60.0, b_deg=off_deg)[-1] == DISAGREE
    assert compasses.state.in_use is Source.COMPASS_A
    assert JUMPING not in (reports := compasses.run(60.0, b_deg=off_deg))
    assert JUMPING_AND_DISAGREE not in reports
    compasses.run(20.0)
    assert compasses.run(20.0) == [NO_FAULT]


def test_compasses_that_drift_apart_disagree_without_a_jump():
    compasses = Compasses()
    compasses.run(20.0)
    reports = [compasses.run(5.0, b_deg=float(off_deg)) for off_deg in range(41)]
    assert reports[-1] == [DISAGREE]
    assert not any(JUMPING in faults or JUMPING_AND_DISAGREE in faults for faults in reports)
    compasses.run(20.0, b_deg=18.0)
    assert compasses.run(20.0, b_deg=18.0) == [DISAGREE]


def test_sudden_difference_is_a_jump_and_later_also_a_disagreement():
    compasses = Compasses()
    compasses.run(20.0)
    assert compasses.run(1.0, b_deg=22.0) == [NO_FAULT]
    assert compasses.run(60.0, b_deg=22.0) == [NO_FAULT, JUMPING, JUMPING_AND_DISAGREE]
    compasses.run(20.0)
    assert compasses.run(20.0) == [NO_FAULT]
    compasses.run(5.0, a_deg=180.0)
    assert compasses.run(5.0, a_deg=180.0) == [JUMPING_AND_DISAGREE]
    assert compasses.state.in_use is Source.COMPASS_B


def test_compass_with_random_headings_jumps():
    compasses = Compasses()
    compasses.run(20.0)
    assert any(jumping for _, jumping, _ in compasses.run(60.0, b_deg=180.0, spread_deg=80.0))


def test_compass_without_data_does_not_disagree_and_a_single_one_can_jump():
    compasses = Compasses()
    compasses.run(20.0, b_deg=25.0)
    assert compasses.run(30.0, a_deg=None, b_deg=25.0)[-1] == JUMPING
    assert compasses.run(5.0, a_deg=0.0, b_deg=None)[-1] == NO_FAULT
