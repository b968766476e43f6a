import math
import random

import pytest

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel, rk4_step
from firmware_py.safety.steering_loss import restart_after_gap
from firmware_py.safety.steering_monitor import NO_BLOCK, Block, SteeringInput, SteeringMonitorState, at_speed, update

K, T = 0.049, 4.0
MODEL = KtModel.of(ParameterSet())
SD_RAD = math.radians(0.5)  # of the heading
# SteeringInput: rudder, heading, its standard deviation, speed, heading error, compass heading [rad, m/s].


class Boat:
    """A boat and its monitor; `turn_ratio`, `lag_ratio`: its K and T divided by those of the model; rad, rad/s."""

    def __init__(self, bias_rad=0.08, noise_rad=0.004, seed=1):
        self.state, self.t_s, self.heading, self.rate, self.bias_rad = SteeringMonitorState(), 0.0, 6.0, 0.0, bias_rad
        self.rng, self.noise_rad = random.Random(seed), noise_rad
        self.reports = []  # (t_s, is_lost)

    def tick(self, rudder_rad, error_rad=math.nan, turn_ratio=1.0, lag_ratio=1.0, disturbance_rad=0.0):
        effective_rad = turn_ratio * (rudder_rad - self.bias_rad) + disturbance_rad
        self.heading, self.rate = rk4_step(self.heading, self.rate, effective_rad, 0.1, K, T * lag_ratio, 17.0, 0.0)
        compass_rad = wrap_two_pi(self.heading + self.rng.gauss(0.0, self.noise_rad))
        previous, self.t_s = self.state.loss.lost, self.t_s + 0.1
        self.state = update(
            MODEL,
            False,
            self.state,
            SteeringInput(rudder_rad, compass_rad, SD_RAD, 0.4, error_rad, compass_rad),
            self.t_s,
        )
        if self.state.loss.lost is not previous:
            self.reports.append((self.t_s, self.state.loss.lost))

    def steer(self, seconds, goal_rad, **ship):
        """Steer to a heading with up to 30 deg of rudder."""
        for _ in range(round(10 * seconds)):
            error_rad = goal_rad - self.heading
            rudder_rad = self.bias_rad + 2.0 * error_rad - 6.0 * self.rate
            self.tick(min(max(rudder_rad, -math.radians(30.0)), math.radians(30.0)), error_rad, **ship)
        return self

    def steer_by_hand(self, seconds, **ship):
        """Steer by hand, with the rudder to alternating sides."""
        for tick in range(round(10 * seconds)):
            self.tick(0.1 + 0.4 * math.copysign(1.0, math.sin(0.1 * tick / 8.0)), **ship)
        return self


@pytest.mark.parametrize(
    ("turn_ratio", "lag_ratio"), [(1.0, 1.0), (0.5, 1.0), (1.0, 3.0), (1.0 / 3.0, 3.0), (3.0, 1.0)]
)
def test_boat_that_differs_from_its_model_has_not_lost_steering(turn_ratio, lag_ratio):
    boat = Boat()
    for goal_rad in (7.0, 5.0, 8.0):
        boat.steer(240.0, goal_rad, turn_ratio=turn_ratio, lag_ratio=lag_ratio)
    assert boat.reports == []


def test_first_two_lags_after_a_movement_are_no_evidence():

    boat = Boat(noise_rad=0.0)
    for _ in range(80):
        boat.tick(boat.bias_rad + math.radians(30.0), 1.0, turn_ratio=0.0)
    assert boat.steer(120.0, boat.heading + 1.0).reports == []


def test_loss_in_a_turn_and_recovery_are_detected_within_a_minute():
    boat = Boat().steer(60.0, 6.0)
    boat.steer(60.0, 7.5, turn_ratio=0.0)
    assert [lost for _, lost in boat.reports] == [True]
    boat.steer(60.0, 7.5)
    assert [lost for _, lost in boat.reports] == [True, False]


