import math

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from firmware_py.safety.steering_reversal import (
    ReversalState,
    Turn,
    commanded_turn_s,
    is_turn_commanded,
    is_turn_sufficient,
    update,
)

BLOCK_S, RUDDER_RAD = 2.0, 0.5
FULL_RAD = OCEAN_RAMBLER.turning_ability_1_s * RUDDER_RAD * BLOCK_S  # turn in a block at the final rate


class Boat:
    """A boat with the rudder over to its goal that turns by parts of the expected turn."""

    def __init__(self, sd_deg=1.0, diffusion_deg2_s=0.0):
        self.way, self.sd_rad = ReversalState(), radians(sd_deg)
        self.diffusion_rad2_s = radians(1.0) ** 2 * diffusion_deg2_s

    def turn(self, seconds, estimated, by_compass, rudder_rad=RUDDER_RAD, error_rad=1.0):
        """Return after how long the verdict changes, None if it does not."""
        was = self.way.reversed
        for block in range(round(seconds / BLOCK_S)):
            turn = Turn(rudder_rad, estimated * FULL_RAD, by_compass * FULL_RAD, BLOCK_S)
            self.way = update(OCEAN_RAMBLER, self.way, turn, 0.0, error_rad, self.sd_rad, self.diffusion_rad2_s, 0.0)
            if self.way.reversed is not was:
                return BLOCK_S * (block + 1)
        return None


@pytest.mark.parametrize(("part", "reported_s"), [(-0.45, None), (-0.55, 36.0), (-1.0, 36.0), (0.0, None), (1.0, None)])
def test_half_of_the_turn_in_the_opposite_direction_is_reversed_and_less_is_not(part, reported_s):
    """Reported after 16 s, in which the response may be late, and 20 s more."""
    assert Boat().turn(400.0, part, part) == reported_s


def test_a_turn_of_60_deg_is_sufficient_at_any_uncertainty():
    """With 2.8 deg in 2 s."""
    assert Boat(sd_deg=90.0).turn(400.0, -1.0, 0.0) == 16.0 + 44.0


def test_a_turn_that_the_learned_diffusion_explains_is_none():
    """2.8 deg in 2 s; a diffusion of 6 deg^2/s explains 43 deg in 25 s."""
    assert Boat().turn(60.0, -1.0, 0.0) == 36.0
    assert Boat(diffusion_deg2_s=6.0).turn(60.0, -1.0, 0.0) > 40.0


def test_a_rudder_that_holds_against_a_learned_bias_commands_no_turn():
    way, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        way = update(OCEAN_RAMBLER, way, turn, RUDDER_RAD, 1.0, radians(1.0), 0.0, RUDDER_RAD)
    assert not way.reversed


@pytest.mark.parametrize(("part", "reported_s"), [(-0.55, None), (-0.65, 16.0 + 108.0)])
def test_after_150_deg_the_compass_is_sufficient(part, reported_s):
    assert Boat().turn(400.0, 0.0, part) == reported_s


def test_the_end_of_a_reversal_is_detected():
    boat = Boat()
    assert boat.turn(400.0, -1.0, -1.0) is not None
    assert boat.turn(400.0, 1.0, 1.0) == 20.0
    assert not boat.way.reversed


def test_the_evidence_decays_in_two_minutes_without_a_commanded_turn():
    boat = Boat()
    boat.turn(30.0, -1.0, -1.0)
    seen = boat.way.by_estimate
    assert seen.turn_time_s == 14.0
    boat.turn(60.0, 0.0, 0.0, rudder_rad=0.0, error_rad=0.0)
    assert boat.way.by_estimate.turn_time_s == pytest.approx(14.0 * math.exp(-0.5))
    assert boat.way.by_compass.turned_rad == pytest.approx(seen.turned_rad * math.exp(-0.5))


def test_no_more_than_12_deg_is_taken_for_trim():
    """A rudder that was over for long turned the boat; it is no trim."""
    way, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        way = update(OCEAN_RAMBLER, way, turn, RUDDER_RAD, 1.0, radians(1.0), 0.0, 0.0)
    assert way.reversed
    assert way.rate_rad_s == pytest.approx(OCEAN_RAMBLER.turning_ability_1_s * (RUDDER_RAD - radians(12.0)), rel=0.01)


OVER_RAD, OFF_RAD = radians(20.0), radians(60.0)


@pytest.mark.parametrize(
    ("over_deg", "error_deg", "commanded"),
    [
        (12.5, 15.5, True),
        (-12.5, -15.5, True),
        (11.5, 60.0, False),
        (30.0, 14.5, False),
        (30.0, -60.0, False),  # it stops a turn
        (12.5, math.nan, True),  # by hand
        (11.5, math.nan, False),
    ],
)
def test_a_large_rudder_towards_a_distant_goal_commands_a_turn(over_deg, error_deg, commanded):
    assert is_turn_commanded(radians(over_deg), radians(error_deg)) is commanded


def test_the_time_of_a_commanded_turn_starts_again_on_the_other_side():
    assert commanded_turn_s(0.0, OVER_RAD, OFF_RAD, 2.0) == 2.0
    assert commanded_turn_s(6.0, OVER_RAD, OFF_RAD, 2.0) == 8.0
    assert commanded_turn_s(6.0, -OVER_RAD, -OFF_RAD, 2.0) == -2.0
    assert commanded_turn_s(-6.0, -OVER_RAD, -OFF_RAD, 2.0) == -8.0
    assert commanded_turn_s(6.0, 0.0, OFF_RAD, 2.0) == 0.0


@pytest.mark.parametrize(
    ("turn_time_s", "expected_deg", "sd_deg", "lag_s", "sufficient"),
    [
        (21.0, 15.5, 1.0, 4.0, True),
        (19.0, 90.0, 1.0, 4.0, False),
        (21.0, 14.5, 1.0, 4.0, False),
        (21.0, 32.5, 4.0, 4.0, True),
        (21.0, 31.5, 4.0, 4.0, False),
        (31.0, 90.0, 1.0, 10.0, True),
        (29.0, 90.0, 1.0, 10.0, False),
        (math.inf, 90.0, math.inf, 4.0, False),
    ],
)
def test_a_decision_takes_time_and_a_turn_larger_than_the_heading_error(
    turn_time_s, expected_deg, sd_deg, lag_s, sufficient
):
    assert is_turn_sufficient(turn_time_s, radians(expected_deg), radians(sd_deg), lag_s) is sufficient
