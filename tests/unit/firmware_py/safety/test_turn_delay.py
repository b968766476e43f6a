import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.model.kt import OCEAN_RAMBLER, decay_over
from firmware_py.safety.turn_delay import (
    MAX_EVIDENCE,
    MAX_FACTOR,
    MIN_EVIDENCE,
    MIN_FACTOR,
    TurnDelayState,
    end_turn,
    explained_square,
    update,
)

SD_RAD, FAR_RAD = math.radians(1.0), math.radians(8.0)


class Turns:
    """A boat at a speed that turns with a delay, a part of its turning ability and a longer lag."""

    def __init__(self, gain=1.0, lags=1.0, late_s=0.0, speed_m_s=0.4):
        self.ship, self.speed_m_s = OCEAN_RAMBLER.at_speed(speed_m_s), speed_m_s
        self.gain, self.lags, self.late = gain, lags, [0.0] * round(10.0 * late_s)
        self.state, self.t_s, self.heading_rad, self.rate_rad_s = TurnDelayState(), 0.0, 6.0, 0.0

    def to(self, goal_rad):
        """Turn to a goal with the rudder over until the end; return the evidence after it."""
        side = math.copysign(1.0, goal_rad - self.heading_rad)
        while (goal_rad - self.heading_rad) * side > 0.0:
            self.late.append(0.4 * side)
            steady_rad_s = self.gain * self.ship.turning_ability_1_s * self.late.pop(0)
            gone = 1.0 - decay_over(0.1, self.lags * self.ship.turning_lag_s)
            self.rate_rad_s += gone * (steady_rad_s - self.rate_rad_s)
            self.heading_rad += 0.1 * self.rate_rad_s
            self.t_s += 0.1
            turning = abs(goal_rad - self.heading_rad) >= FAR_RAD
            self.state = update(
                OCEAN_RAMBLER, self.state, self.heading_rad, 0.4 * side, self.speed_m_s, self.t_s, turning
            )
        self.state = end_turn(OCEAN_RAMBLER, self.state, SD_RAD)
        return self.state.evidence


@pytest.mark.parametrize("speed_m_s", [0.2, 0.4, 0.9])
@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_a_nominal_boat_has_no_delay_at_any_turning_ability(gain, speed_m_s):
    boat = Turns(gain, speed_m_s=speed_m_s)
    assert MIN_EVIDENCE <= boat.to(7.5) <= -1.0
    assert MIN_EVIDENCE <= boat.to(5.5) <= -2.0


@pytest.mark.parametrize(("lags", "late_s"), [(1.0, 12.0), (3.0, 8.0), (10.0, 0.0)])
def test_a_delay_is_found_in_two_turns(lags, late_s):
    boat = Turns(1.0, lags, late_s)
    boat.to(7.5)
    assert boat.to(5.5) == MAX_EVIDENCE


def test_the_end_of_a_delay_is_found_in_three_turns():
    boat = Turns(late_s=12.0)
    boat.to(7.5)
    assert boat.to(5.5) == MAX_EVIDENCE
    boat.late = []
    boat.to(7.5)
    boat.to(5.5)
    assert boat.to(7.5) == MIN_EVIDENCE


def test_without_a_turn_there_is_no_evidence():
    state = TurnDelayState(evidence=2.0)
    for second in range(100):
        state = update(OCEAN_RAMBLER, state, 1.0, 0.4, 0.4, float(second), False)
    assert end_turn(OCEAN_RAMBLER, state, SD_RAD) is state


def test_a_speed_of_zero_is_no_divisor():
    state = TurnDelayState()
    for second in range(100):
        state = update(OCEAN_RAMBLER, state, 1.0, 0.4, -1.0, float(second), True)
    assert math.isfinite(end_turn(OCEAN_RAMBLER, state, SD_RAD).evidence)


@given(st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0)), min_size=1, max_size=20))
def test_the_explained_square_is_that_of_the_best_factor(shown_and_felt):
    def squares(gain):
        return sum((shown - gain * felt) ** 2 for shown, felt in shown_and_felt)

    gains = [MIN_FACTOR + (MAX_FACTOR - MIN_FACTOR) * number / 2000.0 for number in range(2001)]
    best = squares(0.0) - min(map(squares, gains))
    found = explained_square(
        sum(shown * felt for shown, felt in shown_and_felt), sum(felt**2 for _, felt in shown_and_felt)
    )
    assert best - 1e-9 <= found <= best + 1e-4
