"""The mission protocol for missions, fences and rally points: requests, downloads, progress and clearing."""

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
from firmware_py.plans.fence import Breach, breaches
from firmware_py.plans.problem import PlanResult

_ALL = 255  # MAV_MISSION_TYPE_ALL, of MISSION_CLEAR_ALL only
_CURRENT = 42
_REACHED = mavlink.MAVLink_mission_item_reached_message

OfKind = Callable[[Peer, Message, PlanKind, float], None]

_COUNT = mavlink.mavlink_map[44]
_REQUEST_INT = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
_REMEMBERED = 16
_PART = 16  # maximum number of items in a request for a part of the list

CORNERS_PER_TICK = 500  # of the fence, in all checks: about half a millisecond


class MissionServer:
    """Answers every message of the mission protocol, so that no ground station waits in vain."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._uploads = PlanUploads(context)
        self._downloads = PlanDownloads(context)
        self._fence_warning = FenceWarning(context)
        self._clearing: set[tuple[Station, int]] = set()  # stations and types that wait for the acknowledgement
        self._cleared = DuplicateMessages()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        item, item_part = self._of_kind(self._downloads.send_item), self._of_kind(self._downloads.send_part)
        return {
            37: item_part,
            38: self._of_kind(self._uploads.begin_part),
            39: self._item,
            40: item,
            41: self._set_current,
            43: self._of_kind(self._downloads.send_count),
            44: self._of_kind(self._uploads.begin),
            45: self._clear,
            47: self._end_transfer,
            51: item,
            73: self._item,
        }

    def update(self, now_s: float) -> None:
        """Update uploads and fence warnings; once a tick."""
        self._uploads.update(now_s)
        self._fence_warning.update()

    def report_progress(self, before: Snapshot | None, snapshot: Snapshot, now_s: float) -> None:
        """Report reached items, and make MISSION_CURRENT due after a change."""
        home_count = first_item_number(self._context.autopilot, PlanKind.MISSION)
        for index in snapshot.mission.reached:
            self._context.send_all(_REACHED(index + home_count))
        if before is None or before.mission != snapshot.mission:
            self._make_current_due(now_s)

    def _make_current_due(self, now_s: float) -> None:
        for peer in self._context.peers:
            peer.streams.make_due(_CURRENT, now_s)

    # ------------------------------------------------------------------ messages

    def _of_kind(self, act: OfKind) -> Handler:
        """Return a handler that refuses unknown mission types."""

        def handle(peer: Peer, message: Message, now_s: float) -> None:
            kind = KINDS.get(message.mission_type)
            if kind is None:
                acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.UNSUPPORTED)
                return
            act(peer, message, kind, now_s)

        return handle

    def _item(self, peer: Peer, message: Message, now_s: float) -> None:
        if message.current == GUIDED:
            go_to_waypoint(self._context, peer, message, now_s)
        else:
            self._of_kind(self._uploads.receive_item)(peer, message, now_s)

    def _set_current(self, peer: Peer, message: Message, now_s: float) -> None:
        """Continue with another item; MISSION_CURRENT goes to all peers once stored, after a refusal to the asker."""
        index = max(0, message.seq - first_item_number(self._context.autopilot, PlanKind.MISSION))
        answer = self._context.request(message, SetMissionItem(index), now_s)
        if answer.verdict is Verdict.ACCEPTED:
            self._context.request_handler.when_orders_stored(partial(self._current_set, peer, message.seq))
            return
        peer.streams.make_due(_CURRENT, now_s)
        self._context.send_text_limited(
            peer, Severity.WARNING, answer.text or f"Mission item {message.seq} refused", now_s
        )

    def _current_set(self, peer: Peer, sequence: int, kept: bool) -> None:  # noqa: FBT001 - the request handler's callback
        self._make_current_due(self._context.now_s)
        if not kept:
            text = f"Item {sequence} is under way, but this could not be stored; a restart may forget it"
            self._context.send_text_limited(peer, Severity.ERROR, text, self._context.now_s)

    def _end_transfer(self, peer: Peer, message: Message, _now_s: float) -> None:
        """Take a MISSION_ACK: the end of a download, or, unless ACCEPTED, of an upload."""
        kind = KINDS.get(message.mission_type)
        if kind is None:
            return
        station = station_of(peer, message)
        self._downloads.end(station, kind)
        if message.type != PlanResult.ACCEPTED:
            self._uploads.cancel(station, kind)

    def _clear(self, peer: Peer, message: Message, now_s: float) -> None:
        """Clear one plan or all; acknowledged once the empty plans are stored."""
        kind = KINDS.get(message.mission_type)
        if kind is None and message.mission_type != _ALL:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.UNSUPPORTED)
            return
        kinds = tuple(PlanKind) if kind is None else (kind,)
        # No acknowledgement: during the next upload it would be taken for that one's.
        if self._cleared.is_duplicate(station_of(peer, message), message, now_s):
            return
        if not all(self._uploads.may_change(peer, message, each, now_s) for each in kinds):
            return
        station = station_of(peer, message)
        request_key = (station, message.mission_type)
        # A repeated request before the plans are stored: one acknowledgement is enough.
        if request_key in self._clearing:
            return
        for each in kinds:
            self._uploads.cancel(station, each)
            self._downloads.end(station, each)
        left = [each for each in kinds if self._context.request_handler.plans().of(each).items]
        if not left:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.ACCEPTED)
            return
        self._clearing.add(request_key)
        done = partial(self._clearing.discard, request_key)
        clearing = _Clearing(self._context, peer, sender_of(message), message.mission_type, len(left), done)
        for each in left:
            request = Request(now_s, ReplacePlan(Plan(each)), *sender_of(message))
            self._context.request_handler.replace_plan(request, clearing.receive_answer)


class _Clearing:
    """Acknowledges once all plans are cleared."""

    def __init__(
        self, context: LinkContext, peer: Peer, to: Sender, mission_type: int, left: int, done: Callable[[], None]
    ) -> None:
        self._context = context
        self._peer = peer
        self._to = to
        self._mission_type = mission_type
        self._left = left
        self._done = done
        self._failure: Answer | None = None

    def receive_answer(self, answer: Answer) -> None:
        """Take the result for one plan."""
        self._left -= 1
        if answer.verdict is not Verdict.ACCEPTED:
            self._failure = answer
        if self._left:
            return
        self._done()
        result = PlanResult.ACCEPTED if self._failure is None else PlanResult.ERROR
        acknowledge(self._context, self._peer, self._to, self._mission_type, result)
        what = (
            NAMES[KINDS[self._mission_type]].capitalize()
            if self._mission_type in KINDS
            else "Mission, fence and rally points"
        )
        if self._failure is None:
            self._context.send_text_all(Severity.INFO, f"{what} cleared")
        else:
            self._context.send_text_all(Severity.ERROR, f"{what} not cleared: {self._failure.text}")
        self._context.flush_all()


@dataclass(slots=True)
class PlanDownload:
    """The plan that a station is reading, as it was at the request of the list, so that it gets one whole plan."""

    plan: Plan
    used_s: float


class PlanDownloads:
    """Sends lists and items to stations."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context
        self._readings: OrderedDict[tuple[Station, PlanKind], PlanDownload] = OrderedDict()

    def send_count(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_LIST with the count and the opaque id."""
        reader = station_of(peer, message)
        plan = self._context.request_handler.plans().of(kind)
        keep_latest(self._readings, (reader, kind), PlanDownload(plan, now_s), _REMEMBERED)
        count = _wire_count(plan, first_item_number(self._context.autopilot, kind))
        self._context.send(peer, _COUNT(*reader.sender, count, int(kind), plan.identity))

    def send_item(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_INT, or MISSION_REQUEST in kind."""
        plan = self._plan(station_of(peer, message), kind, now_s)
        if not self._send(peer, message, kind, plan, message.seq, whole=type(message).id == _REQUEST_INT):
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)

    def send_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer MISSION_REQUEST_PARTIAL_LIST with the items themselves; -1 is the end of the list."""
        plan = self._plan(station_of(peer, message), kind, now_s)
        count = _wire_count(plan, first_item_number(self._context.autopilot, kind))
        first, last = message.start_index, message.end_index if message.end_index != -1 else count - 1
        if not 0 <= first <= last < count:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.INVALID_SEQUENCE)
        elif last - first >= _PART:
            acknowledge(self._context, peer, sender_of(message), int(kind), PlanResult.NO_SPACE)
        else:
            for sequence in range(first, last + 1):
                self._send(peer, message, kind, plan, sequence, whole=True)

    def end(self, reader: Station, kind: PlanKind) -> None:
        """End the download of a station."""
        self._readings.pop((reader, kind), None)

    def _plan(self, reader: Station, kind: PlanKind, now_s: float) -> Plan:
        """Return the plan that a station is reading, or the one in force."""
        reading = self._readings.get((reader, kind))
        if reading is None or now_s - reading.used_s >= timeouts_of(reader.peer.transport).give_up_s:
            return self._context.request_handler.plans().of(kind)
        reading.used_s = now_s
        return reading.plan

    def _send(self, peer: Peer, message: Message, kind: PlanKind, plan: Plan, sequence: int, *, whole: bool) -> bool:
        home_count = first_item_number(self._context.autopilot, kind)
        # Home is sent without a mission, too: DroneKit requests it whatever the count is.
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
    """Return the number of items as stations count them: with home, unless the mission is empty."""
    return len(plan.items) + home_count if plan.items else 0


class FenceWarning:
    """Warns of mission items that would breach the fence, once after each change; a few checks a tick."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context."""
        self._context = context
        self._plans: Plans | None = None
        self._looks: Iterator[Breach | None] = iter(())
        self._found: list[Breach] = []

    def update(self) -> None:
        """Continue the checks of the plans in force, once a tick."""
        plans = self._context.request_handler.plans()
        if plans is not self._plans:
            self._plans, self._looks, self._found = plans, breaches(plans), []
        for _ in range(1 + CORNERS_PER_TICK // (len(plans.fence.items) + 1)):
            try:
                breach = next(self._looks)
            except StopIteration:
                self._warn()
                return
            if breach is not None:
                self._found.append(breach)

    def _warn(self) -> None:
        if not self._found:
            return
        first, *others = self._found
        self._found = []
        text = first.message(first_item_number(self._context.autopilot, first.kind))
        more = f", and {len(others)} more" if others else ""
        self._context.send_text_all(Severity.WARNING, f"{text}{more}")
