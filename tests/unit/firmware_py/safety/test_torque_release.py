"""Torque release: sequences of the servo feedback, and whether the torque is released at the end."""

import math

import pytest

from firmware_py.common.records import RudderStatus
from firmware_py.safety.torque_release import TorqueReleaseSettings, TorqueReleaseState, update

COMMAND_RAD = 0.3
SETTINGS, NEVER = TorqueReleaseSettings(release_after_s=5.0), TorqueReleaseSettings(release_after_s=0.0)


def servo(deviation_deg=0.0, current_a=0.0, *, torque_on=True, measured=True):
    """Return the feedback of a servo that deviates by deviation_deg from its command."""
    angle_rad = COMMAND_RAD + math.radians(deviation_deg)
    return RudderStatus(0.0, COMMAND_RAD, angle_rad, measured=measured, torque_on=torque_on, current_a=current_a)


def run(*steps, settings=SETTINGS):
    """Return the state after steps of (end [s], feedback, change of the command [deg]), at 10 Hz."""
    state, tick = TorqueReleaseState(COMMAND_RAD), 0
    for end_s, feedback, *change_deg in steps:
        command_rad = COMMAND_RAD + math.radians(sum(change_deg))
        while tick < round(10 * end_s):
            state = update(settings, state, command_rad, feedback, tick / 10)
            tick += 1
    return state


ON, OFF = servo(), servo(torque_on=False)
RELEASED = (5.2, ON), (6.5, OFF)  # released at 5.0 s
PUSHED = (6.0, ON), (6.1, servo(2.0, torque_on=False))
CASES = [
    # The torque is released after 5 s at the command with a small current and complete feedback.
    (((5.0, ON),), False), (((5.2, ON),), True), (RELEASED, True),
    (((5.5, servo(0.9)),), True), (((5.5, servo(-0.9)),), True),
    (((5.5, servo(1.1)),), False), (((5.5, servo(-1.1)),), False),
    (((5.5, servo(0.0, 0.09)),), True), (((5.5, servo(0.0, -0.09)),), True),
    (((5.5, servo(0.0, 0.11)),), False), (((5.5, servo(0.0, -0.11)),), False),
    (((5.5, servo(0.0, None)),), False), (((5.5, servo(measured=False)),), False),
    (((5.5, servo(torque_on=None)),), False), (((5.5, OFF),), False),
    # A load or missing feedback restarts the time.
    (((4.0, ON), (4.1, servo(0.0, 0.5)), (8.9, ON)), False), (((4.0, ON), (4.1, servo(0.0, 0.5)), (9.5, ON)), True),
    (((4.0, ON), (4.1, servo(0.0, None)), (8.9, ON)), False), (((4.0, ON), (4.1, servo(0.0, None)), (9.5, ON)), True),
    (((4.0, ON), (4.1, servo(measured=False)), (8.9, ON)), False),
    # A change of the command, a deviation of the angle and missing feedback turn the torque on.
    ((*RELEASED, (6.6, OFF, 0.04)), True), ((*RELEASED, (6.6, OFF, -0.04)), True),
    ((*RELEASED, (6.6, OFF, 0.06)), False), ((*RELEASED, (6.6, OFF, -0.06)), False),
    ((*RELEASED, (6.6, servo(0.9, torque_on=False))), True), ((*RELEASED, (6.6, servo(-0.9, torque_on=False))), True),
    ((*RELEASED, (6.6, servo(1.1, torque_on=False))), False), ((*RELEASED, (6.6, servo(-1.1, torque_on=False))), False),
    ((*RELEASED, (6.6, servo(0.0, None, torque_on=False))), False), ((*RELEASED, (6.6, servo(measured=False))), False),
    ((*RELEASED, (6.6, servo(measured=False)), (11.4, ON)), False),
    # A servo that does not release in 1 s, or that is moved by a force, has its torque on for 5 min.
    (((5.9, ON),), True), (((6.2, ON),), False), (((100.0, ON),), False),
    ((*PUSHED, (305.5, ON)), False), ((*PUSHED, (306.5, ON)), True),
]  # fmt: skip


@pytest.mark.parametrize(("steps", "is_released"), CASES)
def test_torque_release_at_the_end_of_the_steps(steps, is_released):
    assert run(*steps).is_released is is_released


@pytest.mark.parametrize(("end_s", "is_released"), [(0.5, False), (0.7, True)])
def test_time_of_the_parameter_may_be_less_than_a_second(end_s, is_released):
    assert run((end_s, ON), settings=TorqueReleaseSettings(release_after_s=0.5)).is_released is is_released


@pytest.mark.parametrize(("now_s", "is_released"), [(4.9, True), (5.0, False)])
def test_servo_has_less_than_a_second_to_release_the_torque(now_s, is_released):
    state = TorqueReleaseState(COMMAND_RAD, released_since_s=4.0)
    assert update(SETTINGS, state, COMMAND_RAD, ON, now_s).is_released is is_released


def test_parameter_0_turns_the_torque_on():
    assert run((100.0, ON), settings=NEVER) == TorqueReleaseState(COMMAND_RAD)
    assert run(*RELEASED).released_since_s == 5.0
    assert not update(NEVER, run(*RELEASED), COMMAND_RAD, OFF, 6.5).is_released
