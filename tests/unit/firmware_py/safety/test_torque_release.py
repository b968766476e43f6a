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
