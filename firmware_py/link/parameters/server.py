"""The parameter protocol, PARAM and PARAM_EXT."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Mapping

from firmware_py.common.intents import Request, SetParameter, Verdict
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.records import Severity
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.files.tree import Origin
from firmware_py.link.parameters.files import unpack
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.outbox import Priority

_AT_ONCE = 8  # values of a list in one call: half a millisecond
_FRAME_BYTES = 50  # the longest, signed
_QUEUED = 8  # and at most this many waiting for a slow line
_QUEUED_FAST = 64  # or for a network that takes nothing now
_UNSTORED = 32  # changes of one station that are not stored yet; more are ignored
_MAX_UNSTORED = 128  # and of all together
BY_NAME = -1
_OVERRULED = "FENCE_ENABLE"  # changed by commands, too: setting it to its present value overrides them

_NO_SUCH = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
_READ_ONLY = mavlink.MAV_PARAM_ERROR_READ_ONLY
_REFUSED = {
    Verdict.DENIED: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    Verdict.TEMPORARILY_REJECTED: mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
}

_REQUEST_READ, _REQUEST_LIST, _SET = 320, 321, 323
_EXTENDED_FRAME_BYTES = 174  # signed
_LAYOUTS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i", 7: "<Q", 8: "<q", 9: "<f", 10: "<d"}
_TYPE_BYTES = 8  # of the longest
_ACCEPTED, _UNSUPPORTED = mavlink.PARAM_ACK_ACCEPTED, mavlink.PARAM_ACK_VALUE_UNSUPPORTED
_FAILED = mavlink.PARAM_ACK_FAILED


class ParameterServer:
    """Lists, reads and sets the rows of params.TABLE.

    A changed value is marked for each peer as a due row, not queued as a message: it is sent with its latest value when
    the line has room, so that none is lost on a slow line.
    """

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._unstored: Counter[Peer | None] = Counter()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {20: self._read, 21: self._list, 23: self._set}

    # ------------------------------------------------------------------ sending

    def pump(self, peer: Peer, now_s: float) -> None:  # noqa: ARG002 - a service like the others
        """Send a peer its due rows and the next rows of its list, as far as its line has room."""
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

    def _queue_row(self, peer: Peer, row: int) -> None:
        peer.parameter_rows_due[row] = None

    def _value(self, row: int) -> Message:
        return self._context.parameter_value(row, row)

    # ------------------------------------------------------------------ requests

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        peer.parameter_list_row = 0

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        index = message.param_index
        row = INDEX.get(message.param_id) if index == BY_NAME else index
        if row is None or not 0 <= row < len(TABLE):
            self.no_such(peer, message, index)
        else:
            self._queue_row(peer, row)

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; it is sent to all peers once it is stored."""
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
        """Set a row for the sender of a message and report the result in its protocol.

        `refused` is called with the MAV_PARAM_ERROR, `stored` once the value is stored or storing has failed.
        """
        if self._unstored[peer] >= _UNSTORED or self._unstored.total() >= _MAX_UNSTORED:
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

        # A value that is in force already may not be stored yet.
        self._context.request_handler.when_stored(done)

    def _stored(self, asker: Peer | None, rows: tuple[int, ...], *, stored: bool, changed: bool = True) -> None:
        self._unstored -= Counter((asker,))  # this also removes zero counts
        names = ", ".join(TABLE[row].name for row in rows[:3])
        if stored:
            # The asker comes first, and may be a pending peer.
            for peer in dict.fromkeys((*(() if asker is None else (asker,)), *self._context.peers)):
                if peer is asker or not peer.quiet:
                    for row in rows:
                        self._queue_row(peer, row)
                    self.pump(peer, self._context.now_s)
                    peer.outbox.flush(self._context.now_s)
            later = [TABLE[row].name for row in rows if TABLE[row].reboot] if changed else []
            if later:
                self._context.send_text_all(Severity.NOTICE, f"{', '.join(later[:3])}: takes effect at the next start")
        else:
            self._context.send_text_all(Severity.ERROR, f"{names} is in force but could not be stored")
        self._context.flush_all()

    def _refuse(self, peer: Peer, message: Message, row: int, error: int) -> None:
        self._error(peer, message, row, error)
        # Twice: pymavlink takes the first reply for its own request, and only the next one for the present value.
        self._context.send(peer, self._value(row))
        self._queue_row(peer, row)

    def no_such(self, peer: Peer, message: Message, index: int) -> None:
        """Report that the parameter of a message does not exist."""
        self._error(peer, message, index, _NO_SUCH)

    def _error(self, peer: Peer, message: Message, index: int, error: int) -> None:
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        name = text_of(message.param_id, 16)
        self._context.send(peer, mavlink.MAVLink_param_error_message(sender, component, name, index, error))

    # ------------------------------------------------------------------ upload

    def apply_file(self, content: bytes, origin: Origin, done: Callable[[str], None]) -> None:
        """Set all parameters of an uploaded param.pck, or none; a `Sink` of files/tree."""
        request_handler = self._context.request_handler
        try:
            wanted = unpack(content)
            # They must be valid together, too.
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


