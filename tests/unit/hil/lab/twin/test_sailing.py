"""Runs of the twin beside each other: each has the bits that it has alone."""

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from hil.lab.lanes import COUNT
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.scenarios import sea_of
from hil.sim.goals import parse_goals

pytestmark = pytest.mark.timeout(600)  # the twin is compiled first

SECONDS = 90.0
# Unlike in everything: ships, devices, delays, seas of long crests and short, a receiver that never has a fix.
SEAS = ("ocean-1", "ocean-4", "calm", "gusts", "swell+kt=0.5:2,delay=2", "sea+float=0.3:0.6,receiver=0:1", "ocean-3")


def runs_of(texts):
    for number, text in enumerate(texts):
        told = ParameterSet().replaced("RUD_REVERSE", float(number % 2)).replaced("CTL_PRICE", 1.0 + 0.5 * number)
        goals = parse_goals(("0:0,30:60", "0:170", "20:-90,40:-80,60:0")[number % 3])
        sea = drawn(sea_of(text), number + 1, SECONDS)
        yield sailing.Run(sailing.boat_of(told), sailing.law_of(told), sea, sailing.task_of(goals))


def test_runs_beside_each_other_have_the_bits_that_each_has_alone():
    runs = list(runs_of((*SEAS, "ocean-2") * (COUNT // 8)))
    assert len(runs) == COUNT
    record, ticks = sailing.sail_beside(runs, SECONDS, ticks=True)
    for number, run in enumerate(runs):
        alone, count = sailing.sail(*run, SECONDS)
        assert ticks[number] == count
        for ours, theirs in zip(record, alone, strict=True):
            assert np.array_equal(ours[number], theirs, equal_nan=True)
    assert len({row.tobytes() for row in record.rudder_rad}) == COUNT


def test_a_batch_need_not_be_full_and_keeps_no_ticks_unless_asked_for():
    runs = list(runs_of(SEAS[:3]))
    record, ticks = sailing.sail_beside(runs, SECONDS, ticks=False)
    assert record.ticks.size == 0
    for number, run in enumerate(runs):
        alone, count = sailing.sail(*run, SECONDS)
        assert (ticks[number], record.rudder_rad[number].tobytes()) == (count, alone.rudder_rad.tobytes())
