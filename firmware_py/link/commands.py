"""COMMAND_LONG, COMMAND_INT and SET_MODE: every command is acknowledged, retries are not repeated."""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from firmware_py.intents import Answer, Verdict
from firmware_py.link.dialect import Message, mavlink
from firmware_py.link.outbox import Priority
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session
from firmware_py.records import Severity

ACCEPTED = Answer(Verdict.ACCEPTED)

_RETRY_S = 5.0  # a confirmation within this belongs to the earlier command
_REMEMBERED = 32


@dataclass(frozen=True, slots=True)
class Call:
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


Action = Callable[[Session, Call], Answer]


@dataclass(frozen=True, slots=True)
class CommandRow:
    """One command. `repeatable`: a retry is carried out again, since it only asks for something."""

    command: int
    name: str
    act: Action
    repeatable: bool = False


class Commands:
    """Finds the row of a command, carries it out and acknowledges it."""

    def __init__(self, session: Session, rows: Iterable[CommandRow]) -> None:
        """Take the rows that are known here."""
        self._session = session
        self._rows: Mapping[int, CommandRow] = {row.command: row for row in rows}
        # (system, component, command) -> when, the parameters, the result
        self._done: OrderedDict[tuple[int, int, int], tuple[float, bytes, Verdict]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {76: self._long, 75: self._int, 11: self._set_mode}

    def _long(self, peer: Peer, message: Message, now_s: float) -> None:
        first = (message.param1, message.param2, message.param3, message.param4)
        last = (message.param5, message.param6, message.param7)
        row = self._rows.get(message.command)
        call = Call(peer, message, message.command, first, *last, None, now_s, _name(row))
        key = (message.get_srcSystem(), message.get_srcComponent(), call.command)
        asked = struct.pack("<7f", *first, *last)  # as bytes, since NaN is not equal to itself
        if message.confirmation and row is not None and not row.repeatable:
            earlier = self._done.get(key)
            if earlier is not None and earlier[1] == asked and now_s - earlier[0] < _RETRY_S:
                self._acknowledge(call, earlier[2])
                return
        verdict = self._carry_out(row, call)
        self._done[key] = (now_s, asked, verdict)
        self._done.move_to_end(key)
        if len(self._done) > _REMEMBERED:
            self._done.popitem(last=False)

    def _int(self, peer: Peer, message: Message, now_s: float) -> None:
        first = (message.param1, message.param2, message.param3, message.param4)
        place = (float(message.x), float(message.y), message.z)
        row = self._rows.get(message.command)
        self._carry_out(row, Call(peer, message, message.command, first, *place, message.frame, now_s, _name(row)))

    def _set_mode(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take the old SET_MODE message as DO_SET_MODE, acknowledged as a command as ArduPilot does."""
        first = (float(message.base_mode), float(message.custom_mode), 0.0, 0.0)
        number = int(mavlink.MAV_CMD_DO_SET_MODE)
        row = self._rows.get(number)
        call = Call(peer, message, number, first, 0.0, 0.0, 0.0, None, now_s, _name(row))
        answer = self._decide(row, call)
        self._acknowledge(call, answer.verdict, command=int(mavlink.MAVLINK_MSG_ID_SET_MODE))

    def _carry_out(self, row: CommandRow | None, call: Call) -> Verdict:
        answer = self._decide(row, call)
        self._acknowledge(call, answer.verdict)
        return answer.verdict

    def _decide(self, row: CommandRow | None, call: Call) -> Answer:
        if row is None:
            return Answer(Verdict.UNSUPPORTED)
        answer = row.act(self._session, call)
        if answer.verdict is not Verdict.ACCEPTED and answer.text:
            self._session.say(call.peer, Severity.WARNING, answer.text, call.now_s)
        return answer

    def _acknowledge(self, call: Call, verdict: Verdict, command: int | None = None) -> None:
        sender, component = call.message.get_srcSystem(), call.message.get_srcComponent()
        number = call.command if command is None else command
        reply = mavlink.MAVLink_command_ack_message(number, int(verdict), 0, 0, sender, component)
        self._session.send(call.peer, reply, Priority.URGENT)


def _name(row: CommandRow | None) -> str:
    return "" if row is None else row.name