@pytest.mark.parametrize("lost_s", [360.0, 1800.0])
def test_recovery_is_detected_within_a_minute_after_any_time(lost_s):
    boat = Boat().steer(60.0, 6.0)
    for _ in range(round(lost_s / 120.0)):
        boat.steer(60.0, boat.heading - 1.5, turn_ratio=0.0).steer(60.0, boat.heading + 1.5, turn_ratio=0.0)
    assert [lost for _, lost in boat.reports] == [True]
    boat.steer(120.0, boat.heading - 1.5).steer(120.0, boat.heading + 1.5)
    assert [lost for _, lost in boat.reports] == [True, False]
    assert boat.reports[1][0] < 60.0 + lost_s + 60.0


def test_gusts_that_the_rudder_balances_are_no_loss():

    boat = Boat(bias_rad=0.0)
    for tick in range(6000):
        gust_rad = 0.4 * math.sin(0.1 * tick / 10.0)
        boat.tick(gust_rad, 0.1, disturbance_rad=-gust_rad)
    assert boat.reports == []


def test_reversed_servo_and_its_repair_are_detected():
    boat = Boat(bias_rad=0.0).steer(120.0, 7.0, turn_ratio=-1.0)
    assert boat.state.reversal.reversed
    for goal_rad in (9.0, 6.0, 9.0):
        boat.steer(60.0, goal_rad)
    assert not boat.state.reversal.reversed


def test_reversal_test_restarts_when_the_parameter_changes():
    boat = Boat(bias_rad=0.0).steer(120.0, 7.0, turn_ratio=-1.0)
    inputs = SteeringInput(0.0, math.nan, SD_RAD, 0.4, math.nan)
    assert update(MODEL, False, boat.state, inputs, boat.t_s).reversal.reversed
    assert not update(MODEL, True, boat.state, inputs, boat.t_s).reversal.reversed


def test_opposite_turn_taken_for_waves_is_detected():
    """The estimated heading is constant, and the compass turns."""
    state = SteeringMonitorState()
    for tick in range(1800):
        compass_rad = wrap_two_pi(-0.03 * 0.1 * tick)
        state = update(MODEL, False, state, SteeringInput(0.5, 1.0, SD_RAD, 0.4, 1.0, compass_rad), 0.1 * tick)
    assert state.reversal.reversed


@pytest.mark.parametrize("turn_ratio", [0.0, 0.3, 1.0])
def test_lost_or_weak_rudder_is_not_reversed(turn_ratio):
    boat = Boat()
    for goal_rad in (7.5, 5.0, 8.0):
        boat.steer(120.0, goal_rad, turn_ratio=turn_ratio, disturbance_rad=-0.01)
        assert not boat.state.reversal.reversed


def test_loss_while_steering_by_hand_is_detected():
    assert Boat().steer_by_hand(300.0).reports == []
    assert Boat().steer_by_hand(300.0, turn_ratio=0.0).state.loss.lost


def test_loss_stays_set_while_a_disturbance_turns_the_boat():
    """The waves turn the boat slowly to its goal; the rudder of a long turn does not become trim."""
    boat = Boat().steer(60.0, 6.0)
    boat.steer(900.0, 7.5, turn_ratio=0.0, disturbance_rad=0.008)
    assert [lost for _, lost in boat.reports] == [True]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("trim_rad", [0.08, 0.12, 0.15])
def test_turn_by_the_wind_is_no_response(trim_rad, side):
    """The wind that the rudder has balanced turns the boat to its goal, by a large part of the commanded turn."""
    boat = Boat(bias_rad=-side * trim_rad).steer(400.0, 6.0)
    boat.steer(60.0, boat.heading + 1.5 * side, turn_ratio=0.0, disturbance_rad=side * trim_rad)
    assert [lost for _, lost in boat.reports] == [True]


@pytest.mark.parametrize("turn_ratio", [0.35, 0.5])
def test_weak_rudder_with_wind_from_a_side_is_not_lost(turn_ratio):
    boat = Boat(bias_rad=-0.3).steer(400.0, 6.0, turn_ratio=turn_ratio)
    for turn_rad in (1.5, -1.5, 1.5):
        boat.steer(120.0, boat.heading + turn_rad, turn_ratio=turn_ratio)
    assert boat.reports == []


def test_turn_within_the_heading_uncertainty_is_no_evidence():
    """With a heading uncertainty of 40 deg a turn of 60 deg is not certain."""
    are_lost = []
    for sd_rad in (SD_RAD, math.radians(40.0)):
        state = SteeringMonitorState()
        for tick in range(400):
            state = update(MODEL, False, state, SteeringInput(0.5, 1.0, sd_rad, 0.4, 1.0), 0.1 * tick)
        are_lost.append(state.loss.lost)
    assert are_lost == [True, False]


