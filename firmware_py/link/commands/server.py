"""COMMAND_LONG, COMMAND_INT and SET_MODE: every command is acknowledged, retries and duplicates are not repeated."""

from __future__ import annotations

import math
import struct
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.intents import Answer, Verdict
from firmware_py.common.records import Severity
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import DUPLICATE_S, Peer, Sender, Station, station_of
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.outbox import Priority

ACCEPTED = Answer(Verdict.ACCEPTED)
NEITHER = "param1 is neither 0 nor 1"

_MAX_PENDING = 8
_STORE_TIMEOUT_S = 15.0  # longer than a write waits for the ones before it
_NOT_STORED = 1  # result_param2: executed, but a restart may forget it

RETRY_S = 5.0  # a retry (confirmation > 0) within this belongs to the earlier command
SATELLITE_RETRY_S = 600.0  # by satellite, where an acknowledgement takes two minutes
OVERTAKEN_S = 2.0  # an older sequence number within this is of an overtaken or duplicate frame
RELATIVE_RETRY_S = 30.0  # QGroundControl and others repeat unacknowledged commands for so long
REPEAT_S = 1.0  # MAVSDK repeats an unanswered COMMAND_INT after half a second
REMEMBERED = 32
_LATEST = 4  # of each command: a duplicate of an earlier one may follow the opposite command
_NO_RESULT = 5  # MAV_RESULT_IN_PROGRESS

IN_PROGRESS, CANCELLED = 5, 6  # MAV_RESULT
_LATE = Answer(Verdict.FAILED, "not done in time")
UNKNOWN_PROGRESS = 255
FIRST_PROGRESS_S = 0.3  # before the first IN_PROGRESS
PROGRESS_INTERVAL_S = 1.0


class CommandCall(msgspec.Struct, frozen=True):
    """One received command; the fields are unchecked and may be NaN or infinite."""

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
        """Return the refusal of a parameter that is out of range or not a number."""
        return Answer(Verdict.DENIED, f"{self.name}: {reason}")

    @property
    def place_deg(self) -> tuple[float, float]:
        """Latitude and longitude in param5 and param6, whichever message carries them."""
        scale = 1.0 if self.frame is None else 1e-7
        return self.x * scale, self.y * scale

    @property
    def station(self) -> Station:
        """The station that sent it."""
        return station_of(self.peer, self.message)

    @property
    def sender(self) -> tuple[int, int]:
        """System and component of the sender."""
        return self.message.get_srcSystem(), self.message.get_srcComponent()


def _unknown() -> int:
    return UNKNOWN_PROGRESS


class PendingCommand:
    """A command that takes a while; its action returns this in place of an answer. `finish` is to be called once."""

    def __init__(
        self,
        *,
        timeout_s: float,
        percent: Callable[[], int] = _unknown,
        cancel: Callable[[], None] | None = None,
        poll: Callable[[], Answer | None] | None = None,
        late: Answer = _LATE,
    ) -> None:
        """Take the timeout and functions that return the progress (0 to 100), cancel, and poll the end.

        `late` is the answer after the timeout; its text follows the name of the command.
        """
        self._timeout_s = timeout_s
        self._cancel = cancel
        self._poll = poll
        self._answer: Answer | None = None
        self._done: Callable[[Answer], None] | None = None
        self._started_s = self._next_progress_s = 0.0
        self.percent = percent
        self.late = late

    def begin(self, now_s: float, done: Callable[[Answer], None]) -> None:
        """Set the function that is called at the end; at once if the end has come already."""
        self._started_s, self._next_progress_s = now_s, now_s + FIRST_PROGRESS_S
        if self._answer is None:
            self._done = done
        else:
            done(self._answer)

    @property
    def ended(self) -> bool:
        """Whether it has an answer."""
        return self._answer is not None

    def finish(self, answer: Answer) -> None:
        """End it; only the first call counts."""
        if self._answer is None:
            self._answer = answer
            # `done` refers to this command: without its release each would hold the other until the next garbage
            # collection, and a flood of commands would fill the memory.
            done, self._done = self._done, None
            if done is not None:
                done(answer)

    def cancel(self) -> bool:
        """Cancel the command; False if that is not possible any more."""
        if self._cancel is None or self._answer is not None:
            return False
        self.give_up()
        return True

    def give_up(self) -> None:
        """Cancel the command if possible, and ignore its end."""
        if self._cancel is not None:
            self._cancel()
        self._done = None

    def check_end(self) -> None:
        """Poll the end."""
        if self._poll is not None and self._answer is None and (answer := self._poll()) is not None:
            self.finish(answer)

    def progress_due(self, now_s: float) -> bool:
        """Return whether a progress message is due, and schedule the next."""
        if now_s < self._next_progress_s:
            return False
        self._next_progress_s = now_s + PROGRESS_INTERVAL_S
        return True

    def timed_out(self, now_s: float) -> bool:
        """Return whether the timeout has passed."""
        return now_s - self._started_s > self._timeout_s


