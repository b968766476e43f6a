"""COMMAND_LONG, COMMAND_INT and SET_MODE: every command is acknowledged; retries and duplicates are not executed."""

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
PARAM1_NOT_0_OR_1 = "param1 is neither 0 nor 1"

_MAX_PENDING = 8
_STORE_TIMEOUT_S = 15.0  # longer than a write waits for earlier ones
_NOT_STORED = 1  # result_param2: executed, but lost at a restart

RETRY_S = 5.0  # maximum time from a command to its retry (confirmation > 0)
SATELLITE_RETRY_S = 600.0  # the same by satellite, where an acknowledgement takes two minutes
OVERTAKEN_S = 2.0  # maximum delay of a duplicate or of a frame that a later frame has overtaken
RELATIVE_RETRY_S = 30.0  # of a relative command: stations repeat unacknowledged commands during this time
REPEAT_S = 1.0  # of a relative COMMAND_INT: MAVSDK repeats an unacknowledged one after half a second
MAX_COMMANDS = 32  # stored commands, of all stations together
_MAX_RECORDS = 4  # of each stored command: a duplicate of an earlier one may follow the opposite command

IN_PROGRESS, CANCELLED = 5, 6  # MAV_RESULT
_COMMAND_CANCEL = 80  # message id, which the dialect of pymavlink lacks
_TIMED_OUT = Answer(Verdict.FAILED, "not done in time")
UNKNOWN_PROGRESS = 255
FIRST_PROGRESS_S = 0.3  # from the command to the first IN_PROGRESS
PROGRESS_INTERVAL_S = 1.0


class CommandCall(msgspec.Struct, frozen=True):
    """One received command; the fields are unchecked and may be NaN or infinite."""

    peer: Peer
    message: Message
    command: int
    parameters: tuple[float, float, float, float]  # param1 to param4
    x: float  # param5; in a COMMAND_INT with a position, the latitude in 1e-7 degrees
    y: float  # param6, or the longitude likewise
    z: float  # param7
    frame: int | None  # MAV_FRAME of COMMAND_INT
    now_s: float
    name: str

    def deny(self, reason: str) -> Answer:
        """Return the refusal of a parameter that is out of range or not a number."""
        return Answer(Verdict.DENIED, f"{self.name}: {reason}")

    @property
    def position_deg(self) -> tuple[float, float]:
        """Latitude and longitude from param5 and param6, in degrees for both messages."""
        scale = 1.0 if self.frame is None else 1e-7
        return self.x * scale, self.y * scale

    @property
    def station(self) -> Station:
        """The station that has sent the command."""
        return station_of(self.peer, self.message)

    @property
    def sender(self) -> tuple[int, int]:
        """System and component of the sender."""
        return self.message.get_srcSystem(), self.message.get_srcComponent()


def _unknown_progress() -> int:
    return UNKNOWN_PROGRESS


class PendingCommand:
    """A long command; its action returns this instead of an answer, and `finish` ends it."""

    def __init__(
        self,
        *,
        timeout_s: float,
        percent: Callable[[], int] = _unknown_progress,
        cancel: Callable[[], None] | None = None,
        poll: Callable[[], Answer | None] | None = None,
        timeout_answer: Answer = _TIMED_OUT,
    ) -> None:
        """Store the timeout and the functions of the command.

        `percent` returns the progress (0 to 100), `cancel` cancels, and `poll` returns the answer after the end.
        `timeout_answer` is the answer after the timeout; its text follows the name of the command.
        """
        self._timeout_s = timeout_s
        self._cancel = cancel
        self._poll = poll
        self._answer: Answer | None = None
        self._on_end: Callable[[Answer], None] | None = None
        self._started_s = self._next_progress_s = 0.0
        self.percent = percent
        self.timeout_answer = timeout_answer

    def begin(self, now_s: float, on_end: Callable[[Answer], None]) -> None:
        """Set the function that is called at the end; call it at once if the command has ended."""
        self._started_s, self._next_progress_s = now_s, now_s + FIRST_PROGRESS_S
        if self._answer is None:
            self._on_end = on_end
        else:
            on_end(self._answer)

    @property
    def has_ended(self) -> bool:
        """Whether the command has an answer."""
        return self._answer is not None

    def finish(self, answer: Answer) -> None:
        """End the command with an answer; later calls have no effect."""
        if self._answer is None:
            self._answer = answer
            # `on_end` refers to this command. Without its release, the two objects would stay in memory until the next
            # garbage collection, and a flood of commands would fill the memory.
            on_end, self._on_end = self._on_end, None
            if on_end is not None:
                on_end(answer)

    def cancel(self) -> bool:
        """Cancel the command; return False if it has ended or cannot be cancelled."""
        if self._cancel is None or self._answer is not None:
            return False
        self.abandon()
        return True

    def abandon(self) -> None:
        """Cancel the command if possible, and ignore its later end."""
        if self._cancel is not None:
            self._cancel()
        self._on_end = None

    def poll_end(self) -> None:
        """End the command if its poll function returns an answer."""
        if self._poll is not None and self._answer is None and (answer := self._poll()) is not None:
            self.finish(answer)

    def is_progress_due(self, now_s: float) -> bool:
        """Return whether a progress message is due, and schedule the next."""
        if now_s < self._next_progress_s:
            return False
        self._next_progress_s = now_s + PROGRESS_INTERVAL_S
        return True

    def has_timed_out(self, now_s: float) -> bool:
        """Return whether the timeout has passed."""
        return now_s - self._started_s > self._timeout_s


