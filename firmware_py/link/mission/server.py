"""The mission protocol for missions, fences and rally points: who asks what is sent to the part that answers it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from firmware_py.common.intents import Answer, ReplacePlan, Request, SetMissionItem, Verdict
from firmware_py.common.plan import Plan, PlanKind, homes
from firmware_py.common.records import Severity
from firmware_py.common.reports import Snapshot
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.mission.doubles import Marks
from firmware_py.link.mission.download import PlanDownloads
from firmware_py.link.mission.fence_warning import FenceWarning
from firmware_py.link.mission.items import KINDS, NAMES, acknowledge
from firmware_py.link.mission.upload import PlanUploads
from firmware_py.link.peers import Correspondent, Peer, Sender, correspondent, sender_of
from firmware_py.link.setpoints import GUIDED, go_to_waypoint
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.plans.problem import PlanResult

_ALL = 255  # MAV_MISSION_TYPE_ALL, of MISSION_CLEAR_ALL only
_CURRENT = 42
_REACHED = mavlink.MAVLink_mission_item_reached_message

OfKind = Callable[[Peer, Message, PlanKind, float], None]


class MissionServer:
    """Answers every message of the mission protocol, so that no ground station waits."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._uploads = PlanUploads(context)
        self._downloads = PlanDownloads(context)
        self._fence_warning = FenceWarning(context)
        self._clearing: set[tuple[Correspondent, int]] = set()  # who is still to be answered, and by which type
        self._cleared = Marks()

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
        """Go on with what goes on by itself; once a tick."""
        self._uploads.update(now_s)
        self._fence_warning.update()

    def report_progress(self, before: Snapshot | None, snapshot: Snapshot, now_s: float) -> None:
        """Tell what was reached, and hasten the rest when something has changed."""
        home_count = homes(self._context.autopilot, PlanKind.MISSION)
        for index in snapshot.mission.reached:
            self._context.send_all(_REACHED(index + home_count))
        if before is None or before.mission != snapshot.mission:
            self._make_current_due(now_s)

    def _make_current_due(self, now_s: float) -> None:
        for peer in self._context.peers:
            peer.streams.make_due(_CURRENT, now_s)

    # ------------------------------------------------------------------ messages

    def _of_kind(self, act: OfKind) -> Handler:
        """Return a handler that refuses a mission type that there is not."""

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
        """Go on with another item; MISSION_CURRENT tells everybody, or the asker that it is another one still.

        It is on disk by then, unless a tick has told it before.
        """
        index = max(0, message.seq - homes(self._context.autopilot, PlanKind.MISSION))
        answer = self._context.request(message, SetMissionItem(index), now_s)
        if answer.verdict is Verdict.ACCEPTED:
            self._context.request_handler.when_orders_stored(partial(self._current_set, peer, message.seq))
            return
        peer.streams.make_due(_CURRENT, now_s)
        self._context.send_text_limited(peer, Severity.WARNING, answer.text or f"Item {message.seq} was refused", now_s)

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
        station = correspondent(peer, message)
        self._downloads.end(station, kind)
        if message.type != PlanResult.ACCEPTED:
            self._uploads.cancel(station, kind)

    def _clear(self, peer: Peer, message: Message, now_s: float) -> None:
        """Clear one plan or all; acknowledged once the empty ones are on disk."""
        kind = KINDS.get(message.mission_type)
        if kind is None and message.mission_type != _ALL:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.UNSUPPORTED)
            return
        kinds = tuple(PlanKind) if kind is None else (kind,)
        # No answer: while the next plan is on its way it would be taken for that one's.
        if self._cleared.is_double(correspondent(peer, message), message, now_s):
            return
        if not all(self._uploads.may_change(peer, message, each, now_s) for each in kinds):
            return
        station = correspondent(peer, message)
        asked = (station, message.mission_type)
        # The same, asked again before the disk has answered: the one answer will do.
        if asked in self._clearing:
            return
        for each in kinds:
            self._uploads.cancel(station, each)
            self._downloads.end(station, each)
        left = [each for each in kinds if self._context.request_handler.plans().of(each).items]
        if not left:
            acknowledge(self._context, peer, sender_of(message), message.mission_type, PlanResult.ACCEPTED)
            return
        self._clearing.add(asked)
        done = partial(self._clearing.discard, asked)
        clearing = _Clearing(self._context, peer, sender_of(message), message.mission_type, len(left), done)
        for each in left:
            request = Request(now_s, ReplacePlan(Plan(each)), *sender_of(message))
            self._context.request_handler.replace_plan(request, clearing.receive_answer)


class _Clearing:
    """Acknowledges once all plans that are to be cleared have been."""

    def __init__(
        self, context: LinkContext, peer: Peer, to: Sender, shown: int, left: int, done: Callable[[], None]
    ) -> None:
        self._context = context
        self._peer = peer
        self._to = to
        self._shown = shown
        self._left = left
        self._done = done
        self._failure: Answer | None = None

    def receive_answer(self, answer: Answer) -> None:
        """Take the answer for one of them."""
        self._left -= 1
        if answer.verdict is not Verdict.ACCEPTED:
            self._failure = answer
        if self._left:
            return
        self._done()
        result = PlanResult.ACCEPTED if self._failure is None else PlanResult.ERROR
        acknowledge(self._context, self._peer, self._to, self._shown, result)
        what = NAMES[KINDS[self._shown]].capitalize() if self._shown in KINDS else "Mission, fence and rally points"
        if self._failure is None:
            self._context.send_text_all(Severity.INFO, f"{what} cleared")
        else:
            self._context.send_text_all(Severity.ERROR, f"{what} not cleared: {self._failure.text}")
        self._context.flush_all()
