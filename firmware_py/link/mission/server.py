"""Mission protocol server for missions, fences and rally points: requests, downloads, progress, clearing."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from firmware_py.common.intents import Answer, ReplacePlan, Request, SetMissionItem, Verdict
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans, first_item_number
from firmware_py.common.records import Severity
from firmware_py.common.reports import Snapshot
from firmware_py.link.commands.steering import GUIDED, go_to_waypoint
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.mission.items import KINDS, NAMES, DuplicateMessages, acknowledge, home_item, item_message
from firmware_py.link.mission.upload import PlanUploads
from firmware_py.link.peers import Peer, Sender, Station, sender_of, station_of
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.timeouts import timeouts_of
from firmware_py.plans.fence import Breach, find_breaches
from firmware_py.plans.problem import PlanResult

_ALL_KINDS = 255  # MAV_MISSION_TYPE_ALL, of MISSION_CLEAR_ALL only
_CURRENT_ID = 42  # MISSION_CURRENT
_REACHED = mavlink.MAVLink_mission_item_reached_message

KindHandler = Callable[[Peer, Message, PlanKind, float], None]

_COUNT = mavlink.mavlink_map[44]  # MISSION_COUNT
_REQUEST_INT = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
_MAX_DOWNLOADS = 16
_MAX_PART_ITEMS = 16  # in a reply to MISSION_REQUEST_PARTIAL_LIST

CORNERS_PER_TICK = 500  # fence corners in all checks of a tick: about half a millisecond


class MissionServer:
    """Replies to every message of the mission protocol: without a reply, a ground station waits for its timeout."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context, which sends messages and passes on requests."""
        self._context = context
        self._uploads = PlanUploads(context)
        self._downloads = PlanDownloads(context)
        self._fence_warning = FenceWarning(context)
        self._pending_clears: set[tuple[Station, int]] = set()  # station and MAV_MISSION_TYPE, not yet acknowledged
        self._clear_messages = DuplicateMessages()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        send_item = self._with_kind(self._downloads.send_item)
        return {
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST: self._with_kind(self._downloads.send_part),
            mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: self._with_kind(self._uploads.begin_part),
            mavlink.MAVLINK_MSG_ID_MISSION_ITEM: self._receive_item,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST: send_item,
            mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT: self._set_current,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._with_kind(self._downloads.send_count),
            mavlink.MAVLINK_MSG_ID_MISSION_COUNT: self._with_kind(self._uploads.begin),
            mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._clear,
            mavlink.MAVLINK_MSG_ID_MISSION_ACK: self._end_transfer,
            _REQUEST_INT: send_item,
            mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._receive_item,
        }

    def update(self, now_s: float) -> None:
        """Update uploads and fence warnings, once a tick."""
        self._uploads.update(now_s)
        self._fence_warning.update()

    def report_progress(self, previous: Snapshot | None, snapshot: Snapshot, now_s: float) -> None:
        """Report reached items, and send MISSION_CURRENT after a change."""
        home_count = first_item_number(self._context.autopilot, PlanKind.MISSION)
        for index in snapshot.mission.reached_items:
            self._context.send_all(_REACHED(index + home_count))
        if previous is None or previous.mission != snapshot.mission:
            self._make_current_due(now_s)

    def _make_current_due(self, now_s: float) -> None:
        for peer in self._context.peers:
            peer.streams.make_due(_CURRENT_ID, now_s)

    def _with_kind(self, kind_handler: KindHandler) -> Handler:
        """Return a message handler that passes on the plan type, and refuses unknown types."""

        def handle(peer: Peer, message: Message, now_s: float) -> None:
            kind = KINDS.get(message.mission_type)
            if kind is None:
                acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.UNSUPPORTED)
                return
            kind_handler(peer, message, kind, now_s)

        return handle

    def _receive_item(self, peer: Peer, message: Message, now_s: float) -> None:
        if message.current == GUIDED:
            go_to_waypoint(self._context, peer, message, now_s)
        else:
            self._with_kind(self._uploads.receive_item)(peer, message, now_s)

    def _set_current(self, peer: Peer, message: Message, now_s: float) -> None:
        """Continue the mission with another item.

        Once that is stored, MISSION_CURRENT is sent to all peers; after a refusal it is sent to the requester.
        """
        index = max(0, message.seq - first_item_number(self._context.autopilot, PlanKind.MISSION))
        answer = self._context.request(message, SetMissionItem(index), now_s)
        if answer.verdict is Verdict.ACCEPTED:
            self._context.request_handler.when_orders_stored(partial(self._report_current, peer, message.seq))
            return
        peer.streams.make_due(_CURRENT_ID, now_s)
        self._context.send_text_limited(
            peer, Severity.WARNING, answer.text or f"Mission item {message.seq} refused", now_s
        )

    def _report_current(self, peer: Peer, sequence: int, is_stored: bool) -> None:  # noqa: FBT001 - the request handler's callback
        self._make_current_due(self._context.now_s)
        if not is_stored:
            text = f"Mission item {sequence} active but not stored"
            self._context.send_text_limited(peer, Severity.ERROR, text, self._context.now_s)

    def _end_transfer(self, peer: Peer, message: Message, _now_s: float) -> None:
        """Process a MISSION_ACK: it ends a download and, if it is not ACCEPTED, an upload."""
        kind = KINDS.get(message.mission_type)
        if kind is None:
            return
        station = station_of(peer, message)
        self._downloads.end(station, kind)
        if message.type != PlanResult.ACCEPTED:
            self._uploads.cancel(station, kind)

    def _clear(self, peer: Peer, message: Message, now_s: float) -> None:
        """Clear one plan or all, and acknowledge once the empty plans are stored."""
        kind = KINDS.get(message.mission_type)
        if kind is None and message.mission_type != _ALL_KINDS:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.UNSUPPORTED)
            return
        kinds = tuple(PlanKind) if kind is None else (kind,)
        # A duplicate gets no acknowledgement: the station would take it for the end of its next upload.
        if self._clear_messages.is_duplicate(station_of(peer, message), message, now_s):
            return
        if not all(self._uploads.may_change(peer, message, plan_kind, now_s) for plan_kind in kinds):
            return
        station = station_of(peer, message)
        request_key = (station, message.mission_type)
        # A request that is repeated before the plans are stored gets one acknowledgement.
        if request_key in self._pending_clears:
            return
        for plan_kind in kinds:
            self._uploads.cancel(station, plan_kind)
            self._downloads.end(station, plan_kind)
        non_empty = [plan_kind for plan_kind in kinds if self._context.request_handler.plans().of(plan_kind).items]
        if not non_empty:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.ACCEPTED)
            return
        self._pending_clears.add(request_key)
        finish = partial(self._pending_clears.discard, request_key)
        clearing = _Clearing(self._context, peer, sender_of(message), message.mission_type, len(non_empty), finish)
        for plan_kind in non_empty:
            request = Request(now_s, ReplacePlan(Plan(plan_kind)), *sender_of(message))
            self._context.request_handler.replace_plan(request, clearing.receive_answer)


