"""A plan to a ground station: the count, and each item as it is asked for."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from firmware_py.common.plan import Plan, PlanItem, PlanKind, homes
from firmware_py.link.context import LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.mission.items import acknowledge, home_item, item_message
from firmware_py.link.peers import Correspondent, Peer, correspondent, sender_of
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.timeouts import timeouts_of
from firmware_py.plans.problem import PlanResult

_COUNT = mavlink.mavlink_map[44]
_REQUEST_INT = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
_REMEMBERED = 16
_PART = 16  # items that a request for a part of the list may ask for


@dataclass(slots=True)
class PlanDownload:
    """What a station is reading: the plan as it was when it asked for the list, so that it gets the whole of one."""

    plan: Plan
    used_s: float


class PlanDownloads:
    """Answers requests for lists and items."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context
        self._readings: OrderedDict[tuple[Correspondent, PlanKind], PlanDownload] = OrderedDict()

    def send_count(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_LIST with the count and the opaque id."""
        reader = correspondent(peer, message)
        plan = self._context.request_handler.plans().of(kind)
        keep_latest(self._readings, (reader, kind), PlanDownload(plan, now_s), _REMEMBERED)
        count = _wire_count(plan, homes(self._context.autopilot, kind))
        self._context.send(peer, _COUNT(*reader.sender, count, int(kind), plan.identity))

    def send_item(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_INT, or MISSION_REQUEST in kind."""
        plan = self._plan(correspondent(peer, message), kind, now_s)
        if not self._send(peer, message, kind, plan, message.seq, whole=type(message).id == _REQUEST_INT):
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)

    def send_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_PARTIAL_LIST with the items themselves; -1 is the end of the list."""
        plan = self._plan(correspondent(peer, message), kind, now_s)
        count = _wire_count(plan, homes(self._context.autopilot, kind))
        first, last = message.start_index, message.end_index if message.end_index != -1 else count - 1
        if not 0 <= first <= last < count:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)
        elif last - first >= _PART:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.NO_SPACE)
        else:
            for sequence in range(first, last + 1):
                self._send(peer, message, kind, plan, sequence, whole=True)

    def end(self, reader: Correspondent, kind: PlanKind) -> None:
        """Note that a station has read all it wanted, or has a plan of its own in force."""
        self._readings.pop((reader, kind), None)

    def _plan(self, reader: Correspondent, kind: PlanKind, now_s: float) -> Plan:
        """Return the plan that a station is reading, or the one in force."""
        reading = self._readings.get((reader, kind))
        if reading is None or now_s - reading.used_s >= timeouts_of(reader.peer.transport).give_up_s:
            return self._context.request_handler.plans().of(kind)
        reading.used_s = now_s
        return reading.plan

    def _send(self, peer: Peer, message: Message, kind: PlanKind, plan: Plan, sequence: int, *, whole: bool) -> bool:
        home_count = homes(self._context.autopilot, kind)
        # Home is there without a mission, too: DroneKit asks for it whatever the count, and waits for it.
        if not 0 <= sequence < max(_wire_count(plan, home_count), home_count):
            return False
        index = sequence - home_count
        item: PlanItem = home_item(self._context.home) if index < 0 else plan.items[index]
        reply = item_message(
            item,
            sender_of(message),
            kind,
            sequence,
            home_count=home_count,
            current=kind is PlanKind.MISSION and index >= 0 and index == self._current(),
            whole=whole,
        )
        self._context.send(peer, reply)
        return True

    def _current(self) -> int | None:
        return None if self._context.snapshot is None else self._context.snapshot.mission.index


def _wire_count(plan: Plan, home_count: int) -> int:
    """Return the number of items of a plan as stations count them: an empty mission has no home either."""
    return len(plan.items) + home_count if plan.items else 0
