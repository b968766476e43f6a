import math
import random

import pytest

from firmware_py.model.kt import rk4_step
from firmware_py.safety.steering_monitor import SteeringMonitorState, compare

K, T = 0.049, 4.0


def sailed(seconds, answers, state=None, moves=True, noise_rad_s=0.002, seed=1, bias_rad=0.08):
    """A boat that weaves with her rudder; `answers` is the part of K that she has."""
    rng, heading, rate = random.Random(seed), 0.0, 0.0
    state = state or SteeringMonitorState()
    for tick in range(round(10 * seconds)):
        rudder = 0.1 + (0.25 * math.sin(0.1 * tick / 4.0) if moves else 0.0)
        heading, rate = rk4_step(heading, rate, rudder, 0.1, K * answers, T, 17.0, bias_rad)
        state = compare(state, rudder, rate + rng.gauss(0.0, noise_rad_s), K, T, 0.1)
    return state


def test_a_boat_that_answers_keeps_her_authority():
    state = sailed(300.0, 1.0)
    assert not state.unresponsive
    assert state.share == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("answers", [0.7, 1.3])
def test_a_model_that_is_off_by_a_third_is_no_loss(answers):
    assert not sailed(300.0, answers).unresponsive


def test_a_rudder_that_turns_nothing_is_noticed_within_a_minute_and_its_return_too():
    state = sailed(60.0, 0.0)
    assert state.unresponsive
    assert abs(state.share) < 0.1
    assert not sailed(240.0, 1.0, state).unresponsive


def test_authority_lost_under_way_is_noticed_within_four_minutes():
    assert sailed(240.0, 0.0, sailed(300.0, 1.0)).unresponsive


def test_a_rudder_at_rest_tells_nothing():
    state = sailed(600.0, 0.0, moves=False)
    assert state.share is None
    assert not state.unresponsive


def test_a_rudder_that_holds_her_against_the_wind_speaks_not_against_her():
    """She is kept on her heading, so she does not turn, however much the rudder moves."""
    state = SteeringMonitorState()
    for tick in range(6000):
        gust_rad = 0.3 * max(0.0, math.sin(0.1 * tick / 8.0)) ** 2
        state = compare(state, 0.05 + gust_rad, 0.0, K, T, 0.1, error_rad=0.1)
    assert not state.unresponsive
    # Far off her heading with the rudder over, she ought to turn.
    for tick in range(900):
        state = compare(state, 0.5 if tick % 600 < 300 else -0.5, 0.0, K, T, 0.1, error_rad=1.0)
    assert state.unresponsive


def test_what_is_no_number_changes_nothing():
    state = sailed(20.0, 1.0)
    for odd in (math.nan, math.inf):
        assert compare(state, odd, 0.0, K, T, 0.1) is state
        assert compare(state, 0.0, odd, K, T, 0.1) is state
    assert compare(state, 0.1, 0.0, K, T, 0.0) is state


def test_a_turn_that_is_under_way_at_the_start_is_not_taken_for_the_trim():
    """Its rudder is far from the one that follows it, and then she does not turn: rightly."""
    state, heading, rate = SteeringMonitorState(), 0.0, 0.0
    for tick in range(1800):
        rudder = -0.5 if tick < 350 else 0.08
        heading, rate = rk4_step(heading, rate, rudder, 0.1, K, T, 17.0, 0.08)
        state = compare(state, rudder, rate, K, T, 0.1, error_rad=-1.0 if tick < 350 else 0.0)
        assert not state.unresponsive
    assert state.share == pytest.approx(1.1, abs=0.2)