class ExtendedParameters:
    """PARAM_EXT: lists, reads and sets the same rows.

    MAVSDK uses it for `set_param_custom` and for a component with ProtocolVersion.EXT; without a reply to a list it
    waits forever. A value is in the first bytes of a text, by its type.
    """

    def __init__(self, context: LinkContext, server: ParameterServer) -> None:
        """Take the context and the server that changes parameters."""
        self._context = context
        self._server = server

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {_REQUEST_READ: self._read, _REQUEST_LIST: self._list, _SET: self._set}

    def pump(self, peer: Peer, now_s: float) -> None:
        """Send a peer its due rows, as far as its line has room."""
        due = peer.extended_rows_due
        if not due:
            return
        frames = min(_AT_ONCE, len(due), peer.bulk_frames(_EXTENDED_FRAME_BYTES, now_s))
        for _ in range(frames):
            row = next(iter(due))
            del due[row]
            self._context.send(peer, self._value(row))
        peer.bulk.spend(frames * _EXTENDED_FRAME_BYTES)
        if due:
            peer.bulk.mark_unfinished()

    def _value(self, row: int) -> Message:
        name, kind = text_of(TABLE[row].name, 16), int(TABLE[row].kind)
        number = self._context.request_handler.parameters().values()[row]
        value = _packed(number, kind)
        return mavlink.MAVLink_param_ext_value_message(name, value, kind, len(TABLE), row)

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """List all parameters."""
        peer.extended_rows_due.update(dict.fromkeys(range(len(TABLE))))

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        """Read a parameter; an unknown one is answered by PARAM_ERROR, since PARAM_EXT has no error."""
        row = INDEX.get(message.param_id) if message.param_index == BY_NAME else message.param_index
        if row is None or not 0 <= row < len(TABLE):
            self._server.no_such(peer, message, message.param_index)
        else:
            peer.extended_rows_due[row] = None

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; it is acknowledged once it is stored."""
        row, layout = INDEX.get(message.param_id), _LAYOUTS.get(message.param_type)
        if row is None:
            self._acknowledge(peer, message, _FAILED)
        elif layout is None:
            self._acknowledge(peer, message, _UNSUPPORTED)
        else:
            self._server.change(
                *(peer, message, row, _number(message, layout), now_s),
                refused=lambda _error: self._acknowledge(peer, message, _UNSUPPORTED),
                stored=lambda well: self._acknowledge(peer, message, _ACCEPTED if well else _FAILED),
            )

    def _acknowledge(self, peer: Peer, message: Message, result: int) -> None:
        name, row = text_of(message.param_id, 16), INDEX.get(message.param_id)
        kind, value = message.param_type, _bytes(message)
        if row is not None:  # the present value, as in a refusal of PARAM_SET
            kind = int(TABLE[row].kind)
            value = _packed(self._context.request_handler.parameters().values()[row], kind)
        self._context.send(peer, mavlink.MAVLink_param_ext_ack_message(name, value, kind, result), Priority.URGENT)


def _packed(number: float, kind: int) -> bytes:
    layout = _LAYOUTS[kind]
    return struct.pack(layout, number if layout in ("<f", "<d") else int(number))


def _bytes(message: Message) -> bytes:
    return bytes(message._param_value_raw)  # noqa: SLF001 - as text it would end at the first zero


def _number(message: Message, layout: str) -> float:
    return float(struct.unpack_from(layout, _bytes(message).ljust(_TYPE_BYTES, b"\0"))[0])
