import math

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER, decay_over
from firmware_py.safety.rudder_answer import RudderAnswerState, update

SPEED_M_S, BLOCK_S, SD_RAD = 0.9, 2.0, radians(1.0)
SHIP = OCEAN_RAMBLER.at_speed(SPEED_M_S)


class Boat:
    """A boat that answers late by blocks, with a part of her turning ability and a longer lag, pushed by wind."""

    def __init__(self, answers=1.0, late=0, lags=1.0, wind_rad=-0.09):
        self.state, self.rate_rad_s, self.rudders = RudderAnswerState(), 0.0, [0.0] * late
        self.answers, self.lags, self.wind_rad = answers, lags, wind_rad

    def hold(self, seconds, rudder_rad, error_rad):
        """Hold the rudder over for blocks; return after how long she is told not to answer, None where she is not."""
        for block in range(round(seconds / BLOCK_S)):
            self.rudders.append(rudder_rad)
            steady_rad_s = SHIP.turning_ability_1_s * (self.answers * self.rudders.pop(0) + self.wind_rad)
            gone = 1.0 - decay_over(BLOCK_S, self.lags * SHIP.turning_lag_s)
            self.rate_rad_s += gone * (steady_rad_s - self.rate_rad_s)
            turned_rad = self.rate_rad_s * BLOCK_S
            block_of = (rudder_rad, turned_rad, BLOCK_S)
            self.state = update(OCEAN_RAMBLER, self.state, block_of, SD_RAD, SPEED_M_S, error_rad)
            if self.state.missing:
                return (block + 1) * BLOCK_S
        return None


@pytest.mark.parametrize("error_rad", [-1.0, None])
def test_wind_that_turns_her_to_her_goal_is_no_answer(error_rad):
    """A sixth of what the rudder would turn her, and to the same side."""
    boat = Boat()
    assert boat.hold(120.0, radians(5.0), 0.0) is None
    boat.answers = 0.0
    assert 10.0 < boat.hold(60.0, radians(-28.5), error_rad) <= 50.0


@pytest.mark.parametrize("late", [0, 1, 3, 6])
@pytest.mark.parametrize(("answers", "lags"), [(0.5, 1.0), (1.0, 1.0), (2.0, 1.0), (1.0, 3.0), (0.5, 3.0), (-1.0, 1.0)])
def test_a_boat_that_answers_late_or_weakly_or_the_other_way_answers(answers, lags, late):
    boat = Boat(answers, late, lags)
    assert boat.hold(120.0, radians(5.0), 0.0) is None
    for side in (-1.0, 1.0, -1.0):
        assert boat.hold(60.0, radians(5.0 + side * 25.0), side) is None


def test_a_helm_that_holds_her_against_gusts_tells_nothing():
    boat = Boat()
    for block in range(300):
        rudder_rad = radians(5.0) + 0.4 * math.sin(block / 5.0)
        boat.wind_rad = -rudder_rad
        assert boat.hold(BLOCK_S, rudder_rad, 0.1) is None
