"""A lost rudder blade is told in every sea, and never where there is a blade; so is a servo the wrong way round."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.intents import SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.faults.table import TABLE, Fault
from support import rig
from support.ill_ship import ill

SEAS = ("tank", "sea", "swell", "weak")
TOLD = TABLE[Fault.STEERING_LOST].text
TOLD_REVERSED = TABLE[Fault.STEERING_REVERSED].text
ARMED_S = 180.0  # in which a wrong servo direction is to be told
OVER_RAD = math.radians(10.0)  # a rudder so far from where it kept her straight is at work


def sailing(name, seed, **how):
    return rig.Sailing(rig.sea(name), seed, hull=ill(**how)).under_way(Mode.GUIDED)


def turning(name, seed, hours, leg_s=300.0):
    """Turns of 60 to 180 degrees, one in leg_s; return how many there were and when the fault was told."""
    boat, turns, goal_rad = sailing(name, seed), random.Random(seed), 0.0
    legs = round(hours * 3600.0 / leg_s)
    for _ in range(legs):
        goal_rad += turns.choice((-1.0, 1.0)) * math.radians(turns.uniform(60.0, 180.0))
        boat.tick(SteerHeading(goal_rad))
        boat.run(leg_s)
    return legs, boat.said(TOLD) + boat.said(TOLD_REVERSED)


def bladeless(name, seed, turn_deg, after_s=5.0, most_s=400.0):
    """Lose the blade after_s into a turn; return the seconds of rudder work until it is told, None if it is not."""
    boat = sailing(name, seed)
    boat.tick(SteerHeading(0.0))
    boat.run(240.0)
    straight_rad = math.radians(rig.sea(name).bias_deg)
    boat.tick(SteerHeading(math.radians(turn_deg)))
    boat.run(after_s)
    assert not boat.said(TOLD)
    boat.hull.grip, work_s = 0.0, 0.0
    for _ in range(round(10.0 * most_s)):
        boat.tick()
        work_s += rig.STEP_S * (abs(boat.rudder_rad - straight_rad) > OVER_RAD)
        assert not boat.said(TOLD_REVERSED)
        if boat.said(TOLD):
            return work_s
    return None


def test_a_blade_lost_as_a_turn_begins_is_told():
    """In the tank, where she is believed to have little way, it was not told in three minutes."""
    assert bladeless("tank", 1, 120.0, after_s=0.0, most_s=90.0) <= 60.0


@pytest.mark.parametrize("how", [{"delay_s": 12.0}, {"ability": 1.0 / 3.0, "lag": 3.0, "delay_s": 5.0}])
def test_a_ship_that_answers_late_is_no_ship_without_a_rudder(how):
    boat = sailing("calm", 1, **how)
    boat.run(50.0)
    boat.tick(SteerHeading(math.radians(60.0)))
    assert boat.run(60.0).said(TOLD) == []


def wrong_way_round(name, seed, turn_deg):
    """Arm a boat whose RUD_REVERSE is wrong; return after how long that is told, None if it is not in ARMED_S."""
    boat = rig.Sailing(rig.sea(name), seed, hull=rig.FineHull, RUD_REVERSE=1).under_way(Mode.GUIDED)
    armed_s, before = boat.t_s, boat.state.parameters
    boat.tick(SteerHeading(boat.snapshot.heading_rad + math.radians(turn_deg)))
    boat.run(ARMED_S, until=lambda boat: boat.said(TOLD_REVERSED))
    assert boat.state.parameters == before
    return boat.t_s - armed_s if boat.said(TOLD_REVERSED) else None


@pytest.mark.parametrize(("name", "seed"), [("sea", 2), ("swell", 1)])
def test_a_wrong_servo_direction_is_told(name, seed):
    """In the sea the estimate of this seed takes her turning for waves."""
    assert wrong_way_round(name, seed, 0.0) is not None


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", [*SEAS, "storm", "gusts", "ocean-1", "ocean-2", "ocean-3", "ocean-4"])
def test_a_wrong_servo_direction_is_told_within_three_minutes(name, figures):
    found = [wrong_way_round(name, seed, turn_deg) for seed in range(1, 11) for turn_deg in (0.0, 60.0)]
    assert None not in found
    figures.keep(f"steering_reversed_told_median_{name}", float(np.median(found)), "s")
    figures.keep(f"steering_reversed_told_worst_{name}", max(found), "s")


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", SEAS)
def test_no_turn_of_fifty_seeds_is_taken_for_a_lost_blade(name, figures):
    runs = [turning(name, seed, hours=0.5) for seed in range(1, 51)]
    turns, false = sum(legs for legs, _ in runs), sum(len(told) for _, told in runs)
    figures.keep(f"steering_lost_turns_{name}", turns, "turns")
    figures.keep(f"steering_lost_false_{name}", false, "alarms")
    assert false == 0


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", [*SEAS, "storm", "gusts", "surge"])
def test_nothing_is_told_in_a_day_of_turns(name):
    assert turning(name, 99, hours=24.0, leg_s=900.0)[1] == []


@pytest.mark.proof
@pytest.mark.parametrize("name", SEAS)
def test_a_lost_blade_is_told_within_a_minute_of_rudder_work(name, figures):
    turns = random.Random(7)
    found = [bladeless(name, seed, turns.choice((-1, 1)) * turns.uniform(60.0, 180.0)) for seed in range(1, 21)]
    assert None not in found
    figures.keep(f"steering_lost_told_median_{name}", float(np.median(found)), "s")
    figures.keep(f"steering_lost_told_worst_{name}", max(found), "s")
    assert max(found) <= 60.0