CommandAction = Callable[[LinkContext, CommandCall], Answer | PendingCommand]


class CommandRow(msgspec.Struct, frozen=True):
    """One row of the command table; `text` is its description in the reference.

    `repeatable`: a retry is executed again, since it only requests data. `relative`: a second execution changes the
    result. Therefore retries and duplicates are detected on all paths, and a COMMAND_INT, which has no retry counter,
    is a retry if it is repeated at once.
    """

    command: int
    name: str
    execute: CommandAction
    text: str
    repeatable: bool = False
    relative: bool = False


class CommandServer:
    """Executes and acknowledges commands."""

    def __init__(self, context: LinkContext, rows: Iterable[CommandRow]) -> None:
        """Store the context and the rows of the supported commands."""
        self._context = context
        self._rows: Mapping[int, CommandRow] = {row.command: row for row in rows}
        self._memory = CommandMemory()
        self._pending: list[tuple[CommandCall, PendingCommand]] = []
        self._storing_commands: list[tuple[CommandCall, PendingCommand]] = []  # executed, not yet stored

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self._receive_long,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT: self._receive_int,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._set_mode,
            _COMMAND_CANCEL: self._cancel,
        }

    def update(self, now_s: float) -> None:
        """Poll the pending commands, send their progress, and end those whose timeout has passed."""
        # If a command was sent several times, only the latest one reports progress.
        latest = {(call.peer, call.sender, call.command): pending for call, pending in self._storing_commands}
        for call, pending in (*self._pending, *self._storing_commands):
            pending.poll_end()
            if pending.has_ended:
                continue
            is_latest = latest.get((call.peer, call.sender, call.command), pending) is pending
            if pending.has_timed_out(now_s):
                pending.abandon()
                text = f"{call.name}: {pending.timeout_answer.text}"
                self._conclude(call, pending, replace(pending.timeout_answer, text=text))
            elif is_latest and pending.is_progress_due(now_s):
                self._acknowledge(call, IN_PROGRESS, pending.percent())

    def _receive_long(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute a COMMAND_LONG, or repeat the acknowledgement of a duplicate."""
        parameters = (message.param1, message.param2, message.param3, message.param4)
        position = (message.param5, message.param6, message.param7)
        row = self._rows.get(message.command)
        call = CommandCall(peer, message, message.command, parameters, *position, None, now_s, _name_of(row))
        # Duplicates are compared as bytes, since NaN is not equal to itself.
        self._execute_once(row, call, struct.pack("<7f", *parameters, *position), is_retry=message.confirmation > 0)

    def _receive_int(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute a COMMAND_INT, or repeat the acknowledgement of a duplicate."""
        parameters = (message.param1, message.param2, message.param3, message.param4)
        row = self._rows.get(message.command)
        position = (float(message.x), float(message.y), message.z)
        call = CommandCall(peer, message, message.command, parameters, *position, message.frame, now_s, _name_of(row))
        content = struct.pack("<B4fiif", message.frame, *parameters, message.x, message.y, message.z)
        self._execute_once(row, call, content, is_retry=False)

    def _execute_once(self, row: CommandRow | None, call: CommandCall, content: bytes, *, is_retry: bool) -> None:
        if row is None or row.repeatable:
            self._execute(row, call)
            return
        record = CommandRecord(call.now_s, call.message.get_seq(), content, call.frame is not None, call.station)
        original = self._memory.find_duplicate(call.command, record, is_retry=is_retry, relative=row.relative)
        if original is not None and original.result == Verdict.ACCEPTED:
            self._acknowledge_when_stored(call)  # storing may have failed before
            return
        if original is not None:
            self._acknowledge(call, original.result)
            return
        # The record is stored before the execution: a pending command sets its result later.
        self._memory.store(call.command, record, relative=row.relative)
        self._execute(row, call)

    def _set_mode(self, peer: Peer, message: Message, now_s: float) -> None:
        """Execute SET_MODE as DO_SET_MODE, and acknowledge it by COMMAND_ACK, as ArduPilot does."""
        parameters = (float(message.base_mode), float(message.custom_mode), 0.0, 0.0)
        row = self._rows[int(mavlink.MAV_CMD_DO_SET_MODE)]
        command = int(mavlink.MAVLINK_MSG_ID_SET_MODE)
        call = CommandCall(peer, message, command, parameters, 0.0, 0.0, 0.0, None, now_s, row.name)
        self._execute_once(row, call, struct.pack("<BI", message.base_mode, message.custom_mode), is_retry=False)

    def _cancel(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - common interface of handlers
        """Cancel a pending command of any station; a completed command is not undone."""
        for call, pending in tuple(self._pending):
            if call.command == message.command and pending.cancel():
                self._conclude(call, pending, CANCELLED)

    def _execute(self, row: CommandRow | None, call: CommandCall) -> None:
        if row is None:
            self._acknowledge(call, Verdict.UNSUPPORTED)
            return
        if any(pending_call.command == call.command for pending_call, _ in self._pending):
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, f"{call.name} is already in progress"))
            return
        answer = row.execute(self._context, call)
        if isinstance(answer, PendingCommand):
            self._begin(call, answer)
        elif answer.verdict is Verdict.ACCEPTED and not row.repeatable:
            self._acknowledge_when_stored(call)
        else:
            self._conclude(call, None, answer)

    def _acknowledge_when_stored(self, call: CommandCall) -> None:
        """Acknowledge an executed command once its result is stored for the next start.

        If storing fails, the command is also acknowledged, since it is executed; an error text is sent before.
        """
        timeout_answer = Answer(Verdict.ACCEPTED, "done but not yet stored")
        pending = PendingCommand(timeout_s=_STORE_TIMEOUT_S, timeout_answer=timeout_answer)

        def finish(is_stored: bool) -> None:  # noqa: FBT001 - callback of the request handler
            text = f"{call.name}: done but not stored"
            pending.finish(ACCEPTED if is_stored else Answer(Verdict.ACCEPTED, text))

        self._context.request_handler.when_orders_stored(finish)
        if not pending.has_ended:
            self._store_result(call, IN_PROGRESS)
            self._storing_commands.append((call, pending))
        pending.begin(call.now_s, lambda answer: self._finish(call, pending, answer))

    def _begin(self, call: CommandCall, pending: PendingCommand) -> None:
        if len(self._pending) >= _MAX_PENDING:
            pending.cancel()
            self._conclude(call, None, Answer(Verdict.TEMPORARILY_REJECTED, "Too many commands in progress"))
            return
        self._store_result(call, IN_PROGRESS)
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
        is_unstored = result == Verdict.ACCEPTED and bool(text)
        self._store_result(call, result)
        if text:
            severity = Severity.ERROR if is_unstored else Severity.WARNING
            self._context.send_text_limited(call.peer, severity, text, self._context.now_s)
        self._acknowledge(call, result, param2=_NOT_STORED if is_unstored else 0)

    def _store_result(self, call: CommandCall, result: int) -> None:
        row = self._rows.get(call.command)
        relative = row is not None and row.relative
        self._memory.set_result(call.station, call.command, call.message.get_seq(), result, relative=relative)

    def _acknowledge(self, call: CommandCall, result: int, percent: int = UNKNOWN_PROGRESS, *, param2: int = 0) -> None:
        progress = percent if result == IN_PROGRESS else 0
        reply = mavlink.MAVLink_command_ack_message(call.command, int(result), progress, param2, *call.sender)
        self._context.send(call.peer, reply, Priority.URGENT)


