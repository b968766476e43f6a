"""A plan from a ground station: asked for item by item, judged, stored, and only then in force.

One upload of each kind goes on at a time. The station answers each request; what it sends
twice or out of turn does no harm, and what it does not send is asked for again. Whatever
ends an upload early leaves the old plan as it was.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, field, replace

from firmware_py.common.intents import Answer, ReplacePlan, Request, Verdict
from firmware_py.common.plan import MOST_ITEMS, Plan, PlanItem, PlanKind
from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.mission.items import NAMES, Sender, acknowledge, item_of, sender_of
from firmware_py.link.mission.numbers import homes
from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.timeouts import Timeouts, Waiting, timeouts_of
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import item_problem, problem_of

_REMEMBERED = 8
_DOUBLED_S = 10.0  # what a line doubles comes within this; who asks again does so with another number
_ITEM_INT = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
_HOME = PlanItem(0)  # keeps the place of home
_BY_TURNS = 2  # after so many requests in vain the old kind of request is tried, and so on by turns


@dataclass(slots=True)
class Upload:
    """An upload under way: the items [first, end) as the station numbers them; `base` is the plan that they change."""

    kind: PlanKind
    owner: Sender
    peer: Peer
    first: int
    end: int
    home_count: int
    base: Plan | None
    patience: Timeouts
    waiting: Waiting
    heard_s: float
    items: list[PlanItem] = field(default_factory=list)
    whole: bool = True  # asked for as MISSION_REQUEST_INT
    storing: bool = False

    @property
    def next(self) -> int:
        """The number of the item that is wanted."""
        return self.first + len(self.items)

    def plan(self) -> Plan:
        """Return the plan that came of it."""
        if self.base is None:
            return Plan.of(self.kind, self.items[self.home_count :])
        old = (*(_HOME,) * self.home_count, *self.base.items)
        return Plan.of(self.kind, (*old[: self.first], *self.items, *old[self.end :])[self.home_count :])


@dataclass(frozen=True, slots=True)
class Ended:
    """How an upload ended, to be said again when its last item comes again."""

    sequence: int
    result: PlanResult
    identity: int


class Uploads:
    """The uploads of the three kinds of plan."""

    def __init__(self, session: LinkContext) -> None:
        """Take the session to ask and to answer through."""
        self._session = session
        self._active: dict[PlanKind, Upload] = {}
        self._ended: OrderedDict[tuple[Sender, PlanKind], Ended] = OrderedDict()
        # The count and the frame's own number of the latest MISSION_COUNT, and when it came.
        self._counts: OrderedDict[tuple[Sender, PlanKind], tuple[tuple[int, int], float]] = OrderedDict()

    def begin(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Take a MISSION_COUNT: begin an upload, or begin it again."""
        home_count = homes(self._session.autopilot, kind)
        if self._seen_twice(message, kind, now_s) or not self.may_change(peer, message, kind, now_s):
            return
        if message.count > MOST_ITEMS + home_count:
            text = f"{message.count} items; at most {MOST_ITEMS} are kept"
            self._refuse(peer, sender_of(message), PlanProblem(None, PlanResult.NO_SPACE, text), kind, now_s)
            return
        self._start(peer, message, kind, (0, message.count), None, now_s)

    def begin_part(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Take a MISSION_WRITE_PARTIAL_LIST; an end beyond the plan means its last item."""
        if not self.may_change(peer, message, kind, now_s):
            return
        base = self._session.authority.plans().of(kind)
        last = len(base.items) + homes(self._session.autopilot, kind) - 1
        first, end = message.start_index, min(message.end_index, last) + 1
        if not base.items or not 0 <= first < end:
            fault = PlanProblem(None, PlanResult.INVALID_SEQUENCE, "there are no such items to be written anew")
            self._refuse(peer, sender_of(message), fault, kind, now_s)
            return
        self._start(peer, message, kind, (first, end), base, now_s)

    def take(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> None:
        """Take an item."""
        owner = sender_of(message)
        upload = self._active.get(kind)
        if upload is None or upload.owner != owner:
            self._take_stray(peer, message, kind, owner)
            return
        upload.peer, upload.heard_s = peer, now_s
        if upload.storing or message.seq != upload.next:
            return
        upload.waiting.answered(now_s)
        upload.whole = type(message).id == _ITEM_INT
        found = self._judged(upload, message)
        if isinstance(found, PlanProblem):
            self._end(upload, message.seq, found, now_s)
            return
        upload.items.append(found)
        self._go_on(upload, now_s)

    def cancel(self, owner: Sender, kind: PlanKind) -> bool:
        """Forget the upload of a station that has thought better of it; False when there is none."""
        upload = self._active.get(kind)
        if upload is None or upload.owner != owner or upload.storing:
            return False
        del self._active[kind]
        return True

    def update(self, now_s: float) -> None:
        """Ask again for what has not come, and end what has been silent for too long."""
        for upload in tuple(self._active.values()):
            if upload.storing:
                continue
            if now_s - upload.heard_s >= upload.patience.give_up_s:
                text = f"the station fell silent at item {upload.next}"
                self._end(upload, upload.next, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s)
            elif upload.waiting.due(now_s):
                upload.waiting.asked_again(now_s)
                if upload.waiting.tries % _BY_TURNS == 0:
                    upload.whole = not upload.whole
                self._request(upload)

    def may_change(self, peer: Peer, message: Message, kind: PlanKind, now_s: float) -> bool:
        """Return whether a station may change a plan now, or refuse: not while another one uploads it."""
        upload, owner = self._active.get(kind), sender_of(message)
        if upload is None or upload.owner == owner:
            return True
        if now_s - upload.heard_s < upload.patience.yield_s:
            text = f"system {upload.owner[0]} is uploading one now"
            self._refuse(peer, owner, PlanProblem(None, PlanResult.DENIED, text), kind, now_s, message.mission_type)
            return False
        text = f"system {owner[0]} takes its turn"
        self._end(upload, upload.next, PlanProblem(None, PlanResult.OPERATION_CANCELLED, text), now_s)
        return True

    # ------------------------------------------------------------------ parts

    def _seen_twice(self, message: Message, kind: PlanKind, now_s: float) -> bool:
        """Return whether a line has doubled a MISSION_COUNT, which would begin an upload that nobody wants."""
        key = (sender_of(message), kind)
        mark = (message.count, message.get_seq())
        before, seen_s = self._counts.get(key, ((-1, -1), -math.inf))
        if mark == before and now_s - seen_s < _DOUBLED_S:
            return True
        self._counts[key] = (mark, now_s)
        self._counts.move_to_end(key)
        if len(self._counts) > _REMEMBERED:
            self._counts.popitem(last=False)
        return False

    def _start(
        self, peer: Peer, message: Message, kind: PlanKind, span: tuple[int, int], base: Plan | None, now_s: float
    ) -> None:
        patience = timeouts_of(peer.transport)
        home_count = homes(self._session.autopilot, kind)
        owner = sender_of(message)
        upload = Upload(kind, owner, peer, *span, home_count, base, patience, Waiting(patience), now_s)
        # An upload that is begun anew starts from nothing: items of two plans never mix.
        self._active[kind] = upload
        self._ended.pop((owner, kind), None)
        self._go_on(upload, now_s)

    def _go_on(self, upload: Upload, now_s: float) -> None:
        if upload.next < upload.end:
            upload.waiting.asked(now_s)
            self._request(upload)
            return
        upload.storing = True
        plan = upload.plan()
        fault = problem_of(plan)
        if upload.base is not None and self._session.authority.plans().of(upload.kind) != upload.base:
            fault = PlanProblem(None, PlanResult.ERROR, "the plan has been changed meanwhile")
        if fault is not None:
            self._end(upload, upload.end - 1, fault, now_s)
            return
        if not plan.items and not self._session.authority.plans().of(upload.kind).items:
            self._end(upload, upload.end - 1, None, now_s)
            return
        request = Request(now_s, ReplacePlan(plan), *upload.owner)
        self._session.authority.replace_plan(request, lambda answer: self._stored(upload, plan, answer))

    def _judged(self, upload: Upload, message: Message) -> PlanItem | PlanProblem:
        index = message.seq - upload.home_count
        if index < 0:
            # What an ArduPilot is sent as item 0 is the station's idea of home: no item of the plan, and not judged.
            return _HOME
        item = item_of(message, upload.home_count)
        if isinstance(item, PlanProblem):
            return replace(item, index=index)
        return item_problem(upload.kind, index, item) or item

    def _request(self, upload: Upload) -> None:
        make = mavlink.MAVLink_mission_request_int_message if upload.whole else mavlink.MAVLink_mission_request_message
        self._session.send(upload.peer, make(*upload.owner, upload.next, int(upload.kind)))

    def _stored(self, upload: Upload, plan: Plan, answer: Answer) -> None:
        if answer.verdict is Verdict.ACCEPTED:
            self._session.announce(Severity.INFO, f"New {NAMES[upload.kind]}: {len(plan.items)} items")
        # An upload that another has followed is over for its station, which waits for the other's end.
        if self._active.get(upload.kind) is upload:
            fault = None
            if answer.verdict is not Verdict.ACCEPTED:
                fault = PlanProblem(None, PlanResult.ERROR, answer.text or "it was refused")
            self._end(upload, upload.end - 1, fault, self._session.now_s, plan.identity)
        self._session.flush_all()

    def _end(self, upload: Upload, sequence: int, fault: PlanProblem | None, now_s: float, identity: int = 0) -> None:
        """End an upload, well without a fault."""
        del self._active[upload.kind]
        ended = Ended(sequence, PlanResult.ACCEPTED if fault is None else fault.result, 0 if fault else identity)
        self._ended[upload.owner, upload.kind] = ended
        self._ended.move_to_end((upload.owner, upload.kind))
        if len(self._ended) > _REMEMBERED:
            self._ended.popitem(last=False)
        if fault is None:
            acknowledge(self._session, upload.peer, upload.owner, int(upload.kind), ended.result, ended.identity)
            return
        self._refuse(upload.peer, upload.owner, fault, upload.kind, now_s)

    def _refuse(
        self, peer: Peer, to: Sender, fault: PlanProblem, kind: PlanKind, now_s: float, shown: int | None = None
    ) -> None:
        acknowledge(self._session, peer, to, int(kind) if shown is None else shown, fault.result)
        where = "" if fault.index is None else f"item {fault.index + homes(self._session.autopilot, kind)}: "
        self._session.say(peer, Severity.WARNING, f"{NAMES[kind].capitalize()} not taken: {where}{fault.text}", now_s)

    def _take_stray(self, peer: Peer, message: Message, kind: PlanKind, owner: Sender) -> None:
        """Answer an item that is not asked for: the end that its sender may have missed, else that it is not wanted."""
        ended = self._ended.get((owner, kind))
        if ended is None:
            busy = kind in self._active
            result = PlanResult.DENIED if busy else PlanResult.ERROR
            acknowledge(self._session, peer, owner, int(kind), result)
        elif message.seq == ended.sequence:
            acknowledge(self._session, peer, owner, int(kind), ended.result, ended.identity)
