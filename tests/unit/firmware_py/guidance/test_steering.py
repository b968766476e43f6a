"""Heading goal and heading to steer by mode and task."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Water
from firmware_py.guidance.guidance import GuidanceSettings
from firmware_py.guidance.steering import SteeringTarget, steering_target, update_goal
from firmware_py.guidance.task_follower import TaskStatus
from firmware_py.guidance.tasks import HeadingTarget
from firmware_py.modes import HeadingGoal, ModeState, PositionGoal, Situation

SETTINGS = GuidanceSettings.of(ParameterSet())
NORTH = Situation(
    heading_rad=0.0,
    water=Water(speed_m_s=1.0, speed_sd_m_s=0.1, current_north_m_s=0.0, current_east_m_s=0.3, current_sd_m_s=0.1),
    position_ok=True,
    rudder_ok=True,
)
WITHOUT_HEADING = replace(NORTH, heading_rad=None)
AUTO = ModeState(Mode.AUTO, armed=True)


def guided(goal=None):
    return ModeState(Mode.GUIDED, armed=True, goal=goal)


def test_missing_goal_becomes_the_present_heading():
    assert update_goal(SETTINGS, guided(), replace(NORTH, heading_rad=1.0), 0.0, 0.1).goal == HeadingGoal(1.0)
    assert update_goal(SETTINGS, guided(), WITHOUT_HEADING, 0.0, 0.1).goal is None
    assert update_goal(SETTINGS, AUTO, NORTH, 0.0, 0.1) is AUTO


def test_position_goal_is_unchanged():
    modes = guided(PositionGoal(0.6, 2.0))
    assert update_goal(SETTINGS, modes, NORTH, 0.0, 0.1) is modes


@pytest.mark.parametrize("turn", [1, -1])
def test_requested_direction_gives_an_error_of_180_deg_until_the_angle_is_smaller(turn):
    modes = guided(HeadingGoal(-turn * 1.0, turn=turn))
    assert update_goal(SETTINGS, modes, NORTH, 0.0, 0.1) is modes
    assert steering_target(modes, TaskStatus(), NORTH).error_rad == turn * math.pi
    later = replace(NORTH, heading_rad=turn * 2.5)
    assert update_goal(SETTINGS, modes, later, 0.0, 0.1).goal.turn == 0


@pytest.mark.parametrize(("step_s", "turned_s"), [(0.1, 0.1), (5.0, 1.0), (-1.0, 0.0)])
def test_stick_turns_the_goal_for_at_most_a_second(step_s, turned_s):
    modes = ModeState(Mode.STEERING, armed=True, goal=HeadingGoal(1.0, over_ground=True), stick=-0.5, stick_t_s=0.0)
    goal = update_goal(SETTINGS, modes, NORTH, 0.0, step_s).goal
    assert goal.heading_rad == pytest.approx(1.0 - 0.5 * turned_s * SETTINGS.stick_rate_rad_s)
    assert goal.over_ground


def test_course_of_a_task_compensates_the_current_and_a_heading_does_not():
    course = TaskStatus(HeadingTarget(0.0, over_ground=True))
    assert steering_target(AUTO, course, NORTH).error_rad == pytest.approx(-math.asin(0.3))
    target = steering_target(AUTO, TaskStatus(HeadingTarget(0.2, over_ground=False)), NORTH)
    assert (target.heading_rad, target.error_rad) == (0.2, pytest.approx(0.2))


def test_without_task_or_heading_there_is_no_error():
    assert steering_target(AUTO, TaskStatus(), NORTH) == SteeringTarget()
    assert steering_target(guided(HeadingGoal(0.5)), TaskStatus(), WITHOUT_HEADING) == SteeringTarget(0.5, None)