CommandAction = Callable[[LinkContext, CommandCall], Answer | PendingCommand]


class CommandRow(msgspec.Struct, frozen=True):
    """One command.

    `text` is its description in the reference. `repeatable`: a retry is executed again, since it only requests data.
    `relative`: a second execution changes the result, so retries and duplicates are detected on all paths, and a
    COMMAND_INT, which has no retry counter, counts as a retry when it is repeated at once.
    """

    command: int
    name: str
    act: CommandAction
    text: str
    repeatable: bool = False
    relative: bool = False


class CommandServer:
    """Finds the row of a command, executes it and acknowledges it."""

    def __init__(self, context: LinkContext, rows: Iterable[CommandRow]) -> None:
        """Take the supported commands."""
        self._context = context
        self._rows: Mapping[int, CommandRow] = {row.command: row for row in rows}
        self._memory = CommandMemory()
        self._pending: list[tuple[CommandCall, PendingCommand]] = []
        self._storing_commands: list[tuple[CommandCall, PendingCommand]] = []  # executed, not stored yet

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {76: self._long, 75: self._int, 11: self._set_mode, 80: self._cancel}

    def update(self, now_s: float) -> None:
        """Send the progress of pending commands, and end those that take too long."""
        # The latest of several copies of a command reports for all.
        latest = {(call.peer, call.sender, call.command): pending for call, pending in self._storing_commands}
        for call, pending in (*self._pending, *self._storing_commands):
            pending.check_end()
            if pending.ended:
                continue
            if pending.timed_out(now_s):
                pending.give_up()
                self._conclude(call, pending, replace(pending.late, text=f"{call.name}: {pending.late.text}"))
            elif latest.get((call.peer, call.sender, call.command), pending) is pending and pending.progress_due(now_s):
                self._acknowledge(call, IN_PROGRESS, pending.percent())

    def _long(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute a command, or repeat the acknowledgement of a duplicate."""
        first = (message.param1, message.param2, message.param3, message.param4)
        last = (message.param5, message.param6, message.param7)
        row = self._rows.get(message.command)
        call = CommandCall(peer, message, message.command, first, *last, None, now_s, _name(row))
        # Compared as bytes, since NaN is not equal to itself.
        self._execute_once(row, call, struct.pack("<7f", *first, *last), confirmed=message.confirmation > 0)

    def _int(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute a command whose position is in integers."""
        first = (message.param1, message.param2, message.param3, message.param4)
        row = self._rows.get(message.command)
        place = (float(message.x), float(message.y), message.z)
        call = CommandCall(peer, message, message.command, first, *place, message.frame, now_s, _name(row))
        content = struct.pack("<B4fiif", message.frame, *first, message.x, message.y, message.z)
        self._execute_once(row, call, content, confirmed=False)

    def _execute_once(self, row: CommandRow | None, call: CommandCall, content: bytes, *, confirmed: bool) -> None:
        if row is None or row.repeatable:
            self._execute(row, call)
            return
        done = CommandRecord(call.now_s, call.message.get_seq(), content, call.frame is not None, call.station)
        earlier = self._memory.find_duplicate(call.command, done, confirmed=confirmed, relative=row.relative)
        if earlier is not None and earlier.result == Verdict.ACCEPTED:
            self._acknowledge_when_stored(call)  # it may have failed to be stored then
            return
        if earlier is not None:
            self._acknowledge(call, earlier.result)
            return
        # Stored first: a pending command sets its result later.
        self._memory.remember(call.command, done, relative=row.relative)
        self._execute(row, call)

    def _set_mode(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute the old message as DO_SET_MODE, and acknowledge it as a command, as ArduPilot does."""
        first = (float(message.base_mode), float(message.custom_mode), 0.0, 0.0)
        row = self._rows[int(mavlink.MAV_CMD_DO_SET_MODE)]
        number = int(mavlink.MAVLINK_MSG_ID_SET_MODE)
        call = CommandCall(peer, message, number, first, 0.0, 0.0, 0.0, None, now_s, row.name)
        self._execute_once(row, call, struct.pack("<BI", message.base_mode, message.custom_mode), confirmed=False)

    def _cancel(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Cancel a pending command of any station; a completed one is not undone."""
        for call, pending in tuple(self._pending):
            if call.command == message.command and pending.cancel():
                self._conclude(call, pending, CANCELLED)

    # ------------------------------------------------------------------ execution

    def _execute(self, row: CommandRow | None, call: CommandCall) -> None:
        if row is None:
            self._acknowledge(call, Verdict.UNSUPPORTED)
            return
        if any(under_way.command == call.command for under_way, _ in self._pending):
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, f"{call.name} is already in progress"))
            return
        answer = row.act(self._context, call)
        if isinstance(answer, PendingCommand):
            self._begin(call, answer)
        elif answer.verdict is Verdict.ACCEPTED and not row.repeatable:
            self._acknowledge_when_stored(call)
        else:
            self._conclude(call, None, answer)

    def _acknowledge_when_stored(self, call: CommandCall) -> None:
        """Acknowledge an executed command once its result is stored for the next start.

        If storing fails, it is acknowledged all the same, since it is executed; a warning is sent first.
        """
        late = Answer(Verdict.ACCEPTED, "done, but not on disk yet; a restart may forget it")
        pending = PendingCommand(timeout_s=_STORE_TIMEOUT_S, late=late)

        def kept(well: bool) -> None:  # noqa: FBT001 - the request handler's callback
            text = f"{call.name}: done, but it could not be stored; a restart may forget it"
            pending.finish(ACCEPTED if well else Answer(Verdict.ACCEPTED, text))

        self._context.request_handler.when_orders_stored(kept)
        if not pending.ended:
            self._note_result(call, IN_PROGRESS)
            self._storing_commands.append((call, pending))
        pending.begin(call.now_s, lambda answer: self._finish(call, pending, answer))

    def _begin(self, call: CommandCall, pending: PendingCommand) -> None:
        if len(self._pending) >= _MAX_PENDING:
            pending.cancel()
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, "Too many commands in progress"))
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
            self._storing_commands = [entry for entry in self._storing_commands if entry[1] is not pending]
        result = int(answer.verdict) if isinstance(answer, Answer) else answer
        text = answer.text if isinstance(answer, Answer) else ""
        unkept = result == Verdict.ACCEPTED and bool(text)
        self._note_result(call, result)
        if text:
            severity = Severity.ERROR if unkept else Severity.WARNING
            self._context.send_text_limited(call.peer, severity, text, self._context.now_s)
        self._acknowledge(call, result, second=_NOT_STORED if unkept else 0)

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