def _name_of(row: CommandRow | None) -> str:
    return "" if row is None else row.name


class CommandRecord(msgspec.Struct, frozen=True):
    """A received command: time, sequence number, content, station and result."""

    t_s: float
    sequence: int
    content: bytes
    is_int: bool  # COMMAND_INT, not COMMAND_LONG
    station: Station
    result: int = IN_PROGRESS


class CommandMemory:
    """The latest records of each command of each station, of limited number.

    A relative command that is executed twice turns the boat twice. Therefore relative commands are stored by the ids of
    the sender only: a copy on another path is a duplicate even before `PeerPaths` has assigned that path to the peer.
    """

    def __init__(self) -> None:
        """Start without commands."""
        self._records: OrderedDict[tuple[Station | Sender, int], tuple[CommandRecord, ...]] = OrderedDict()

    def __len__(self) -> int:
        """Return the number of stored commands."""
        return len(self._records)

    def find_duplicate(
        self, command: int, new: CommandRecord, *, is_retry: bool, relative: bool
    ) -> CommandRecord | None:
        """Return the record of which `new` is a retry or a duplicate; None for a new command."""
        latest, *earlier = self._records.get(_key(new.station, command, relative=relative), (None,))
        if latest is None:
            return None
        if relative:
            for record in (latest, *earlier):
                if _has_same_content(record, new) and _is_repeated(record, new, is_retry=is_retry):
                    return record
        if not _has_same_content(latest, new):
            return _find_earlier_duplicate(new, latest, earlier)
        age_s = new.t_s - latest.t_s
        if is_retry:
            return latest if age_s < (SATELLITE_RETRY_S if new.station.peer.is_satellite else RETRY_S) else None
        frames_behind = (latest.sequence - new.sequence) & 0xFF
        if frames_behind < 128 and age_s < OVERTAKEN_S:
            return latest
        return latest if relative and new.is_int and age_s < REPEAT_S else None

    def store(self, command: int, record: CommandRecord, *, relative: bool = False) -> None:
        """Store a record as the latest of its command."""
        key = _key(record.station, command, relative=relative)
        keep_latest(self._records, key, (record, *self._records.get(key, ()))[:_MAX_RECORDS], MAX_COMMANDS)

    def set_result(self, station: Station, command: int, sequence: int, result: int, *, relative: bool = False) -> None:
        """Set the result of the stored record with a sequence number, if it exists."""
        key = _key(station, command, relative=relative)
        records = list(self._records.get(key, ()))
        for position, record in enumerate(records):
            if record.sequence == sequence:
                records[position] = replace(record, result=result)
                self._records[key] = tuple(records)
                return