def test_rudder_of_a_turn_at_the_start_is_not_taken_for_trim():
    """The boat does not turn with the next rudder angle, which differs much from that of the turn."""
    boat = Boat()
    for _ in range(350):
        boat.tick(-0.5, -1.0)
    for _ in range(1450):
        boat.tick(0.08, 0.0)
    assert boat.reports == []


def test_missing_heading_or_rudder_begins_a_new_block():
    boat = Boat().steer(20.0, 7.0)
    inputs = SteeringInput(0.5, 1.0, SD_RAD, 0.4, 1.0)
    for incomplete in (inputs._replace(heading_rad=math.nan), inputs._replace(rudder_rad=math.nan)):
        state = update(MODEL, False, boat.state, incomplete, boat.t_s + 0.1)
        assert state == boat.state._replace(block=NO_BLOCK, loss=restart_after_gap(boat.state.loss))
        assert update(MODEL, False, state, incomplete, boat.t_s + 0.2) == state


def test_rudder_of_a_block_is_its_mean():
    """The rudder moves in the last tick of the block only."""
    state = SteeringMonitorState()
    for tick in range(21):
        inputs = SteeringInput(0.5 if tick == 20 else 0.0, 1.0, SD_RAD, 0.4, 1.0)
        state = update(MODEL, False, state, inputs, 0.1 * tick)
    assert state.loss.rudders_rad[0] == pytest.approx(0.05 * 0.5)


def test_late_response_after_a_change_of_sides_is_no_evidence():
    """A boat with a delay of 10 s turns in the opposite direction for that time."""
    boat = Boat()
    for side in (1.0, -1.0, 1.0, -1.0):
        for tick in range(300):
            boat.tick(side * 0.5, side, turn_ratio=-1.0 if tick < 100 else 0.5)
    assert not boat.state.loss.lost
    assert not boat.state.reversal.reversed


@pytest.mark.parametrize(
    ("rudder_rad", "error_rad", "is_learned"), [(0.1, 0.0, True), (0.5, 1.0, False), (0.5, math.nan, True)]
)
def test_trim_and_speed_are_learned_except_in_a_commanded_turn(rudder_rad, error_rad, is_learned):
    block = Block(10.0, 1.0, 11.0, rudder_rad)  # the rudder is integrated up to 11 s
    state = SteeringMonitorState(slow_rudder_rad=0.02, slow_speed_m_s=0.4, block=block)
    inputs = SteeringInput(rudder_rad, 1.0, SD_RAD, 0.8, error_rad)
    state = update(MODEL, False, state, inputs, 12.0)
    gain = is_learned * (1.0 - math.exp(-2.0 / 60.0))
    assert state.slow_rudder_rad == pytest.approx(0.02 + gain * (rudder_rad - 0.02))
    assert state.slow_speed_m_s == pytest.approx(0.4 + gain * 0.4)
    assert state.block[:4] == (12.0, 1.0, 12.0, 0.0)


def test_trim_is_learned_in_a_minute_but_not_in_a_turn():
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


@pytest.mark.parametrize(("ratio", "limited"), [(0.0, 0.1), (0.11, 0.11), (1.0, 1.0), (9.9, 9.9), (11.0, 10.0)])
def test_speed_of_the_model_is_limited(ratio, limited):
    model = at_speed(MODEL, ratio * MODEL.speed_m_s)
    assert model == at_speed(MODEL, limited * MODEL.speed_m_s)
    assert model.speed_m_s == pytest.approx(limited * MODEL.speed_m_s)
    assert model.turning_ability_1_s == pytest.approx(limited * MODEL.turning_ability_1_s)


def test_block_lasts_2_s():
    boat = Boat()
    for _ in range(19):
        boat.tick(0.3, 0.0)
    assert boat.state.loss.rudders_rad[0] == 0.0
    for _ in range(3):
        boat.tick(0.3, 0.0)
    assert boat.state.loss.rudders_rad[:2] == (pytest.approx(0.3), 0.0)
