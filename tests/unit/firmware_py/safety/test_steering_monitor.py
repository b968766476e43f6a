import math
import random

import pytest

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel, rk4_step
from firmware_py.safety.steering_loss import restart_after_gap
from firmware_py.safety.steering_monitor import NO_BLOCK, SteeringInput, SteeringMonitorState, update

K, T = 0.049, 4.0
MODEL = KtModel.of(ParameterSet())
SD_RAD = math.radians(0.5)


class Boat:
    """A boat and its monitor, tick by tick; `answers` is its part of K, `later` that of T."""

    def __init__(self, bias_rad=0.08, noise_rad=0.004, seed=1):
        self.state, self.t_s, self.heading, self.rate, self.bias_rad = SteeringMonitorState(), 0.0, 6.0, 0.0, bias_rad
        self.noise, self.noise_rad = random.Random(seed), noise_rad
        self.reported = []  # (t_s, lost)

    def tick(self, rudder_rad, error_rad=math.nan, answers=1.0, later=1.0, pushed_rad=0.0):
        push_rad = answers * (rudder_rad - self.bias_rad) + pushed_rad
        self.heading, self.rate = rk4_step(self.heading, self.rate, push_rad, 0.1, K, T * later, 17.0, 0.0)
        shown_rad = wrap_two_pi(self.heading + self.noise.gauss(0.0, self.noise_rad))
        before, self.t_s = self.state.loss.lost, self.t_s + 0.1
        self.state = update(
            MODEL, False, self.state, SteeringInput(rudder_rad, shown_rad, SD_RAD, 0.4, error_rad, shown_rad), self.t_s
        )
        if self.state.loss.lost is not before:
            self.reported.append((self.t_s, self.state.loss.lost))

    def steer(self, seconds, goal_rad, **ship):
        """Steer for a heading with up to 30 deg of rudder."""
        for _ in range(round(10 * seconds)):
            error_rad = goal_rad - self.heading
            rudder_rad = self.bias_rad + 2.0 * error_rad - 6.0 * self.rate
            self.tick(min(max(rudder_rad, -math.radians(30.0)), math.radians(30.0)), error_rad, **ship)
        return self

    def weave(self, seconds, **ship):
        """Put the rudder over to alternating sides by hand."""
        for tick in range(round(10 * seconds)):
            self.tick(0.1 + 0.4 * math.copysign(1.0, math.sin(0.1 * tick / 8.0)), **ship)
        return self


@pytest.mark.parametrize(("answers", "later"), [(1.0, 1.0), (0.5, 1.0), (1.0, 3.0), (1.0 / 3.0, 3.0), (3.0, 1.0)])
def test_a_boat_that_differs_from_its_model_has_not_lost_steering(answers, later):
    boat = Boat()
    for goal_rad in (7.0, 5.0, 8.0):
        boat.steer(240.0, goal_rad, answers=answers, later=later)
    assert boat.reported == []


def test_a_rudder_that_has_just_moved_is_no_evidence():
    """Whatever the boat does in the first two turning lags."""
    boat = Boat(noise_rad=0.0)
    for _ in range(80):
        boat.tick(boat.bias_rad + math.radians(30.0), 1.0, answers=0.0)
    assert boat.steer(120.0, boat.heading + 1.0).reported == []


def test_a_blade_lost_in_a_turn_is_detected_within_a_minute_and_its_return_too():
    boat = Boat().steer(60.0, 6.0)
    boat.steer(60.0, 7.5, answers=0.0)
    assert [lost for _, lost in boat.reported] == [True]
    boat.steer(60.0, 7.5)
    assert [lost for _, lost in boat.reported] == [True, False]


@pytest.mark.parametrize("lost_s", [360.0, 1800.0])
def test_the_return_of_a_blade_is_detected_as_soon_after_any_time(lost_s):
    boat = Boat().steer(60.0, 6.0)
    for _ in range(round(lost_s / 120.0)):
        boat.steer(60.0, boat.heading - 1.5, answers=0.0).steer(60.0, boat.heading + 1.5, answers=0.0)
    assert [lost for _, lost in boat.reported] == [True]
    boat.steer(120.0, boat.heading - 1.5).steer(120.0, boat.heading + 1.5)
    assert [lost for _, lost in boat.reported] == [True, False]
    assert boat.reported[1][0] < 60.0 + lost_s + 60.0


def test_gusts_that_the_rudder_balances_are_no_lost_blade():
    """The boat is at its goal, however the rudder moves."""
    boat = Boat(bias_rad=0.0)
    for tick in range(6000):
        gust_rad = 0.4 * math.sin(0.1 * tick / 10.0)
        boat.tick(gust_rad, 0.1, pushed_rad=-gust_rad)
    assert boat.reported == []


def test_a_reversed_servo_is_detected_and_its_repair_too():
    boat = Boat(bias_rad=0.0).steer(120.0, 7.0, answers=-1.0)
    assert boat.state.reversal.reversed
    for goal_rad in (9.0, 6.0, 9.0):
        boat.steer(60.0, goal_rad)
    assert not boat.state.reversal.reversed


def test_the_reversal_test_restarts_when_the_parameter_changes():
    boat = Boat(bias_rad=0.0).steer(120.0, 7.0, answers=-1.0)
    inputs = SteeringInput(0.0, math.nan, SD_RAD, 0.4, math.nan)
    assert update(MODEL, False, boat.state, inputs, boat.t_s).reversal.reversed
    assert not update(MODEL, True, boat.state, inputs, boat.t_s).reversal.reversed