def _key(station: Station, command: int, *, relative: bool) -> tuple[Station | Sender, int]:
    return station.sender if relative else station, command


def _is_repeated(record: CommandRecord, new: CommandRecord, *, is_retry: bool) -> bool:
    """Return whether a relative command is a retry, or a duplicate frame by another path."""
    age_s = new.t_s - record.t_s
    path = new.station.peer.path
    if is_retry:
        return age_s < (SATELLITE_RETRY_S if new.station.peer.is_satellite else RELATIVE_RETRY_S)
    # A restarted program sends the same sequence numbers on a new path.
    is_other_path = path is not record.station.peer.path and path.since_s < record.t_s + OVERTAKEN_S
    return is_other_path and record.sequence == new.sequence and age_s < DUPLICATE_S


def _has_same_content(record: CommandRecord, other: CommandRecord) -> bool:
    return record.content == other.content and record.is_int is other.is_int


def _find_earlier_duplicate(
    new: CommandRecord, latest: CommandRecord, earlier: list[CommandRecord]
) -> CommandRecord | None:
    """Return the record before the latest of which `new` is a delayed duplicate."""
    if new.sequence == latest.sequence:  # the sender does not count its frames
        return None
    return next(
        (
            record
            for record in earlier
            if record.sequence == new.sequence and _has_same_content(record, new) and new.t_s - record.t_s < OVERTAKEN_S
        ),
        None,
    )


def finish_when_stored(context: LinkContext, call: CommandCall, text: str, failure: str) -> PendingCommand:
    """Return a pending command that ends when its result is stored, or storing has failed.

    `text` is sent after success; `failure`, after the name of the command, otherwise.
    """
    pending = PendingCommand(timeout_s=math.inf)

    def finish(is_stored: bool) -> None:  # noqa: FBT001 - callback of the request handler
        if is_stored:
            context.send_text(call.peer, Severity.NOTICE, text)
        pending.finish(Answer(Verdict.ACCEPTED) if is_stored else Answer(Verdict.FAILED, f"{call.name}: {failure}"))

    context.request_handler.when_stored(finish)
    return pending
