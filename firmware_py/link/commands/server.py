"""COMMAND_LONG, COMMAND_INT and SET_MODE: every command is acknowledged, retries and duplicates are not repeated."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.intents import Answer, Verdict
from firmware_py.common.records import Severity
from firmware_py.link.commands.memory import CommandMemory, CommandRecord
from firmware_py.link.commands.pending import CANCELLED, IN_PROGRESS, UNKNOWN_PROGRESS, PendingCommand
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peers import Correspondent, Peer, correspondent
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.outbox import Priority

ACCEPTED = Answer(Verdict.ACCEPTED)
NEITHER = "param1 is neither 0 nor 1"

_MOST_PENDING = 8
_KEEP_TIMEOUT_S = 15.0  # longer than a write may have to wait for the ones before
_UNKEPT = 1  # result_param2 of what is done and may be forgotten by a restart


class CommandCall(msgspec.Struct, frozen=True):
    """One command as it came; the fields are unchecked: NaN, infinite, anything."""

    peer: Peer
    message: Message
    command: int
    parameters: tuple[float, float, float, float]  # param1 to param4
    x: float  # param5, or the x of COMMAND_INT
    y: float
    z: float
    frame: int | None  # MAV_FRAME of COMMAND_INT
    now_s: float
    name: str

    def denied(self, reason: str) -> Answer:
        """Return the refusal of a parameter that is out of range or no number."""
        return Answer(Verdict.DENIED, f"{self.name}: {reason}")

    @property
    def place_deg(self) -> tuple[float, float]:
        """Latitude and longitude in param5 and param6, whichever message carries them."""
        scale = 1.0 if self.frame is None else 1e-7
        return self.x * scale, self.y * scale

    @property
    def station(self) -> Correspondent:
        """Who sent it, by whatever way."""
        return correspondent(self.peer, self.message)

    @property
    def sender(self) -> tuple[int, int]:
        """System and component of who sent it."""
        return self.message.get_srcSystem(), self.message.get_srcComponent()


CommandAction = Callable[[LinkContext, CommandCall], Answer | PendingCommand]


class CommandRow(msgspec.Struct, frozen=True):
    """One command.

    `text` says what it does, for the reference. `repeatable`: a retry is carried out again,
    since it only asks for something. `relative`: done twice it does something else than
    done once, so that its retries and doubles are known by whatever way they come, and a
    COMMAND_INT, which has no number of its retries, is one when it comes again at once.
    """

    command: int
    name: str
    act: CommandAction
    text: str
    repeatable: bool = False
    relative: bool = False


class CommandServer:
    """Finds the row of a command, carries it out and acknowledges it."""

    def __init__(self, context: LinkContext, rows: Iterable[CommandRow]) -> None:
        """Take the rows that are known here."""
        self._context = context
        self._rows: Mapping[int, CommandRow] = {row.command: row for row in rows}
        self._memory = CommandMemory()
        self._pending: list[tuple[CommandCall, PendingCommand]] = []
        self._keeping: list[tuple[CommandCall, PendingCommand]] = []  # done, and on their way to the disk

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {76: self._long, 75: self._int, 11: self._set_mode, 80: self._cancel}

    def update(self, now_s: float) -> None:
        """Say how the commands under way are getting on, and end those that take too long."""
        # Of a row of the same command the latest speaks for all.
        latest = {(call.peer, call.sender, call.command): pending for call, pending in self._keeping}
        for call, pending in (*self._pending, *self._keeping):
            pending.check_end()
            if pending.ended:
                continue
            if pending.timed_out(now_s):
                pending.give_up()
                self._conclude(call, pending, replace(pending.late, text=f"{call.name}: {pending.late.text}"))
            elif latest.get((call.peer, call.sender, call.command), pending) is pending and pending.progress_due(now_s):
                self._acknowledge(call, IN_PROGRESS, pending.percent())

    def _long(self, peer: Peer, message: Message, now_s: float) -> None:
        """Carry out a command, or acknowledge it as before when it has come before."""
        first = (message.param1, message.param2, message.param3, message.param4)
        last = (message.param5, message.param6, message.param7)
        row = self._rows.get(message.command)
        call = CommandCall(peer, message, message.command, first, *last, None, now_s, _name(row))
        # As bytes, since NaN is not equal to itself.
        self._carry_out_once(row, call, struct.pack("<7f", *first, *last), confirmed=message.confirmation > 0)

    def _int(self, peer: Peer, message: Message, now_s: float) -> None:
        """Carry out a command whose place is in whole numbers."""
        first = (message.param1, message.param2, message.param3, message.param4)
        row = self._rows.get(message.command)
        place = (float(message.x), float(message.y), message.z)
        call = CommandCall(peer, message, message.command, first, *place, message.frame, now_s, _name(row))
        asked = struct.pack("<B4fiif", message.frame, *first, message.x, message.y, message.z)
        self._carry_out_once(row, call, asked, confirmed=False)

    def _carry_out_once(self, row: CommandRow | None, call: CommandCall, asked: bytes, *, confirmed: bool) -> None:
        if row is None or row.repeatable:
            self._carry_out(row, call)
            return
        done = CommandRecord(call.now_s, call.message.get_seq(), asked, call.frame is not None, call.station)
        earlier = self._memory.find_original(call.command, done, confirmed=confirmed, relative=row.relative)
        if earlier is not None and earlier.result == Verdict.ACCEPTED:
            self._acknowledge_when_kept(call)  # what could not be stored then may be now
            return
        if earlier is not None:
            self._acknowledge(call, earlier.result)
            return
        # Remembered first: a command under way says its result later.
        self._memory.remember(call.command, done, relative=row.relative)
        self._carry_out(row, call)

    def _set_mode(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take the old message as DO_SET_MODE, acknowledged as a command as ArduPilot does."""
        first = (float(message.base_mode), float(message.custom_mode), 0.0, 0.0)
        row = self._rows[int(mavlink.MAV_CMD_DO_SET_MODE)]
        number = int(mavlink.MAVLINK_MSG_ID_SET_MODE)
        call = CommandCall(peer, message, number, first, 0.0, 0.0, 0.0, None, now_s, row.name)
        self._carry_out_once(row, call, struct.pack("<BI", message.base_mode, message.custom_mode), confirmed=False)

    def _cancel(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Cancel a command that is under way, whoever has begun it; one that is done stays done."""
        for call, pending in tuple(self._pending):
            if call.command == message.command and pending.cancel():
                self._conclude(call, pending, CANCELLED)

    # ------------------------------------------------------------------ carrying out

    def _carry_out(self, row: CommandRow | None, call: CommandCall) -> None:
        if row is None:
            self._acknowledge(call, Verdict.UNSUPPORTED)
            return
        if any(under_way.command == call.command for under_way, _ in self._pending):
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, f"{call.name} is under way already"))
            return
        answer = row.act(self._context, call)
        if isinstance(answer, PendingCommand):
            self._begin(call, answer)
        elif answer.verdict is Verdict.ACCEPTED and not row.repeatable:
            self._acknowledge_when_kept(call)
        else:
            self._conclude(call, None, answer)

    def _acknowledge_when_kept(self, call: CommandCall) -> None:
        """Acknowledge a command that is done once the next start would go on with what came of it.

        One that cannot be kept is acknowledged all the same, since it is done; that it may be forgotten is said first.
        """
        late = Answer(Verdict.ACCEPTED, "done, but not on disk yet; a restart may forget it")
        pending = PendingCommand(timeout_s=_KEEP_TIMEOUT_S, late=late)

        def kept(well: bool) -> None:  # noqa: FBT001 - the request handler's callback
            text = f"{call.name}: done, but it could not be stored; a restart may forget it"
            pending.finish(ACCEPTED if well else Answer(Verdict.ACCEPTED, text))

        self._context.request_handler.when_orders_stored(kept)
        if not pending.ended:
            self._note_result(call, IN_PROGRESS)
            self._keeping.append((call, pending))
        pending.begin(call.now_s, lambda answer: self._finish(call, pending, answer))

    def _begin(self, call: CommandCall, pending: PendingCommand) -> None:
        if len(self._pending) >= _MOST_PENDING:
            pending.cancel()
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, "Too many commands are under way"))
            return
        self._note_result(call, IN_PROGRESS)
        self._pending.append((call, pending))
        pending.begin(call.now_s, lambda answer: self._finish(call, pending, answer))

    def _finish(self, call: CommandCall, pending: PendingCommand, answer: Answer) -> None:
        self._conclude(call, pending, answer)
        call.peer.outbox.flush(self._context.now_s)

    def _conclude(self, call: CommandCall, pending: PendingCommand | None, answer: Answer | int) -> None:
        if pending is not None:
            self._pending = [entry for entry in self._pending if entry[1] is not pending]
            self._keeping = [entry for entry in self._keeping if entry[1] is not pending]
        result = int(answer.verdict) if isinstance(answer, Answer) else answer
        text = answer.text if isinstance(answer, Answer) else ""
        unkept = result == Verdict.ACCEPTED and bool(text)
        self._note_result(call, result)
        if text:
            severity = Severity.ERROR if unkept else Severity.WARNING
            self._context.send_text_limited(call.peer, severity, text, self._context.now_s)
        self._acknowledge(call, result, second=_UNKEPT if unkept else 0)

    def _note_result(self, call: CommandCall, result: int) -> None:
        row = self._rows.get(call.command)
        relative = row is not None and row.relative
        self._memory.set_result(call.station, call.command, call.message.get_seq(), result, relative=relative)

    def _acknowledge(self, call: CommandCall, result: int, percent: int = UNKNOWN_PROGRESS, *, second: int = 0) -> None:
        progress = percent if result == IN_PROGRESS else 0
        reply = mavlink.MAVLink_command_ack_message(call.command, int(result), progress, second, *call.sender)
        self._context.send(call.peer, reply, Priority.URGENT)


def _name(row: CommandRow | None) -> str:
    return "" if row is None else row.name
