import pytest

from firmware_py.safety.torque_release import AFTER_PUSH_S, ServoSight, TorqueReleaseState, update

ENGAGED = ServoSight(0.0, 0.02, torque_on=True)
RELEASED = ServoSight(0.0, 0.0, torque_on=False)


def run(state, command_rad, servo, from_s, to_s, rest_s=5.0):
    for tick in range(round(from_s * 10), round(to_s * 10)):
        state = update(state, command_rad, servo, tick / 10, rest_s)
    return state


def asleep():
    state = run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 5.2)
    assert state.resting_s == pytest.approx(5.0)
    return run(state, 0.0, RELEASED, 5.2, 10.0)


def test_it_rests_when_the_command_stands_and_engages_before_it_moves():
    state = asleep()
    assert state.resting_s is not None
    assert update(state, 0.01, RELEASED, 10.0, 5.0).resting_s is None


def test_a_push_wakes_it_and_keeps_it_awake():
    state = update(asleep(), 0.0, ServoSight(0.03, 0.0, torque_on=False), 10.0, 5.0)
    assert state.resting_s is None
    assert run(state, 0.0, ENGAGED, 10.1, 200.0).resting_s is None
    assert run(state, 0.0, ENGAGED, 10.1, 10.0 + AFTER_PUSH_S + 1.0).resting_s is not None


@pytest.mark.parametrize(
    "servo",
    [
        ServoSight(0.0, 0.5, torque_on=True),  # it pulls
        ServoSight(0.1, 0.02, torque_on=True),  # it is not there
        ServoSight(0.0, None, torque_on=True),  # its current is not known
        ServoSight(None, 0.02, torque_on=True),
        ServoSight(0.0, 0.02, torque_on=None),  # its torque is not known
    ],
)
def test_it_never_rests_under_load_or_in_doubt(servo):
    assert run(TorqueReleaseState(), 0.0, servo, 0.0, 60.0).resting_s is None


def test_a_servo_that_cannot_be_released_is_left_alone_and_never_without_the_parameter():
    state = run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 5.2)
    assert run(state, 0.0, ENGAGED, 5.2, 100.0).resting_s is None
    assert run(TorqueReleaseState(), 0.0, ENGAGED, 0.0, 100.0, rest_s=0.0).resting_s is None
