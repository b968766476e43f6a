"""Heading to steer by mode, goal and task, and updates of the heading goal."""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import wrap_pi, wrap_two_pi
from firmware_py.common.mode_table import MODES, Mode
from firmware_py.guidance.guidance import GuidanceSettings
from firmware_py.guidance.task_follower import TaskStatus
from firmware_py.modes import (
    HeadingGoal,
    ModeState,
    PositionGoal,
    Situation,
    heading_in_water,
    heading_to_steer,
    stick_deflection,
)


class SteeringTarget(msgspec.Struct, frozen=True):
    """Target of the controller: the heading to steer, and the heading error (positive: turn to starboard)."""

    heading_rad: float | None = None
    error_rad: float | None = None


def update_goal(
    settings: GuidanceSettings, modes: ModeState, situation: Situation, now_s: float, step_s: float
) -> ModeState:
    """Set a missing heading goal, turn the goal by the stick, and end a turn in the requested direction.

    A requested direction (`goal.turn`) applies until the remaining angle is at most 180 deg.
    """
    if not MODES[modes.mode].heading_goals or situation.heading_rad is None:
        return modes
    goal = modes.goal
    if goal is None:
        return replace(modes, goal=HeadingGoal(situation.heading_rad))
    if isinstance(goal, PositionGoal):
        return modes
    if modes.mode is Mode.STEERING and (stick := stick_deflection(modes, now_s, settings.stick_timeout_s)):
        change_rad = stick * settings.stick_rate_rad_s * min(max(0.0, step_s), 1.0)
        return replace(modes, goal=HeadingGoal(wrap_two_pi(goal.heading_rad + change_rad), goal.over_ground))
    if goal.turn:
        remaining_rad = wrap_two_pi(goal.turn * (heading_to_steer(goal, situation.water) - situation.heading_rad))
        if remaining_rad <= math.pi:
            return replace(modes, goal=replace(goal, turn=0))
    return modes


def steering_target(modes: ModeState, status: TaskStatus, situation: Situation) -> SteeringTarget:
    """Return the heading of the goal or of the task, and the heading error."""
    goal, turn = modes.goal, 0
    if isinstance(goal, HeadingGoal):
        steer_rad, turn = heading_to_steer(goal, situation.water), goal.turn
    elif (target := status.heading_target) is None:
        return SteeringTarget()
    elif target.over_ground and (water := situation.water) is not None:
        steer_rad = heading_in_water(target.angle_rad, water)
    else:
        steer_rad = target.angle_rad
    if situation.heading_rad is None:
        return SteeringTarget(steer_rad, None)
    # In a requested direction, the error is 180 deg until the remaining angle is smaller.
    error_rad = turn * math.pi if turn else wrap_pi(steer_rad - situation.heading_rad)
    return SteeringTarget(steer_rad, error_rad)
