"""PING and TIMESYNC."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.dialect import Message, mavlink
from firmware_py.link.outbox import Priority
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session


class Timing:
    """Answers requests; what answers a request of somebody else is left alone."""

    def __init__(self, session: Session) -> None:
        """Take the session to answer through."""
        self._session = session

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {4: self._ping, 111: self._timesync}

    def _ping(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        if message.target_system:
            return
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.MAVLink_ping_message(message.time_usec, message.seq, sender, component)
        self._session.send(peer, reply, Priority.URGENT)

    def _timesync(self, peer: Peer, message: Message, now_s: float) -> None:
        if message.tc1:
            return
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.mavlink_map[111](int(now_s * 1e9), message.ts1, sender, component)
        self._session.send(peer, reply, Priority.URGENT)
