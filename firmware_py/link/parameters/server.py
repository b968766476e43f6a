"""The parameter protocol: values as C casts, types INT32 and REAL32 only (MAVSDK drops unsigned ones).

With another identity than ArduPilot's all are REAL32 (metadata.declared_kind).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from firmware_py.common.intents import Request, SetParameter, Verdict
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.records import Severity
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.files.tree import Origin
from firmware_py.link.parameters.pack import unpack
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.outbox import Priority

_AT_ONCE = 8  # values of a list in one call: half a millisecond
_FRAME_BYTES = 50  # the longest, signed
_QUEUED = 8  # and at most this many waiting for a slow line
_QUEUED_FAST = 64  # or for a network that takes nothing now
_UNSTORED = 32  # changes under way of one station; more of its are not heard until some are on disk
_MOST_UNSTORED = 128  # and of all together
BY_NAME = -1
_OVERRULED = "FENCE_ENABLE"  # by commands: who sets it has the last word, also to the value that it has

_NO_SUCH = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
_READ_ONLY = mavlink.MAV_PARAM_ERROR_READ_ONLY
_REFUSED = {
    Verdict.DENIED: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    Verdict.TEMPORARILY_REJECTED: mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
}


class ParameterServer:
    """Lists, reads and sets the rows of params.TABLE.

    A value that a station is to be told is owed to it as a row, not queued as a message: it is sent when its line has
    room, as it is then, so that none is lost however slow the line.
    """

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._unstored: Counter[Peer | None] = Counter()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {20: self._read, 21: self._list, 23: self._set}

    # ------------------------------------------------------------------ told

    def pump(self, peer: Peer, now_s: float) -> None:  # noqa: ARG002 - a service like the others
        """Send a peer what it is owed and go on with its list, as far as its line keeps up."""
        if not peer.parameter_rows_due and peer.parameter_list_row is None:
            return
        most = _QUEUED if peer.transport.byte_rate is not None else _QUEUED_FAST
        left = min(_AT_ONCE, most - peer.outbox.waiting(Priority.REPLY), peer.outbox.affordable(_FRAME_BYTES))
        while left > 0 and peer.parameter_rows_due:
            row = next(iter(peer.parameter_rows_due))
            del peer.parameter_rows_due[row]
            self._context.send(peer, self._value(row))
            left -= 1
        while left > 0 and peer.parameter_list_row is not None:
            self._context.send(peer, self._value(peer.parameter_list_row))
            peer.parameter_list_row = peer.parameter_list_row + 1 if peer.parameter_list_row + 1 < len(TABLE) else None
            left -= 1
        if peer.parameter_rows_due or peer.parameter_list_row is not None:
            peer.bulk.mark_unfinished()

    def _owe(self, peer: Peer, row: int) -> None:
        peer.parameter_rows_due[row] = None

    def _value(self, row: int) -> Message:
        return self._context.parameter_value(row, row)

    # ------------------------------------------------------------------ asked

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        peer.parameter_list_row = 0

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        index = message.param_index
        row = INDEX.get(message.param_id) if index == BY_NAME else index
        if row is None or not 0 <= row < len(TABLE):
            self.no_such(peer, message, index)
        else:
            self._owe(peer, row)

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; it is confirmed, to everybody, when it is on disk."""
        row = INDEX.get(message.param_id)
        if row is None:
            self.no_such(peer, message, BY_NAME)
            return
        self.change(
            *(peer, message, row, message.param_value, now_s),
            refused=lambda error: self._refuse(peer, message, row, error),
            stored=lambda _well: None,
        )

    def change(
        self,
        peer: Peer,
        message: Message,
        row: int,
        value: float,
        now_s: float,
        *,
        refused: Callable[[int], None],
        stored: Callable[[bool], None],
    ) -> None:
        """Set a row for the sender of a message and say in its protocol what has become of it.

        `refused` is called with the MAV_PARAM_ERROR, `stored` once it is on disk, or cannot be put there.
        """
        if self._unstored[peer] >= _UNSTORED or self._unstored.total() >= _MOST_UNSTORED:
            return
        name, before = TABLE[row].name, self._context.request_handler.parameters().values()[row]
        if TABLE[row].read_only:
            refused(_READ_ONLY)
            self._context.send_text_limited(peer, Severity.WARNING, f"{name} is read-only", now_s)
            return
        changed = value != before
        if changed or name == _OVERRULED:
            answer = self._context.request(message, SetParameter(name, value), now_s)
            if answer.verdict is not Verdict.ACCEPTED:
                refused(_REFUSED.get(answer.verdict, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED))
                text = answer.text or f"{name}: refused"
                self._context.send_text_limited(peer, Severity.WARNING, text, now_s)
                return
        self._unstored[peer] += 1

        def done(well: bool) -> None:  # noqa: FBT001 - the store's callback
            stored(well)
            self._stored(peer, (row,), stored=well, changed=changed)

        # A value that is in force already may still be on its way to the disk.
        self._context.request_handler.when_stored(done)

    def _stored(self, asker: Peer | None, rows: tuple[int, ...], *, stored: bool, changed: bool = True) -> None:
        self._unstored -= Counter((asker,))  # which keeps nobody who has none
        names = ", ".join(TABLE[row].name for row in rows[:3])
        if stored:
            # Who asked comes first, and need not have a place.
            for peer in dict.fromkeys((*(() if asker is None else (asker,)), *self._context.peers)):
                if peer is asker or not peer.quiet:
                    for row in rows:
                        self._owe(peer, row)
                    self.pump(peer, self._context.now_s)
                    peer.outbox.flush(self._context.now_s)  # who asked need not wait for the others
            later = [TABLE[row].name for row in rows if TABLE[row].reboot] if changed else []
            if later:
                self._context.send_text_all(Severity.NOTICE, f"{', '.join(later[:3])}: takes effect at the next start")
        else:
            self._context.send_text_all(Severity.ERROR, f"{names} is in force but could not be stored")
        self._context.flush_all()

    def _refuse(self, peer: Peer, message: Message, row: int, error: int) -> None:
        self._error(peer, message, row, error)
        # Twice: pymavlink takes the first answer for what it has asked for, and only the next one for what is.
        self._context.send(peer, self._value(row))
        self._owe(peer, row)

    def no_such(self, peer: Peer, message: Message, index: int) -> None:
        """Say that the parameter a message names does not exist."""
        self._error(peer, message, index, _NO_SUCH)

    def _error(self, peer: Peer, message: Message, index: int, error: int) -> None:
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        name = text_of(message.param_id, 16)
        self._context.send(peer, mavlink.MAVLink_param_error_message(sender, component, name, index, error))

    # ------------------------------------------------------------------ uploaded as a file

    def apply_file(self, content: bytes, origin: Origin, done: Callable[[str], None]) -> None:
        """Set all parameters of an uploaded param.pck, or none; a `Sink` of files/tree."""
        request_handler = self._context.request_handler
        try:
            wanted = unpack(content)
            # Together they must be possible as well as each by itself.
            values = request_handler.parameters()
            for name, value in wanted.items():
                values = values.replaced(name, value)
        except ParameterError as error:
            done(str(error))
            return
        before = request_handler.parameters()
        changed = {name: value for name, value in wanted.items() if value != before[name] or name == _OVERRULED}
        answer = request_handler.decide_together(
            [
                Request(origin.now_s, SetParameter(name, value), origin.system, origin.component)
                for name, value in changed.items()
            ]
        )
        if answer.verdict is not Verdict.ACCEPTED:
            done(answer.text or "refused")
            return
        self._unstored[None] += 1

        def stored(well: bool) -> None:  # noqa: FBT001 - the store's callback
            self._stored(None, tuple(INDEX[name] for name in changed), stored=well)
            done("" if well else "in force but could not be stored")

        request_handler.when_stored(stored)
