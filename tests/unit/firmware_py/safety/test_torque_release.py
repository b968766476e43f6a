import math

import pytest

from firmware_py.common.records import RudderStatus
from firmware_py.safety.torque_release import AFTER_PUSH_S, TorqueReleaseSettings, TorqueReleaseState, update

SETTINGS = TorqueReleaseSettings(release_after_s=5.0)
NEVER = TorqueReleaseSettings(release_after_s=0.0)


def status(angle_rad, current_a, torque_on):
    """What the servo says; without an angle the commanded one stands for it."""
    return RudderStatus(
        0.0, 0.0, angle_rad or 0.0, measured=angle_rad is not None, torque_on=torque_on, current_a=current_a
    )


ENGAGED = status(0.0, 0.02, torque_on=True)
RELEASED = status(0.0, 0.0, torque_on=False)


def run(state, command_rad, servo, from_s, to_s, settings=SETTINGS):
    for tick in range(round(from_s * 10), round(to_s * 10)):
        state = update(settings, state, command_rad, servo, tick / 10)
    return state


def asleep():
    state = run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 5.2)
    assert state.released_since_s == pytest.approx(5.0)
    return run(state, 0.0, RELEASED, 5.2, 10.0)


def test_it_rests_when_the_command_stands_and_engages_before_it_moves():
    state = asleep()
    assert state.released
    assert not update(SETTINGS, state, 0.01, RELEASED, 10.0).released


def test_a_push_wakes_it_and_keeps_it_awake():
    state = update(SETTINGS, asleep(), 0.0, status(0.03, 0.0, torque_on=False), 10.0)
    assert not state.released
    assert not run(state, 0.0, ENGAGED, 10.1, 200.0).released
    assert run(state, 0.0, ENGAGED, 10.1, 10.0 + AFTER_PUSH_S + 1.0).released


@pytest.mark.parametrize(
    "servo",
    [
        status(0.0, 0.5, torque_on=True),  # it pulls
        status(0.1, 0.02, torque_on=True),  # it is not there
        status(0.0, None, torque_on=True),  # its current is not known
        status(None, 0.02, torque_on=True),
        status(0.0, 0.02, torque_on=None),  # its torque is not known
    ],
)
def test_it_never_rests_under_load_or_in_doubt(servo):
    assert not run(TorqueReleaseState(), 0.0, servo, 0.0, 60.0).released


def test_a_servo_that_cannot_be_released_is_left_alone_and_never_without_the_parameter():
    state = run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 5.2)
    assert not run(state, 0.0, ENGAGED, 5.2, 100.0).released
    assert not run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 100.0, NEVER).released


COMMAND_RAD = 0.3


def at(off_deg=0.0, current_a=0.0, *, torque_on=True):
    return status(COMMAND_RAD + math.radians(off_deg), current_a, torque_on=torque_on)


def rests(servo, from_s=0.0, to_s=5.5, state=TorqueReleaseState(COMMAND_RAD)):  # noqa: B008 - frozen
    return run(state, COMMAND_RAD, servo, from_s, to_s).released


@pytest.mark.parametrize(("off_deg", "at_rest"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
def test_it_rests_near_its_command_and_is_woken_farther_off(off_deg, at_rest):
    assert rests(at(off_deg)) is at_rest
    asleep_there = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 5.2)
    assert rests(at(off_deg, torque_on=False), 5.2, 10.0, asleep_there) is at_rest


@pytest.mark.parametrize(("current_a", "at_rest"), [(0.09, True), (-0.09, True), (0.11, False), (-0.11, False)])
def test_it_rests_while_it_draws_next_to_nothing(current_a, at_rest):
    assert rests(at(0.0, current_a)) is at_rest


@pytest.mark.parametrize(("change_deg", "at_rest"), [(0.04, True), (-0.04, True), (0.06, False), (-0.06, False)])
def test_a_command_that_moves_wakes_it(change_deg, at_rest):
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 5.2)
    moved = update(SETTINGS, state, COMMAND_RAD + math.radians(change_deg), at(torque_on=False), 5.3)
    assert moved.released is at_rest


@pytest.mark.parametrize(("current_a", "angle_rad"), [(0.5, COMMAND_RAD), (None, COMMAND_RAD), (0.0, None)])
def test_after_a_load_or_a_doubt_the_whole_time_counts_anew(current_a, angle_rad):
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 4.0)
    state = update(SETTINGS, state, COMMAND_RAD, status(angle_rad, current_a, torque_on=True), 4.0)
    assert not rests(at(), 4.1, 8.9, state)
    assert rests(at(), 4.1, 9.5, state)


UNMEASURED = RudderStatus(0.0, COMMAND_RAD, COMMAND_RAD, measured=False, torque_on=False, current_a=0.0)


@pytest.mark.parametrize("torque_on", [False, None])
def test_it_is_not_let_go_before_it_is_known_to_hold(torque_on):
    assert not rests(at(torque_on=torque_on))


@pytest.mark.parametrize("doubt", [status(COMMAND_RAD, None, torque_on=False), UNMEASURED])
def test_a_servo_at_rest_that_is_not_known_any_more_is_woken(doubt):
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 6.0)
    state = update(SETTINGS, state, COMMAND_RAD, doubt, 6.0)
    assert not state.released
    assert not rests(at(), 6.1, 10.9, state)


@pytest.mark.parametrize(("holds_s", "at_rest"), [(0.9, True), (1.1, False)])
def test_a_servo_may_take_a_second_to_let_go(holds_s, at_rest):
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 5.1)
    assert state.released_since_s == 5.0
    assert update(SETTINGS, state, COMMAND_RAD, at(), 5.0 + holds_s).released is at_rest


@pytest.mark.parametrize(("after_s", "at_rest"), [(299.5, False), (300.5, True)])
def test_a_push_keeps_it_awake_for_five_minutes(after_s, at_rest):
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 6.0)
    state = update(SETTINGS, state, COMMAND_RAD, at(2.0, torque_on=False), 6.0)
    assert rests(at(), 6.1, 6.0 + after_s, state) is at_rest


def test_the_parameter_taken_away_wakes_it():
    state = run(TorqueReleaseState(COMMAND_RAD), COMMAND_RAD, at(), 0.0, 6.0)
    assert not update(NEVER, state, COMMAND_RAD, at(torque_on=False), 6.0).released