class _Clearing:
    """Sends one acknowledgement when all plans of a request are cleared."""

    def __init__(
        self,
        context: LinkContext,
        peer: Peer,
        recipient: Sender,
        mission_type: int,
        pending_count: int,
        finish: Callable[[], None],
    ) -> None:
        self._context = context
        self._peer = peer
        self._recipient = recipient
        self._mission_type = mission_type
        self._pending_count = pending_count
        self._finish = finish
        self._failure: Answer | None = None

    def receive_answer(self, answer: Answer) -> None:
        """Store the result for one plan; acknowledge after the last one."""
        self._pending_count -= 1
        if answer.verdict is not Verdict.ACCEPTED:
            self._failure = answer
        if self._pending_count:
            return
        self._finish()
        result = PlanResult.ACCEPTED if self._failure is None else PlanResult.ERROR
        acknowledge(self._context, self._peer, self._recipient, self._mission_type, result)
        plan_name = (
            NAMES[KINDS[self._mission_type]].capitalize()
            if self._mission_type in KINDS
            else "Mission, fence and rally points"
        )
        if self._failure is None:
            self._context.send_text_all(Severity.INFO, f"{plan_name} cleared")
        else:
            self._context.send_text_all(Severity.ERROR, f"{plan_name} not cleared: {self._failure.text}")
        self._context.flush_all()


@dataclass(slots=True)
class PlanDownload:
    """The plan that a station downloads, unchanged since its request of the list, and the time of the last request."""

    plan: Plan
    used_s: float


