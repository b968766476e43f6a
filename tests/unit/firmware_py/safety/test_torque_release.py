"""Torque release: transcripts of the servo feedback, and whether the torque is released at their end."""

import math

import pytest

from firmware_py.common.records import RudderStatus
from firmware_py.safety.torque_release import TorqueReleaseSettings, TorqueReleaseState, update

COMMAND_RAD = 0.3
SETTINGS, NEVER = TorqueReleaseSettings(release_after_s=5.0), TorqueReleaseSettings(release_after_s=0.0)


def servo(off_deg=0.0, current_a=0.0, *, torque_on=True, measured=True):
    """Return the feedback of a servo that is off_deg from its command."""
    angle_rad = COMMAND_RAD + math.radians(off_deg)
    return RudderStatus(0.0, COMMAND_RAD, angle_rad, measured=measured, torque_on=torque_on, current_a=current_a)


def run(*steps, settings=SETTINGS):
    """Return the state after steps, each (end in s, feedback, change of the command in degrees), at 10 Hz."""
    state, tick = TorqueReleaseState(COMMAND_RAD), 0
    for to_s, feedback, *change_deg in steps:
        command_rad = COMMAND_RAD + math.radians(sum(change_deg))
        while tick < round(10 * to_s):
            state = update(settings, state, command_rad, feedback, tick / 10)
            tick += 1
    return state


ON, OFF = servo(), servo(torque_on=False)
REST = (5.2, ON), (6.5, OFF)  # released at 5.0 s
PUSHED = (6.0, ON), (6.1, servo(2.0, torque_on=False))
CASES = [
    # Released after 5 s at the command with a small current, and only with full feedback.
    (((5.0, ON),), False), (((5.2, ON),), True), (REST, True),
    (((5.5, servo(0.9)),), True), (((5.5, servo(-0.9)),), True),
    (((5.5, servo(1.1)),), False), (((5.5, servo(-1.1)),), False),
    (((5.5, servo(0.0, 0.09)),), True), (((5.5, servo(0.0, -0.09)),), True),
    (((5.5, servo(0.0, 0.11)),), False), (((5.5, servo(0.0, -0.11)),), False),
    (((5.5, servo(0.0, None)),), False), (((5.5, servo(measured=False)),), False),
    (((5.5, servo(torque_on=None)),), False), (((5.5, OFF),), False),
    # A load or missing feedback starts the time again.
    (((4.0, ON), (4.1, servo(0.0, 0.5)), (8.9, ON)), False), (((4.0, ON), (4.1, servo(0.0, 0.5)), (9.5, ON)), True),
    (((4.0, ON), (4.1, servo(0.0, None)), (8.9, ON)), False), (((4.0, ON), (4.1, servo(0.0, None)), (9.5, ON)), True),
    (((4.0, ON), (4.1, servo(measured=False)), (8.9, ON)), False),
    # While released: a changed command, an angle off the command and missing feedback turn the torque on.
    ((*REST, (6.6, OFF, 0.04)), True), ((*REST, (6.6, OFF, -0.04)), True),
    ((*REST, (6.6, OFF, 0.06)), False), ((*REST, (6.6, OFF, -0.06)), False),
    ((*REST, (6.6, servo(0.9, torque_on=False))), True), ((*REST, (6.6, servo(-0.9, torque_on=False))), True),
    ((*REST, (6.6, servo(1.1, torque_on=False))), False), ((*REST, (6.6, servo(-1.1, torque_on=False))), False),
    ((*REST, (6.6, servo(0.0, None, torque_on=False))), False), ((*REST, (6.6, servo(measured=False))), False),
    ((*REST, (6.6, servo(measured=False)), (11.4, ON)), False),
    # A servo has 1 s to release; one that does not, or that is pushed away, keeps its torque for 5 min.
    (((5.9, ON),), True), (((6.2, ON),), False), (((100.0, ON),), False),
    ((*PUSHED, (305.5, ON)), False), ((*PUSHED, (306.5, ON)), True),
]  # fmt: skip


@pytest.mark.parametrize(("steps", "released"), CASES)
def test_torque_is_released(steps, released):
    assert run(*steps).released is released


def test_the_parameter_0_turns_the_torque_on():
    assert not run((100.0, ON), settings=NEVER).released
    assert run(*REST).released_since_s == 5.0
    assert not update(NEVER, run(*REST), COMMAND_RAD, OFF, 6.5).released