class CommandRecord(msgspec.Struct, frozen=True):
    """A received command: time, sequence number, content, station; and its result."""

    t_s: float
    sequence: int
    content: bytes
    is_int: bool  # COMMAND_INT
    station: Station
    result: int = _NO_RESULT


class CommandMemory:
    """The latest few of each command of each station, bounded.

    A relative command that is executed twice turns the boat twice. Relative commands are therefore stored by the ids of
    the sender alone: a copy on another path is a duplicate even before `PeerPaths` has assigned that path.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._done: OrderedDict[tuple[Station | Sender, int], tuple[CommandRecord, ...]] = OrderedDict()

    def __len__(self) -> int:
        """Return the number of stored commands."""
        return len(self._done)

    def find_duplicate(
        self, command: int, now: CommandRecord, *, confirmed: bool, relative: bool
    ) -> CommandRecord | None:
        """Return the command of which this is a retry or a duplicate; None for a new one."""
        latest, *earlier = self._done.get(_key(now.station, command, relative=relative), (None,))
        if latest is None:
            return None
        if relative:
            for record in (latest, *earlier):
                if _same(record, now) and _is_repeated(record, now, confirmed=confirmed):
                    return record
        if not _same(latest, now):
            return _earlier_duplicate(now, latest, earlier)
        age_s = now.t_s - latest.t_s
        if confirmed:
            return latest if age_s < (SATELLITE_RETRY_S if now.station.peer.quiet else RETRY_S) else None
        behind = (latest.sequence - now.sequence) & 0xFF
        if behind < 128 and age_s < OVERTAKEN_S:
            return latest
        return latest if relative and now.is_int and age_s < REPEAT_S else None

    def remember(self, command: int, done: CommandRecord, *, relative: bool = False) -> None:
        """Store a command as the latest of its kind."""
        key = _key(done.station, command, relative=relative)
        keep_latest(self._done, key, (done, *self._done.get(key, ()))[:_LATEST], REMEMBERED)

    def set_result(self, station: Station, command: int, sequence: int, result: int, *, relative: bool = False) -> None:
        """Set the result of the stored command with a sequence number, if there is one."""
        key = _key(station, command, relative=relative)
        records = list(self._done.get(key, ()))
        for number, record in enumerate(records):
            if record.sequence == sequence:
                records[number] = replace(record, result=result)
                self._done[key] = tuple(records)
                return


def _key(station: Station, command: int, *, relative: bool) -> tuple[Station | Sender, int]:
    return station.sender if relative else station, command


def _is_repeated(record: CommandRecord, now: CommandRecord, *, confirmed: bool) -> bool:
    """Whether a relative command was executed before: sent again with a confirmation, or a duplicate frame."""
    age_s = now.t_s - record.t_s
    path = now.station.peer.path
    if confirmed:
        return age_s < (SATELLITE_RETRY_S if now.station.peer.quiet else RELATIVE_RETRY_S)
    # A program that was restarted counts from 0 again, on a new path.
    there = path is not record.station.peer.path and path.since_s < record.t_s + OVERTAKEN_S
    return there and record.sequence == now.sequence and age_s < DUPLICATE_S


def _same(one: CommandRecord, other: CommandRecord) -> bool:
    return one.content == other.content and one.is_int is other.is_int


def _earlier_duplicate(now: CommandRecord, latest: CommandRecord, earlier: list[CommandRecord]) -> CommandRecord | None:
    """Return the command before the latest of which this frame is a delayed duplicate."""
    if now.sequence == latest.sequence:  # a sender that does not count
        return None
    return next(
        (
            record
            for record in earlier
            if record.sequence == now.sequence and _same(record, now) and now.t_s - record.t_s < OVERTAKEN_S
        ),
        None,
    )


def finish_when_stored(context: LinkContext, call: CommandCall, text: str, failure: str) -> PendingCommand:
    """Return a pending command that ends when the disk has stored its result, or failed to."""
    pending = PendingCommand(timeout_s=math.inf)

    def stored(well: bool) -> None:  # noqa: FBT001 - the request handler's callback
        if well:
            context.send_text(call.peer, Severity.NOTICE, text)
        pending.finish(Answer(Verdict.ACCEPTED) if well else Answer(Verdict.FAILED, f"{call.name}: {failure}"))

    context.request_handler.when_stored(stored)
    return pending
