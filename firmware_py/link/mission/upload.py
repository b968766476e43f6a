"""Upload of a plan from a ground station: the items are requested one by one, validated and stored as the new plan.

There is one upload of each kind at a time. Duplicate and unexpected items are ignored; missing ones are requested
again. An upload that ends early leaves the old plan unchanged.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import msgspec

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
    new_plan_text,
    valid_item,
)
from firmware_py.link.peers import Peer, Station, station_of
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.timeouts import RetryTimer, Timeouts, timeouts_of
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import problem_of

_MAX_RESULTS = 8
_ITEM_INT = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
_HOME = PlanItem(0)  # placeholder for home
_FIRST_WAYPOINT_SKIPPED = "First waypoint is taken as home and skipped"
_REQUESTS_PER_FORMAT = 2  # without a reply, the other request (MISSION_REQUEST or its INT form) is tried


@dataclass(slots=True)
class PlanUpload:
    """Upload of the items [first_number, end_number) in the numbers of the station.

    `home_count` as in `items`. `base` is the plan of which a partial upload replaces items, None for a whole plan.
    """

    kind: PlanKind
    owner: Station
    first_number: int
    end_number: int
    home_count: int
    base: Plan | None
    timeouts: Timeouts
    retry: RetryTimer
    last_item_s: float
    items: list[PlanItem] = field(default_factory=list)
    uses_int: bool = True  # items are requested by MISSION_REQUEST_INT
    is_storing: bool = False
    has_waypoint_for_home: bool = False  # the station does not use item 0 for home

    @property
    def next_number(self) -> int:
        """The number of the next item."""
        return self.first_number + len(self.items)

    def plan(self) -> Plan:
        """Return the uploaded plan."""
        if self.base is None:
            return Plan.of(self.kind, self.items[self.home_count :])
        base = (*(_HOME,) * self.home_count, *self.base.items)
        items = (*base[: self.first_number], *self.items, *base[self.end_number :])
        return Plan.of(self.kind, items[self.home_count :])


class UploadResult(msgspec.Struct, frozen=True):
    """The result of an upload, sent again if the station repeats its last item, or after a delay any other item.

    `sequence` is the number of the last item, `identity` the opaque id of an accepted plan, otherwise 0.
    """

    sequence: int
    result: PlanResult
    identity: int
    ended_s: float


class PlanUploads:
    """The uploads of the three kinds of plan."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context, which sends messages and passes on requests."""
        self._context = context
        self._active: dict[PlanKind, PlanUpload] = {}
        self._results: OrderedDict[tuple[Station, PlanKind], UploadResult] = OrderedDict()
        self._count_messages = DuplicateMessages()

    def begin(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Start or restart an upload (MISSION_COUNT)."""
        home_count = first_item_number(self._context.autopilot, kind)
        owner = station_of(peer, message)
        if self._count_messages.is_duplicate(owner, message, now_s) or not self.may_change(peer, message, kind, now_s):
            return
        self._discard(owner, kind)
        if message.count > MAX_PLAN_ITEMS + home_count:
            text = f"{message.count} items; at most {MAX_PLAN_ITEMS} are supported"
            self._refuse(owner, PlanProblem(None, PlanResult.NO_SPACE, text), kind, now_s)
            return
        self._start(owner, kind, (0, message.count), None, now_s)

    def begin_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Start an upload of some items (MISSION_WRITE_PARTIAL_LIST); the end is limited to the last item."""
        if not self.may_change(peer, message, kind, now_s):
            return
        owner = station_of(peer, message)
        self._discard(owner, kind)
        base = self._context.request_handler.plans().of(kind)
        last = len(base.items) + first_item_number(self._context.autopilot, kind) - 1
        first, end = message.start_index, min(message.end_index, last) + 1
        if not base.items or not 0 <= first < end:
            problem = PlanProblem(None, PlanResult.INVALID_SEQUENCE, "no such items to overwrite")
            self._refuse(owner, problem, kind, now_s)
            return
        self._start(owner, kind, (first, end), base, now_s)

    def receive_item(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Store an item if it is the next one, and request the following one."""
        owner = station_of(peer, message)
        upload = self._active.get(kind)
        if upload is None or upload.owner != owner:
            self._reply_to_stray_item(owner, message, kind, now_s)
            return
        upload.owner, upload.last_item_s = owner, now_s  # the next request is sent to the link of this item
        if upload.is_storing or message.seq != upload.next_number:
            if message.seq == upload.next_number - 1:
                upload.retry.add_second_response(now_s)
            return
        upload.retry.add_response(now_s)
        upload.uses_int = type(message).id == _ITEM_INT
        item = self._check_item(upload, message)
        if isinstance(item, PlanProblem):
            self._end_upload(upload, message.seq, item, now_s)
            return
        upload.items.append(item)
        self._request_next(upload, now_s)

    def cancel(self, owner: Station, kind: PlanKind) -> None:
        """Cancel the upload of a station, unless its plan is being stored."""
        upload = self._active.get(kind)
        if upload is not None and upload.owner == owner and not upload.is_storing:
            del self._active[kind]

    def update(self, now_s: float) -> None:
        """Repeat requests without a reply, and end uploads of silent stations."""
        for upload in tuple(self._active.values()):
            if upload.is_storing:
                continue
            if now_s - upload.last_item_s >= upload.retry.give_up_s:
                text = f"station silent at item {upload.next_number}"
                self._end_upload(
                    upload, upload.next_number, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s
                )
            elif upload.retry.is_due(now_s):
                upload.retry.add_repetition(now_s)
                if not upload.items and upload.retry.repetitions % _REQUESTS_PER_FORMAT == 0:  # no reply yet
                    upload.uses_int = not upload.uses_int
                self._request(upload)

    def may_change(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> bool:
        """Return whether a station may change a plan; refuse it during the upload of another station."""
        upload, owner = self._active.get(kind), station_of(peer, message)
        if upload is None or upload.owner == owner:
            return True
        # A station that reconnects is another peer: its own former upload does not delay it.
        is_present = any(Station(other, upload.owner.sender) == upload.owner for other in self._context.all_peers())
        if is_present and now_s - upload.last_item_s < upload.timeouts.yield_s:
            text = f"system {upload.owner.sender[0]} is uploading"
            self._refuse(owner, PlanProblem(None, PlanResult.DENIED, text), kind, now_s, message.mission_type)
            return False
        text = f"replaced by system {owner.sender[0]}"
        self._end_upload(upload, upload.next_number, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s)
        return True

    def _discard(self, owner: Station, kind: PlanKind) -> None:
        """Discard the upload and the result of a station that requests a new upload, even if the request is refused."""
        self._active.pop(kind, None)
        self._results.pop((owner, kind), None)

    def _start(self, owner: Station, kind: PlanKind, span: tuple[int, int], base: Plan | None, now_s: float) -> None:
        timeouts = timeouts_of(owner.peer.transport)
        home_count = first_item_number(self._context.autopilot, kind)
        upload = PlanUpload(kind, owner, *span, home_count, base, timeouts, RetryTimer(timeouts), now_s)
        self._active[kind] = upload
        self._request_next(upload, now_s)

    def _request_next(self, upload: PlanUpload, now_s: float) -> None:
        if upload.next_number < upload.end_number:
            upload.retry.start_request(now_s)
            self._request(upload)
            return
        upload.is_storing = True
        plan = upload.plan()
        problem = problem_of(plan)
        if upload.base is not None and self._context.request_handler.plans().of(upload.kind) != upload.base:
            problem = PlanProblem(None, PlanResult.ERROR, "the plan has changed during the upload")
        if problem is not None:
            self._end_upload(upload, upload.end_number - 1, problem, now_s)
            return
        if not plan.items and not self._context.request_handler.plans().of(upload.kind).items:
            self._end_upload(upload, upload.end_number - 1, None, now_s)
            return
        request = Request(now_s, ReplacePlan(plan), *upload.owner.sender)
        self._context.request_handler.replace_plan(request, lambda answer: self._finish_storing(upload, plan, answer))

    def _check_item(self, upload: PlanUpload, message: Message) -> PlanItem | PlanProblem:
        index = message.seq - upload.home_count
        if index < 0:
            # Item 0 is the home of the station, as in ArduPilot: it is not part of the plan and not validated.
            upload.has_waypoint_for_home = is_waypoint_for_home(message, self._context.home)
            return _HOME
        return valid_item(message, upload.kind, index, upload.home_count)

    def _request(self, upload: PlanUpload) -> None:
        make_message = (
            mavlink.MAVLink_mission_request_int_message if upload.uses_int else mavlink.MAVLink_mission_request_message
        )
        self._context.send(upload.owner.peer, make_message(*upload.owner.sender, upload.next_number, int(upload.kind)))

    def _finish_storing(self, upload: PlanUpload, plan: Plan, answer: Answer) -> None:
        if answer.verdict is Verdict.ACCEPTED:
            self._context.send_text_all(Severity.INFO, new_plan_text(plan, self._context.autopilot))
        # If a newer upload of the same kind has begun, its station waits for the result of that one.
        if self._active.get(upload.kind) is upload:
            problem = None
            if answer.verdict is not Verdict.ACCEPTED:
                problem = PlanProblem(None, PlanResult.ERROR, answer.text or "it was refused")
            self._end_upload(upload, upload.end_number - 1, problem, self._context.now_s, plan.identity)
        self._context.flush_all()

    def _end_upload(
        self, upload: PlanUpload, sequence: int, problem: PlanProblem | None, now_s: float, identity: int = 0
    ) -> None:
        """End an upload and send its result: accepted if there is no problem."""
        del self._active[upload.kind]
        result = PlanResult.ACCEPTED if problem is None else problem.result
        upload_result = UploadResult(sequence, result, 0 if problem else identity, now_s)
        keep_latest(self._results, (upload.owner, upload.kind), upload_result, _MAX_RESULTS)
        if problem is None:
            acknowledge(self._context, upload.owner.peer, upload.owner.sender, int(upload.kind), result, identity)
            if upload.has_waypoint_for_home:
                self._context.send_text(upload.owner.peer, Severity.WARNING, _FIRST_WAYPOINT_SKIPPED)
            return
        self._refuse(upload.owner, problem, upload.kind, now_s)

    def _refuse(
        self, station: Station, problem: PlanProblem, kind: PlanKind, now_s: float, mission_type: int | None = None
    ) -> None:
        """Send a refusal; `mission_type` is that of the request, if it is to clear all plans."""
        acknowledged_type = int(kind) if mission_type is None else mission_type
        acknowledge(self._context, station.peer, station.sender, acknowledged_type, problem.result)
        reason = problem.message(first_item_number(self._context.autopilot, kind))
        text = f"{NAMES[kind].capitalize()} rejected: {reason}"
        self._context.send_text_limited(station.peer, Severity.WARNING, text, now_s)

    def _reply_to_stray_item(self, owner: Station, message: Message, kind: PlanKind, now_s: float) -> None:
        """Reply to an unexpected item with the result, which its sender may have missed, or with a refusal.

        For some time after the end, only the last item gets a reply: the others are late duplicates.
        """
        upload_result = self._results.get((owner, kind))
        if upload_result is None:
            result = PlanResult.DENIED if kind in self._active else PlanResult.ERROR
            acknowledge(self._context, owner.peer, owner.sender, int(kind), result)
        elif (
            message.seq == upload_result.sequence
            or now_s - upload_result.ended_s > timeouts_of(owner.peer.transport).longest_s
        ):
            result, identity = upload_result.result, upload_result.identity
            acknowledge(self._context, owner.peer, owner.sender, int(kind), result, identity)
