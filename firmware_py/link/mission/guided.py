"""The guided waypoint: a mission item that is not for the mission but to be gone to at once."""

from __future__ import annotations

from firmware_py.common.intents import Verdict
from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.mission.items import acknowledge, sender_of
from firmware_py.link.peer import Peer
from firmware_py.link.telemetry.geo import GLOBAL_FRAMES, position_goal
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanResult

GUIDED = 2  # `current` of such an item


def take_guided(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Go to the place of a waypoint, and acknowledge it."""
    result, text = _judge(context, message, now_s)
    acknowledge(context, peer, sender_of(message), message.mission_type, result)
    if text:
        context.send_text_limited(peer, Severity.WARNING, text, now_s)


def _judge(context: LinkContext, message: Message, now_s: float) -> tuple[PlanResult, str]:
    if message.command != Command.WAYPOINT:
        return PlanResult.UNSUPPORTED, ""
    if message.frame not in GLOBAL_FRAMES:
        return PlanResult.UNSUPPORTED_FRAME, ""
    scale = 1.0 if type(message).id == mavlink.MAVLINK_MSG_ID_MISSION_ITEM else 1e-7
    goal = position_goal(message.x * scale, message.y * scale)
    if isinstance(goal, str):
        return PlanResult.INVALID, f"guided waypoint: {goal}"
    answer = context.request(message, goal, now_s)
    if answer.verdict is not Verdict.ACCEPTED:
        return PlanResult.DENIED, answer.text or "guided waypoint refused"
    return PlanResult.ACCEPTED, ""
