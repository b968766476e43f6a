"""The mission protocol, as far as there are no missions: empty lists, and the guided waypoint."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.intents import Verdict
from firmware_py.link.dialect import Message, mavlink
from firmware_py.link.geo import GLOBAL_FRAMES, position_goal
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session
from firmware_py.records import Severity

_GUIDED = 2  # `current` of a waypoint that is to be gone to at once
_NAV_WAYPOINT = 16
_MISSION_ITEM_INT = 73


class Mission:
    """Answers every request of the mission protocol, so that no ground station waits."""

    def __init__(self, session: Session) -> None:
        """Take the session to ask and to answer through."""
        self._session = session

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {
            39: self._item,
            40: self._request,
            43: self._list,
            44: self._upload,
            45: self._clear,
            51: self._request,
            _MISSION_ITEM_INT: self._item,
        }

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.MAVLink_mission_count_message(sender, component, 0, message.mission_type)
        self._session.send(peer, reply)

    def _upload(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        empty = message.count == 0
        self._acknowledge(peer, message, mavlink.MAV_MISSION_ACCEPTED if empty else mavlink.MAV_MISSION_UNSUPPORTED)

    def _clear(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        self._acknowledge(peer, message, mavlink.MAV_MISSION_ACCEPTED)

    def _request(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        self._acknowledge(peer, message, mavlink.MAV_MISSION_INVALID_SEQUENCE)

    def _item(self, peer: Peer, message: Message, now_s: float) -> None:
        if message.current != _GUIDED:
            self._acknowledge(peer, message, mavlink.MAV_MISSION_UNSUPPORTED)
            return
        if message.command != _NAV_WAYPOINT:
            self._acknowledge(peer, message, mavlink.MAV_MISSION_UNSUPPORTED)
            return
        if message.frame not in GLOBAL_FRAMES:
            self._acknowledge(peer, message, mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
            return
        scale = 1e-7 if type(message).id == _MISSION_ITEM_INT else 1.0
        goal = position_goal(message.x * scale, message.y * scale)
        if isinstance(goal, str):
            self._acknowledge(peer, message, mavlink.MAV_MISSION_INVALID)
            self._session.say(peer, Severity.WARNING, f"guided waypoint: {goal}", now_s)
            return
        answer = self._session.ask(message, goal, now_s)
        accepted = answer.verdict is Verdict.ACCEPTED
        self._acknowledge(peer, message, mavlink.MAV_MISSION_ACCEPTED if accepted else mavlink.MAV_MISSION_DENIED)
        if not accepted:
            self._session.say(peer, Severity.WARNING, answer.text or "guided waypoint refused", now_s)

    def _acknowledge(self, peer: Peer, message: Message, result: int) -> None:
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        self._session.send(peer, mavlink.MAVLink_mission_ack_message(sender, component, result, message.mission_type))
