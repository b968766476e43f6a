"""PING, TIMESYNC and SYSTEM_TIME."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping

from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.outbox import Priority

_REMEMBERED = 32
_FARTHEST_S = 1e11


class Timesync:
    """Answers questions about time, and hears what stations say of it."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context
        self._answered: OrderedDict[tuple[Peer, int, int], tuple[int, int]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {2: self._system_time, 4: self._ping, 111: self._timesync}

    def _ping(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Answer a ping to everybody, and the first of its kind that is addressed to this boat.

        An addressed one is an answer by the book, but some stations ask so, too; the boat
        never asks. Only the first, lest two who answer everything answer each other for ever.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.target_system:
            asker, mark = (peer, *sender), (message.time_usec, message.seq)
            if self._answered.get(asker) == mark:
                return
            keep_latest(self._answered, asker, mark, _REMEMBERED)
        reply = mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender)
        self._context.send(peer, reply, Priority.URGENT)

    def _timesync(self, peer: Peer, message: Message, now_s: float) -> None:
        """Answer with the time since start; what answers a question of somebody else is left alone."""
        if message.tc1:
            return
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        reply = mavlink.mavlink_map[111](int(now_s * 1e9), message.ts1, sender, component)
        self._context.send(peer, reply, Priority.URGENT)

    def _system_time(self, peer: Peer, message: Message, now_s: float) -> None:
        """Hear the time of a ground station, for a clock that is plainly wrong (`CLK_SET`)."""
        utc_s = message.time_unix_usec * 1e-6
        offer = self._context.suppliers.offer_utc
        if offer is not None and peer.ground_station_s is not None and 0.0 < utc_s < _FARTHEST_S:
            offer(utc_s, now_s)
