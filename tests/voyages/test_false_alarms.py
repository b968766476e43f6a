"""No false fault in hours of turns in each sea."""

import math
import random

import pytest

from firmware_py.common.intents import SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.faults.table import Fault
from support import rig

LEG_S = 600.0
ALLOWED = {Fault.CURRENT_STRONG}  # correct in a storm


def faults_of(name, seed, legs, leg_s=LEG_S):
    """Steer to a new heading for each leg, and return all faults that were active at any time."""
    boat = rig.Sailing(rig.sea(name), seed).get_under_way(Mode.GUIDED)
    rng, goal_rad, fault_bits = random.Random(seed), 0.0, 0
    for _ in range(legs):
        goal_rad += math.radians(rng.uniform(-120.0, 120.0))
        boat.tick(SteerHeading(goal_rad))
        for _ in range(round(10.0 * leg_s) - 1):
            boat.tick()
            fault_bits |= boat.snapshot.faults
    return {fault for fault in Fault if fault_bits >> fault & 1} - ALLOWED


def test_no_fault_in_a_swell():
    assert not faults_of("swell", 1, 2, leg_s=150.0)


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", ["tank", "sea", "swell", "weak", "storm", "gusts", "surge"])
def test_no_fault_in_hours_of_each_sea(name, seed):
    assert not faults_of(name, seed, 12)
