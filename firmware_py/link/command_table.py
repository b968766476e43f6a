"""The one table of commands."""

from __future__ import annotations

from firmware_py.link import command_goals, command_requests, command_state
from firmware_py.link.commands import CommandRow

TABLE: tuple[CommandRow, ...] = (
    CommandRow(115, "CONDITION_YAW", command_goals.condition_yaw),
    CommandRow(176, "DO_SET_MODE", command_state.set_mode),
    CommandRow(192, "DO_REPOSITION", command_goals.reposition),
    CommandRow(213, "NAV_SET_YAW_SPEED", command_goals.set_yaw_speed),
    CommandRow(400, "COMPONENT_ARM_DISARM", command_state.arm_disarm),
    CommandRow(401, "RUN_PREARM_CHECKS", command_state.run_prearm_checks, repeatable=True),
    CommandRow(410, "GET_HOME_POSITION", command_requests.home_position, repeatable=True),
    CommandRow(510, "GET_MESSAGE_INTERVAL", command_requests.get_message_interval, repeatable=True),
    CommandRow(511, "SET_MESSAGE_INTERVAL", command_requests.set_message_interval, repeatable=True),
    CommandRow(512, "REQUEST_MESSAGE", command_requests.request_message, repeatable=True),
    CommandRow(519, "REQUEST_PROTOCOL_VERSION", command_requests.protocol_version, repeatable=True),
    CommandRow(520, "REQUEST_AUTOPILOT_CAPABILITIES", command_requests.capabilities, repeatable=True),
    CommandRow(43002, "GUIDED_CHANGE_HEADING", command_goals.change_heading),
)
