"""The parameter protocol: values as C casts, types INT32 and REAL32 only (MAVSDK drops unsigned ones)."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.intents import SetParameter, Verdict
from firmware_py.link.dialect import Message, mavlink, text_of
from firmware_py.link.outbox import Priority
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session
from firmware_py.params import INDEX, TABLE
from firmware_py.records import Severity

_AT_ONCE = 32  # values of a list in one call
_QUEUED = 8  # and at most this many waiting for a slow line
_UNSTORED = 64  # changes under way; more are not heard until some are on disk
_BY_NAME = -1

_NO_SUCH = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
_REFUSED = {
    Verdict.DENIED: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    Verdict.TEMPORARILY_REJECTED: mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
}


class Parameters:
    """Lists, reads and sets the rows of params.TABLE."""

    def __init__(self, session: Session) -> None:
        """Take the session to ask and to answer through."""
        self._session = session
        self._unstored = 0

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {20: self._read, 21: self._list, 23: self._set}

    def pump(self, peer: Peer) -> None:
        """Go on with the list of a peer, as far as its line keeps up."""
        row = peer.list_row
        if row is None:
            return
        end = min(row + _AT_ONCE, len(TABLE))
        while row < end and (peer.transport.byte_rate is None or peer.outbox.waiting(Priority.REPLY) < _QUEUED):
            self._session.send(peer, self._value(row))
            row += 1
        peer.list_row = row if row < len(TABLE) else None

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        peer.list_row = 0

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        index = message.param_index
        row = INDEX.get(message.param_id) if index == _BY_NAME else index
        if row is None or not 0 <= row < len(TABLE):
            self._error(peer, message, index, _NO_SUCH)
        else:
            self._session.send(peer, self._value(row))

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; it is confirmed, to everybody, when it is on disk."""
        row = INDEX.get(message.param_id)
        if row is None:
            self._error(peer, message, _BY_NAME, _NO_SUCH)
            return
        if self._unstored >= _UNSTORED:
            return
        name = TABLE[row].name
        answer = self._session.ask(message, SetParameter(name, message.param_value), now_s)
        if answer.verdict is not Verdict.ACCEPTED:
            self._error(peer, message, row, _REFUSED.get(answer.verdict, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED))
            self._session.send(peer, self._value(row))
            self._session.say(peer, Severity.WARNING, answer.text or f"{name}: refused", now_s)
            return
        self._unstored += 1
        self._session.authority.when_stored(lambda stored: self._stored(peer, row, stored=stored))

    def _stored(self, peer: Peer, row: int, *, stored: bool) -> None:
        self._unstored -= 1
        if stored:
            self._session.send_all(self._value(row), asker=peer)
        else:
            self._session.announce(Severity.ERROR, f"{TABLE[row].name} is in force but could not be stored")
        self._session.flush_all()

    def _value(self, row: int) -> Message:
        value = self._session.authority.parameters().values()[row]
        name = text_of(TABLE[row].name, 16)
        return mavlink.MAVLink_param_value_message(name, value, int(TABLE[row].kind), len(TABLE), row)

    def _error(self, peer: Peer, message: Message, index: int, error: int) -> None:
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        name = text_of(message.param_id, 16)
        self._session.send(peer, mavlink.MAVLink_param_error_message(sender, component, name, index, error))
