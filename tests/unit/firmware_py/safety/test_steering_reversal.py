import math

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from firmware_py.safety.steering_reversal import ReversalState, Turn, update

BLOCK_S, RUDDER_RAD = 2.0, 0.5
FULL_RAD = OCEAN_RAMBLER.turning_ability_1_s * RUDDER_RAD * BLOCK_S  # turn in a block at the final rate


class Boat:
    """A boat with the rudder over to its goal that turns by parts of the expected turn."""

    def __init__(self, sd_deg=1.0, diffusion_deg2_s=0.0):
        self.way, self.sd_rad = ReversalState(), radians(sd_deg)
        self.diffusion_rad2_s = radians(1.0) ** 2 * diffusion_deg2_s

    def turn(self, seconds, estimated, shown, rudder_rad=RUDDER_RAD, error_rad=1.0):
        """Return after how long the verdict changes, None if it does not."""
        was = self.way.reversed
        for block in range(round(seconds / BLOCK_S)):
            turn = Turn(rudder_rad, estimated * FULL_RAD, shown * FULL_RAD, BLOCK_S)
            self.way = update(OCEAN_RAMBLER, self.way, turn, 0.0, error_rad, self.sd_rad, self.diffusion_rad2_s, 0.0)
            if self.way.reversed is not was:
                return BLOCK_S * (block + 1)
        return None


@pytest.mark.parametrize(("part", "reported_s"), [(-0.45, None), (-0.55, 36.0), (-1.0, 36.0), (0.0, None), (1.0, None)])
def test_half_of_the_turn_the_other_way_is_reversed_steering_and_less_is_not(part, reported_s):
    """Reported after 16 s, in which the response may be late, and 20 s more."""
    assert Boat().turn(400.0, part, part) == reported_s


def test_a_turn_of_60_deg_is_enough_at_any_uncertainty():
    """With 2.8 deg in 2 s."""
    assert Boat(sd_deg=90.0).turn(400.0, -1.0, 0.0) == 16.0 + 44.0


def test_a_turn_that_the_learned_diffusion_explains_is_none():
    """With 2.8 deg in 2 s; 6 deg^2/s wander by 43 deg in 25 s at most."""
    assert Boat().turn(60.0, -1.0, 0.0) == 36.0
    assert Boat(diffusion_deg2_s=6.0).turn(60.0, -1.0, 0.0) > 40.0


def test_a_rudder_that_holds_against_a_learned_bias_commands_no_turn():
    way, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        way = update(OCEAN_RAMBLER, way, turn, RUDDER_RAD, 1.0, radians(1.0), 0.0, RUDDER_RAD)
    assert not way.reversed


@pytest.mark.parametrize(("part", "reported_s"), [(-0.55, None), (-0.65, 16.0 + 108.0)])
def test_after_150_deg_the_compass_is_enough(part, reported_s):
    assert Boat().turn(400.0, 0.0, part) == reported_s


def test_the_end_of_a_reversal_is_found():
    boat = Boat()
    assert boat.turn(400.0, -1.0, -1.0) is not None
    assert boat.turn(400.0, 1.0, 1.0) == 20.0
    assert not boat.way.reversed


def test_the_evidence_decays_in_two_minutes_without_a_commanded_turn():
    boat = Boat()
    boat.turn(30.0, -1.0, -1.0)
    seen = boat.way.by_estimate
    assert seen.telling_s == 14.0
    boat.turn(60.0, 0.0, 0.0, rudder_rad=0.0, error_rad=0.0)
    assert boat.way.by_estimate.telling_s == pytest.approx(14.0 * math.exp(-0.5))
    assert boat.way.by_compass.turned_rad == pytest.approx(seen.turned_rad * math.exp(-0.5))


def test_no_more_than_12_deg_is_taken_for_trim():
    """A rudder that was over for long turned the boat; it is no trim."""
    way, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        way = update(OCEAN_RAMBLER, way, turn, RUDDER_RAD, 1.0, radians(1.0), 0.0, 0.0)
    assert way.reversed
    assert way.rate_rad_s == pytest.approx(OCEAN_RAMBLER.turning_ability_1_s * (RUDDER_RAD - radians(12.0)), rel=0.01)
