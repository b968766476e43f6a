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
NORTH = Situation(heading_rad=0.0, water=Water(1.0, 0.1, 0.0, 0.3, 0.1), position_ok=True, rudder_ok=True)
BLIND = replace(NORTH, heading_rad=None)
SAILING = ModeState(Mode.AUTO, armed=True)


def guided(goal=None):
    return ModeState(Mode.GUIDED, armed=True, goal=goal)


def test_a_mode_without_a_goal_keeps_the_present_heading_once_it_is_known():
    assert update_goal(SETTINGS, guided(), replace(NORTH, heading_rad=1.0), 0.0, 0.1).goal == HeadingGoal(1.0)
    assert update_goal(SETTINGS, guided(), BLIND, 0.0, 0.1).goal is None
    assert update_goal(SETTINGS, SAILING, NORTH, 0.0, 0.1) is SAILING


def test_a_position_goal_is_unchanged():
    modes = guided(PositionGoal(0.6, 2.0))
    assert update_goal(SETTINGS, modes, NORTH, 0.0, 0.1) is modes


@pytest.mark.parametrize("turn", [1, -1])
def test_a_turn_the_long_way_asks_for_half_a_turn_until_the_shorter_way_is_right(turn):
    modes = guided(HeadingGoal(-turn * 1.0, turn=turn))
    assert update_goal(SETTINGS, modes, NORTH, 0.0, 0.1) is modes
    assert steering_target(modes, TaskStatus(), NORTH).error_rad == turn * math.pi
    past = replace(NORTH, heading_rad=turn * 2.5)
    assert update_goal(SETTINGS, modes, past, 0.0, 0.1).goal.turn == 0


def test_a_course_of_a_task_is_made_good_against_the_current_and_a_heading_is_steered_as_it_is():
    course = TaskStatus(HeadingTarget(0.0, over_ground=True))
    assert steering_target(SAILING, course, NORTH).error_rad == pytest.approx(-math.asin(0.3))
    target = steering_target(SAILING, TaskStatus(HeadingTarget(0.2, over_ground=False)), NORTH)
    assert (target.heading_rad, target.error_rad) == (0.2, pytest.approx(0.2))


def test_without_a_task_or_a_heading_there_is_no_error_to_steer_by():
    assert steering_target(SAILING, TaskStatus(), NORTH) == SteeringTarget()
    assert steering_target(guided(HeadingGoal(0.5)), TaskStatus(), BLIND) == SteeringTarget(0.5, None)
