"""Upload of a plan from a ground station: requested item by item, validated, stored, and then put in force.

There is one upload of each kind at a time. Duplicate and unexpected items are ignored, missing ones are requested
again. An upload that ends early leaves the old plan unchanged.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import msgspec
from msgspec.structs import replace

from firmware_py.common.intents import Answer, ReplacePlan, Request, Verdict
from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, first_item_number
from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.mission.items import (
    NAMES,
    DuplicateMessages,
    acknowledge,
    is_waypoint_for_home,
    item_of,
    new_plan_text,
)
from firmware_py.link.peers import Peer, Station, station_of
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.timeouts import RetryTimer, Timeouts, timeouts_of
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import item_problem, problem_of

_REMEMBERED = 8
_ITEM_INT = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
_HOME = PlanItem(0)  # placeholder for home
_FIRST_WAYPOINT_SKIPPED = "First waypoint is taken as home and skipped"
_ALTERNATE_REQUESTS = 2  # after so many unanswered requests the other kind (old or INT) is tried


@dataclass(slots=True)
class PlanUpload:
    """An upload of the items [first, end), as the station numbers them; `base` is the plan that they change."""

    kind: PlanKind
    owner: Station
    first: int
    end: int
    home_count: int
    base: Plan | None
    timeouts: Timeouts
    retry: RetryTimer
    last_item_s: float
    items: list[PlanItem] = field(default_factory=list)
    whole: bool = True  # requested by MISSION_REQUEST_INT
    storing: bool = False
    waypoint_for_home: bool = False  # the station does not know that item 0 is home

    @property
    def next(self) -> int:
        """The number of the next item."""
        return self.first + len(self.items)

    def plan(self) -> Plan:
        """Return the uploaded plan."""
        if self.base is None:
            return Plan.of(self.kind, self.items[self.home_count :])
        old = (*(_HOME,) * self.home_count, *self.base.items)
        return Plan.of(self.kind, (*old[: self.first], *self.items, *old[self.end :])[self.home_count :])


class UploadEnd(msgspec.Struct, frozen=True):
    """The result of an upload, sent again if its last item is repeated, or late any other."""

    sequence: int
    result: PlanResult
    identity: int
    ended_s: float


class PlanUploads:
    """The uploads of the three kinds of plan."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._active: dict[PlanKind, PlanUpload] = {}
        self._ended: OrderedDict[tuple[Station, PlanKind], UploadEnd] = OrderedDict()
        self._counts = DuplicateMessages()

    def begin(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Start or restart an upload (MISSION_COUNT)."""
        home_count = first_item_number(self._context.autopilot, kind)
        owner = station_of(peer, message)
        if self._counts.is_duplicate(owner, message, now_s) or not self.may_change(peer, message, kind, now_s):
            return
        self._forget(owner, kind)
        if message.count > MAX_PLAN_ITEMS + home_count:
            text = f"{message.count} items; at most {MAX_PLAN_ITEMS} are supported"
            self._refuse(owner, PlanProblem(None, PlanResult.NO_SPACE, text), kind, now_s)
            return
        self._start(owner, kind, (0, message.count), None, now_s)

    def begin_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Start an upload of some items (MISSION_WRITE_PARTIAL_LIST); an end beyond the plan means its last item."""
        if not self.may_change(peer, message, kind, now_s):
            return
        owner = station_of(peer, message)
        self._forget(owner, kind)
        base = self._context.request_handler.plans().of(kind)
        last = len(base.items) + first_item_number(self._context.autopilot, kind) - 1
        first, end = message.start_index, min(message.end_index, last) + 1
        if not base.items or not 0 <= first < end:
            fault = PlanProblem(None, PlanResult.INVALID_SEQUENCE, "no such items to overwrite")
            self._refuse(owner, fault, kind, now_s)
            return
        self._start(owner, kind, (first, end), base, now_s)

    def receive_item(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Take an item."""
        owner = station_of(peer, message)
        upload = self._active.get(kind)
        if upload is None or upload.owner != owner:
            self._answer_stray_item(owner, message, kind, now_s)
            return
        upload.owner, upload.last_item_s = owner, now_s  # the next request goes to the peer of this item
        if upload.storing or message.seq != upload.next:
            if message.seq == upload.next - 1:
                upload.retry.learn_from_duplicate(now_s)
            return
        upload.retry.learn(now_s)
        upload.whole = type(message).id == _ITEM_INT
        item = self._checked_item(upload, message)
        if isinstance(item, PlanProblem):
            self._end(upload, message.seq, item, now_s)
            return
        upload.items.append(item)
        self._request_next(upload, now_s)

    def cancel(self, owner: Station, kind: PlanKind) -> bool:
        """Cancel the upload of a station; False if there is none."""
        upload = self._active.get(kind)
        if upload is None or upload.owner != owner or upload.storing:
            return False
        del self._active[kind]
        return True

    def update(self, now_s: float) -> None:
        """Repeat unanswered requests, and end silent uploads."""
        for upload in tuple(self._active.values()):
            if upload.storing:
                continue
            if now_s - upload.last_item_s >= upload.retry.give_up_s:
                text = f"station silent at item {upload.next}"
                self._end(upload, upload.next, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s)
            elif upload.retry.due(now_s):
                upload.retry.repeat(now_s)
                if not upload.items and upload.retry.tries % _ALTERNATE_REQUESTS == 0:  # no reply yet
                    upload.whole = not upload.whole
                self._request(upload)

    def may_change(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> bool:
        """Return whether a station may change a plan now; refuse it while another station uploads one."""
        upload, owner = self._active.get(kind), station_of(peer, message)
        if upload is None or upload.owner == owner:
            return True
        # A station that reconnects is another peer: it need not wait for its own former upload.
        present = any(Station(other, upload.owner.sender) == upload.owner for other in self._context.all_peers())
        if present and now_s - upload.last_item_s < upload.timeouts.yield_s:
            text = f"system {upload.owner.sender[0]} is uploading"
            self._refuse(owner, PlanProblem(None, PlanResult.DENIED, text), kind, now_s, message.mission_type)
            return False
        text = f"replaced by system {owner.sender[0]}"
        self._end(upload, upload.next, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s)
        return True

    # ------------------------------------------------------------------ steps

    def _forget(self, owner: Station, kind: PlanKind) -> None:
        """Drop the upload and its result when a station starts a new one, whether that is accepted or not."""
        self._active.pop(kind, None)
        self._ended.pop((owner, kind), None)

    def _start(self, owner: Station, kind: PlanKind, span: tuple[int, int], base: Plan | None, now_s: float) -> None:
        timeouts = timeouts_of(owner.peer.transport)
        home_count = first_item_number(self._context.autopilot, kind)
        upload = PlanUpload(kind, owner, *span, home_count, base, timeouts, RetryTimer(timeouts), now_s)
        self._active[kind] = upload
        self._request_next(upload, now_s)

    def _request_next(self, upload: PlanUpload, now_s: float) -> None:
        if upload.next < upload.end:
            upload.retry.begin(now_s)
            self._request(upload)
            return
        upload.storing = True
        plan = upload.plan()
        fault = problem_of(plan)
        if upload.base is not None and self._context.request_handler.plans().of(upload.kind) != upload.base:
            fault = PlanProblem(None, PlanResult.ERROR, "the plan has been changed meanwhile")
        if fault is not None:
            self._end(upload, upload.end - 1, fault, now_s)
            return
        if not plan.items and not self._context.request_handler.plans().of(upload.kind).items:
            self._end(upload, upload.end - 1, None, now_s)
            return
        request = Request(now_s, ReplacePlan(plan), *upload.owner.sender)
        self._context.request_handler.replace_plan(request, lambda answer: self._stored(upload, plan, answer))

    def _checked_item(self, upload: PlanUpload, message: Message) -> PlanItem | PlanProblem:
        index = message.seq - upload.home_count
        if index < 0:
            # Item 0 for an ArduPilot is the station's home: it is not part of the plan, and not validated.
            upload.waypoint_for_home = is_waypoint_for_home(message, self._context.home)
            return _HOME
        item = item_of(message, upload.home_count)
        if isinstance(item, PlanProblem):
            return replace(item, index=index)
        return item_problem(upload.kind, index, item) or item

    def _request(self, upload: PlanUpload) -> None:
        make = mavlink.MAVLink_mission_request_int_message if upload.whole else mavlink.MAVLink_mission_request_message
        self._context.send(upload.owner.peer, make(*upload.owner.sender, upload.next, int(upload.kind)))

    def _stored(self, upload: PlanUpload, plan: Plan, answer: Answer) -> None:
        if answer.verdict is Verdict.ACCEPTED:
            self._context.send_text_all(Severity.INFO, new_plan_text(plan, self._context.autopilot))
        # After a newer upload of the same kind, its station waits for the end of that one.
        if self._active.get(upload.kind) is upload:
            fault = None
            if answer.verdict is not Verdict.ACCEPTED:
                fault = PlanProblem(None, PlanResult.ERROR, answer.text or "it was refused")
            self._end(upload, upload.end - 1, fault, self._context.now_s, plan.identity)
        self._context.flush_all()

    def _end(
        self, upload: PlanUpload, sequence: int, fault: PlanProblem | None, now_s: float, identity: int = 0
    ) -> None:
        """End an upload; it is accepted without a fault."""
        del self._active[upload.kind]
        result = PlanResult.ACCEPTED if fault is None else fault.result
        ended = UploadEnd(sequence, result, 0 if fault else identity, now_s)
        keep_latest(self._ended, (upload.owner, upload.kind), ended, _REMEMBERED)
        if fault is None:
            acknowledge(
                self._context, upload.owner.peer, upload.owner.sender, int(upload.kind), ended.result, ended.identity
            )
            if upload.waypoint_for_home:
                self._context.send_text(upload.owner.peer, Severity.WARNING, _FIRST_WAYPOINT_SKIPPED)
            return
        self._refuse(upload.owner, fault, upload.kind, now_s)

    def _refuse(
        self, to: Station, fault: PlanProblem, kind: PlanKind, now_s: float, mission_type: int | None = None
    ) -> None:
        acknowledged_type = int(kind) if mission_type is None else mission_type
        acknowledge(self._context, to.peer, to.sender, acknowledged_type, fault.result)
        why = fault.message(first_item_number(self._context.autopilot, kind))
        self._context.send_text_limited(to.peer, Severity.WARNING, f"{NAMES[kind].capitalize()} rejected: {why}", now_s)

    def _answer_stray_item(self, owner: Station, message: Message, kind: PlanKind, now_s: float) -> None:
        """Answer an unexpected item: with the result that its sender may have missed, otherwise with a refusal.

        An item before the last is ignored as a duplicate at first; later the result is repeated for it.
        """
        ended = self._ended.get((owner, kind))
        if ended is None:
            busy = kind in self._active
            result = PlanResult.DENIED if busy else PlanResult.ERROR
            acknowledge(self._context, owner.peer, owner.sender, int(kind), result)
        elif message.seq == ended.sequence or now_s - ended.ended_s > timeouts_of(owner.peer.transport).longest_s:
            acknowledge(self._context, owner.peer, owner.sender, int(kind), ended.result, ended.identity)
