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
    """A boat that turns by a share of the turn that its rudder commands."""

    def __init__(self, sd_deg=1.0, diffusion_deg2_s=0.0):
        self.state, self.sd_rad = ReversalState(), radians(sd_deg)
        self.diffusion_rad2_s = radians(1.0) ** 2 * diffusion_deg2_s

    def turn(self, seconds, estimate_share, compass_share, rudder_rad=RUDDER_RAD, error_rad=1.0):
        """Return the time to a change of the verdict, or None."""
        previous = self.state.reversed
        for block in range(round(seconds / BLOCK_S)):
            turn = Turn(rudder_rad, estimate_share * FULL_RAD, compass_share * FULL_RAD, BLOCK_S)
            self.state = update(
                OCEAN_RAMBLER, self.state, turn, 0.0, error_rad, self.sd_rad, self.diffusion_rad2_s, 0.0
            )
            if self.state.reversed is not previous:
                return BLOCK_S * (block + 1)
        return None


@pytest.mark.parametrize(
    ("share", "reported_s"), [(-0.49, None), (-0.51, 36.0), (-1.0, 36.0), (0.0, None), (1.0, None)]
)
def test_opposite_turn_of_more_than_half_is_reversed(share, reported_s):
    """Reported 20 s after the first 16 s, in which the response may be late."""
    assert Boat().turn(400.0, share, share) == reported_s


def test_opposite_turn_of_60_deg_is_sufficient_at_any_uncertainty():
    """The boat turns by 2.8 deg in 2 s."""
    assert Boat(sd_deg=90.0).turn(400.0, -1.0, 0.0) == 16.0 + 44.0


def test_turn_within_the_learned_diffusion_is_no_evidence():
    """The boat turns by 2.8 deg in 2 s; a diffusion of 6 deg^2/s explains 43 deg in 25 s."""
    assert Boat().turn(60.0, -1.0, 0.0) == 36.0
    assert Boat(diffusion_deg2_s=6.0).turn(60.0, -1.0, 0.0) > 40.0


def test_rudder_against_a_learned_bias_commands_no_turn():
    state, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        state = update(
            OCEAN_RAMBLER, state, turn, RUDDER_RAD, 1.0, radians(1.0), diffusion_rad2_s=0.0, trim_rad=RUDDER_RAD
        )
    assert not state.reversed


@pytest.mark.parametrize(("share", "reported_s"), [(-0.55, None), (-0.65, 16.0 + 108.0)])
def test_opposite_turn_of_the_compass_of_150_deg_is_sufficient(share, reported_s):
    assert Boat().turn(400.0, 0.0, share) == reported_s


def test_end_of_a_reversal_is_detected():
    boat = Boat()
    assert boat.turn(400.0, -1.0, -1.0) is not None
    assert boat.turn(400.0, 1.0, 1.0) == 20.0
    assert not boat.state.reversed


def test_evidence_decays_in_two_minutes_without_a_commanded_turn():
    boat = Boat()
    boat.turn(30.0, -1.0, -1.0)
    evidence = boat.state.by_estimate
    assert evidence.turn_time_s == 14.0
    boat.turn(60.0, 0.0, 0.0, rudder_rad=0.0, error_rad=0.0)
    assert boat.state.by_estimate.turn_time_s == pytest.approx(14.0 * math.exp(-0.5))
    assert boat.state.by_compass.turned_rad == pytest.approx(evidence.turned_rad * math.exp(-0.5))


def test_trim_is_at_most_12_deg():
    """A larger slow rudder angle is that of a long turn."""
    state, turn = ReversalState(), Turn(RUDDER_RAD, -FULL_RAD, -FULL_RAD, BLOCK_S)
    for _ in range(20):
        state = update(OCEAN_RAMBLER, state, turn, RUDDER_RAD, 1.0, radians(1.0), diffusion_rad2_s=0.0, trim_rad=0.0)
    assert state.reversed
    assert state.rate_rad_s == pytest.approx(OCEAN_RAMBLER.turning_ability_1_s * (RUDDER_RAD - radians(12.0)), rel=0.01)


TURN_RUDDER_RAD, ERROR_RAD = radians(20.0), radians(60.0)


@pytest.mark.parametrize(
    ("rudder_deg", "error_deg", "is_commanded"),
    [
        (12.0, 15.0, True),
        (-12.0, -15.0, True),
        (11.9, 60.0, False),
        (30.0, 14.9, False),
        (30.0, -60.0, False),  # it stops a turn
        (12.5, math.nan, True),  # by hand
        (11.5, math.nan, False),
    ],
)
def test_large_rudder_with_a_large_error_commands_a_turn(rudder_deg, error_deg, is_commanded):
    assert is_turn_commanded(radians(rudder_deg), radians(error_deg)) is is_commanded


@pytest.mark.parametrize(
    ("previous_s", "side", "expected_s"),
    [(0.0, 1, 2.0), (6.0, 1, 8.0), (6.0, -1, -2.0), (-6.0, -1, -8.0), (6.0, 0, 0.0)],
)
def test_time_of_a_commanded_turn_restarts_with_the_other_side(previous_s, side, expected_s):
    assert commanded_turn_s(previous_s, side * TURN_RUDDER_RAD, side * ERROR_RAD, 2.0) == expected_s


@pytest.mark.parametrize(
    ("turn_time_s", "expected_deg", "sd_deg", "lag_s", "is_sufficient"),
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
def test_decision_needs_time_and_a_turn_larger_than_the_uncertainty(
    turn_time_s, expected_deg, sd_deg, lag_s, is_sufficient
):
    assert is_turn_sufficient(turn_time_s, radians(expected_deg), radians(sd_deg), lag_s) is is_sufficient