def test_an_opposite_turn_mistaken_for_waves_is_detected():
    """The estimated heading is constant, the compass turns."""
    state = SteeringMonitorState()
    for tick in range(1800):
        shown_rad = wrap_two_pi(-0.03 * 0.1 * tick)
        state = update(MODEL, False, state, SteeringInput(0.5, 1.0, SD_RAD, 0.4, 1.0, shown_rad), 0.1 * tick)
    assert state.reversal.reversed


@pytest.mark.parametrize("answers", [0.0, 0.3, 1.0])
def test_a_lost_or_weak_rudder_is_not_reversed(answers):
    boat = Boat()
    for goal_rad in (7.5, 5.0, 8.0):
        boat.steer(120.0, goal_rad, answers=answers, pushed_rad=-0.01)
        assert not boat.state.reversal.reversed


def test_a_blade_lost_while_steering_by_hand_is_detected():
    assert Boat().weave(300.0).reported == []
    assert Boat().weave(300.0, answers=0.0).state.loss.lost


def test_a_lost_blade_stays_lost_while_the_boat_drifts():
    """The sea turns the boat slowly, even toward its goal: a long turn does not become trim."""
    boat = Boat().steer(60.0, 6.0)
    boat.steer(900.0, 7.5, answers=0.0, pushed_rad=0.008)
    assert [lost for _, lost in boat.reported] == [True]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("trim_rad", [0.08, 0.12, 0.15])
def test_a_turn_by_the_wind_is_no_response_of_a_lost_blade(trim_rad, side):
    """The wind that the rudder balanced turns the boat toward its goal, by a good part of the commanded turn."""
    boat = Boat(bias_rad=-side * trim_rad).steer(400.0, 6.0)
    boat.steer(60.0, boat.heading + 1.5 * side, answers=0.0, pushed_rad=side * trim_rad)
    assert [lost for _, lost in boat.reported] == [True]


@pytest.mark.parametrize("answers", [0.35, 0.5])
def test_a_weak_rudder_that_the_wind_helps_is_not_lost(answers):
    boat = Boat(bias_rad=-0.3).steer(400.0, 6.0, answers=answers)
    for turn_rad in (1.5, -1.5, 1.5):
        boat.steer(120.0, boat.heading + turn_rad, answers=answers)
    assert boat.reported == []


def test_a_turn_that_the_heading_could_have_missed_is_no_evidence():
    """A heading that is uncertain by 40 deg shows no turn of 60 deg."""
    reported = []
    for sd_rad in (SD_RAD, math.radians(40.0)):
        state = SteeringMonitorState()
        for tick in range(400):
            state = update(MODEL, False, state, SteeringInput(0.5, 1.0, sd_rad, 0.4, 1.0), 0.1 * tick)
        reported.append(state.loss.lost)
    assert reported == [True, False]


def test_a_turn_that_is_under_way_at_the_start_is_not_taken_for_the_trim():
    """Its rudder is far from the next one, with which the boat rightly does not turn."""
    boat = Boat()
    for _ in range(350):
        boat.tick(-0.5, -1.0)
    for _ in range(1450):
        boat.tick(0.08, 0.0)
    assert boat.reported == []


def test_absent_heading_or_rudder_begins_a_new_block():
    boat = Boat().steer(20.0, 7.0)
    inputs = SteeringInput(0.5, 1.0, SD_RAD, 0.4, 1.0)
    for odd in (inputs._replace(heading_rad=math.nan), inputs._replace(rudder_rad=math.nan)):
        state = update(MODEL, False, boat.state, odd, boat.t_s + 0.1)
        assert state == boat.state._replace(block=NO_BLOCK, loss=restart_after_gap(boat.state.loss))
        assert update(MODEL, False, state, odd, boat.t_s + 0.2) == state


def test_the_mean_of_the_rudder_over_the_block_is_what_counts():
    """The rudder moves at the end of the block, which does not count."""
    state = SteeringMonitorState()
    for tick in range(21):
        state = update(
            MODEL, False, state, SteeringInput(0.5 if tick == 20 else 0.0, 1.0, SD_RAD, 0.4, 1.0), 0.1 * tick
        )
    assert state.loss.rudders_rad[0] == pytest.approx(0.05 * 0.5)


def test_a_rudder_that_changes_sides_is_no_evidence_at_first():
    """A boat with a delay of ten seconds turns the other way for as long."""
    boat = Boat()
    for side in (1.0, -1.0, 1.0, -1.0):
        for tick in range(300):
            boat.tick(side * 0.5, side, answers=-1.0 if tick < 100 else 0.5)
    assert not boat.state.loss.lost
    assert not boat.state.reversal.reversed


def test_the_trim_is_learned_in_a_minute_and_not_in_a_turn():
    boat = Boat()
    for _ in range(602):
        boat.tick(0.1, 0.0)
    assert boat.state.slow_rudder_rad == pytest.approx(0.1 * (1.0 - math.exp(-1.0)), rel=0.03)
    for _ in range(40):
        boat.tick(0.5, 1.0)
    learned_rad = boat.state.slow_rudder_rad
    for _ in range(300):
        boat.tick(0.5, 1.0)
    assert boat.state.slow_rudder_rad == learned_rad


def test_a_block_is_two_seconds():
    boat = Boat()
    for _ in range(19):
        boat.tick(0.3, 0.0)
    assert boat.state.loss.rudders_rad[0] == 0.0
    for _ in range(3):
        boat.tick(0.3, 0.0)
    assert boat.state.loss.rudders_rad[:2] == (pytest.approx(0.3), 0.0)