class PlanDownloads:
    """Sends plans to ground stations."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context
        self._active: OrderedDict[tuple[Station, PlanKind], PlanDownload] = OrderedDict()

    def send_count(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Reply to MISSION_REQUEST_LIST with the number of items and the opaque id."""
        station = station_of(peer, message)
        plan = self._context.request_handler.plans().of(kind)
        keep_latest(self._active, (station, kind), PlanDownload(plan, now_s), _MAX_DOWNLOADS)
        count = _wire_count(plan, first_item_number(self._context.autopilot, kind))
        self._context.send(peer, _COUNT(*station.sender, count, int(kind), plan.identity))

    def send_item(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Reply to MISSION_REQUEST_INT with MISSION_ITEM_INT, and to MISSION_REQUEST with MISSION_ITEM."""
        plan = self._plan_for(station_of(peer, message), kind, now_s)
        if not self._send_plan_item(peer, message, kind, plan, message.seq, is_int=type(message).id == _REQUEST_INT):
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)

    def send_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Reply to MISSION_REQUEST_PARTIAL_LIST with the items; the end -1 is the last item."""
        plan = self._plan_for(station_of(peer, message), kind, now_s)
        count = _wire_count(plan, first_item_number(self._context.autopilot, kind))
        first, last = message.start_index, message.end_index if message.end_index != -1 else count - 1
        if not 0 <= first <= last < count:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)
        elif last - first >= _MAX_PART_ITEMS:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.NO_SPACE)
        else:
            for sequence in range(first, last + 1):
                self._send_plan_item(peer, message, kind, plan, sequence, is_int=True)

    def end(self, station: Station, kind: PlanKind) -> None:
        """End the download of a station."""
        self._active.pop((station, kind), None)

    def _plan_for(self, station: Station, kind: PlanKind, now_s: float) -> Plan:
        """Return the plan that a station downloads, or the present plan if it downloads none."""
        download = self._active.get((station, kind))
        if download is None or now_s - download.used_s >= timeouts_of(station.peer.transport).give_up_s:
            return self._context.request_handler.plans().of(kind)
        download.used_s = now_s
        return download.plan

    def _send_plan_item(
        self, peer: Peer, message: Message, kind: PlanKind, plan: Plan, sequence: int, *, is_int: bool
    ) -> bool:
        """Send the item with a number, or return False if it does not exist."""
        home_count = first_item_number(self._context.autopilot, kind)
        # Home is also sent without a mission: DroneKit requests it for any count.
        if sequence >= max(_wire_count(plan, home_count), home_count):
            return False
        index = sequence - home_count
        item: PlanItem = home_item(self._context.home) if index < 0 else plan.items[index]
        reply = item_message(
            item,
            sender_of(message),
            kind,
            sequence,
            home_count=home_count,
            is_current=kind is PlanKind.MISSION and index == self._current_index(),
            is_int=is_int,
        )
        self._context.send(peer, reply)
        return True

    def _current_index(self) -> int | None:
        return None if self._context.snapshot is None else self._context.snapshot.mission.index


def _wire_count(plan: Plan, home_count: int) -> int:
    """Return the number of items in the mission protocol: including home, unless the mission is empty."""
    return len(plan.items) + home_count if plan.items else 0


class FenceWarning:
    """Warns of mission items outside the fence, once after each change of a plan; each tick does some of the checks."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context
        self._plans: Plans | None = None
        self._checks: Iterator[Breach | None] = iter(())
        self._breaches: list[Breach] = []

    def update(self) -> None:
        """Continue the checks of the present plans, once a tick."""
        plans = self._context.request_handler.plans()
        if plans is not self._plans:
            self._plans, self._checks, self._breaches = plans, find_breaches(plans), []
        for _ in range(1 + CORNERS_PER_TICK // (len(plans.fence.items) + 1)):
            try:
                breach = next(self._checks)
            except StopIteration:
                self._warn()
                return
            if breach is not None:
                self._breaches.append(breach)

    def _warn(self) -> None:
        if not self._breaches:
            return
        breach, *others = self._breaches
        self._breaches = []
        text = breach.message(first_item_number(self._context.autopilot, breach.kind))
        suffix = f", and {len(others)} more" if others else ""
        self._context.send_text_all(Severity.WARNING, f"{text}{suffix}")
