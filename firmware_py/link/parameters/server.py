"""Parameter protocol servers: PARAM and PARAM_EXT messages."""

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
from firmware_py.link.wire.dialect import Message, encode_text, mavlink
from firmware_py.link.wire.outbox import Priority

_MAX_ROWS_PER_CALL = 8  # about half a millisecond
_FRAME_BYTES = 50  # of the longest PARAM_VALUE, signed
_MAX_QUEUED_SLOW = 8  # messages in the queue of a serial line
_MAX_QUEUED_FAST = 64  # messages in the queue of a network link
_MAX_PEER_UNSTORED = 32  # changes of one peer that are not stored yet; further changes are ignored
_MAX_UNSTORED = 128  # changes of all peers that are not stored yet
BY_NAME = -1
_ALWAYS_SET = "FENCE_ENABLE"  # commands can override it; setting its present value ends the override

_DOES_NOT_EXIST = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
_READ_ONLY = mavlink.MAV_PARAM_ERROR_READ_ONLY
_ERROR_OF_VERDICT = {
    Verdict.DENIED: mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    Verdict.TEMPORARILY_REJECTED: mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED,
}

_REQUEST_READ, _REQUEST_LIST, _SET = 320, 321, 323  # PARAM_EXT messages
_EXTENDED_FRAME_BYTES = 174  # signed
# Struct format by MAV_PARAM_EXT_TYPE.
_LAYOUTS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i", 7: "<Q", 8: "<q", 9: "<f", 10: "<d"}
_ACCEPTED, _UNSUPPORTED = mavlink.PARAM_ACK_ACCEPTED, mavlink.PARAM_ACK_VALUE_UNSUPPORTED
_FAILED = mavlink.PARAM_ACK_FAILED


class ParameterServer:
    """Lists, reads and sets the parameters of the table.

    A change does not queue a message. It marks the row as due for each peer; the latest value is sent when the link has
    capacity. Therefore no value is lost on a slow link.
    """

    def __init__(self, context: LinkContext) -> None:
        """Store the context, which sends messages and passes on requests."""
        self._context = context
        self._unstored: Counter[Peer | None] = Counter()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._read,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._list,
            mavlink.MAVLINK_MSG_ID_PARAM_SET: self._set,
        }

    def pump(self, peer: Peer, now_s: float) -> None:  # noqa: ARG002 - common interface of services
        """Send a peer its due rows and the next rows of its list, within the free capacity of its link."""
        if not peer.parameter_rows_due and peer.parameter_list_row is None:
            return
        max_queued = _MAX_QUEUED_SLOW if peer.transport.byte_rate is not None else _MAX_QUEUED_FAST
        rows_left = min(
            _MAX_ROWS_PER_CALL,
            max_queued - peer.outbox.queued_count(Priority.REPLY),
            peer.outbox.frames_in_credit(_FRAME_BYTES),
        )
        while rows_left > 0 and peer.parameter_rows_due:
            row = next(iter(peer.parameter_rows_due))
            del peer.parameter_rows_due[row]
            self._context.send(peer, self._value_message(row))
            rows_left -= 1
        while rows_left > 0 and peer.parameter_list_row is not None:
            self._context.send(peer, self._value_message(peer.parameter_list_row))
            peer.parameter_list_row = peer.parameter_list_row + 1 if peer.parameter_list_row + 1 < len(TABLE) else None
            rows_left -= 1
        if peer.parameter_rows_due or peer.parameter_list_row is not None:
            peer.bulk.mark_unfinished()

    def _queue_row(self, peer: Peer, row: int) -> None:
        peer.parameter_rows_due[row] = None

    def _value_message(self, row: int) -> Message:
        return self._context.parameter_value(row, row)

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - common interface of handlers
        peer.parameter_list_row = 0

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        index = message.param_index
        row = INDEX.get(message.param_id) if index == BY_NAME else index
        if row is None or not 0 <= row < len(TABLE):
            self.report_unknown(peer, message, index)
        else:
            self._queue_row(peer, row)

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; PARAM_VALUE is sent to all peers once it is stored."""
        row = INDEX.get(message.param_id)
        if row is None:
            self.report_unknown(peer, message, BY_NAME)
            return
        self.change(
            *(peer, message, row, message.param_value, now_s),
            on_refused=lambda error: self._refuse(peer, message, row, error),
            on_stored=lambda _is_stored: None,
        )

    def change(
        self,
        peer: Peer,
        message: Message,
        row: int,
        value: float,
        now_s: float,
        *,
        on_refused: Callable[[int], None],
        on_stored: Callable[[bool], None],
    ) -> None:
        """Set a parameter for the sender of a message.

        `on_refused` is called with the MAV_PARAM_ERROR, `on_stored` with True once the value is stored, or with False
        if storing has failed.
        """
        if self._unstored[peer] >= _MAX_PEER_UNSTORED or self._unstored.total() >= _MAX_UNSTORED:
            return
        name, present_value = TABLE[row].name, self._context.request_handler.parameters().values()[row]
        if TABLE[row].read_only:
            on_refused(_READ_ONLY)
            self._context.send_text_limited(peer, Severity.WARNING, f"{name} is read-only", now_s)
            return
        is_changed = value != present_value
        if is_changed or name == _ALWAYS_SET:
            answer = self._context.request(message, SetParameter(name, value), now_s)
            if answer.verdict is not Verdict.ACCEPTED:
                on_refused(_ERROR_OF_VERDICT.get(answer.verdict, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED))
                text = answer.text or f"{name}: refused"
                self._context.send_text_limited(peer, Severity.WARNING, text, now_s)
                return
        self._unstored[peer] += 1

        def finish(is_stored: bool) -> None:  # noqa: FBT001 - callback of the store
            on_stored(is_stored)
            self._report_stored(peer, (row,), is_stored=is_stored, is_changed=is_changed)

        # An unchanged value may also not be stored yet.
        self._context.request_handler.when_stored(finish)

    def _report_stored(
        self, requester: Peer | None, rows: tuple[int, ...], *, is_stored: bool, is_changed: bool = True
    ) -> None:
        """Send the new values to all peers, or report that they could not be stored."""
        self._unstored -= Counter((requester,))  # this also removes zero counts
        names = ", ".join(TABLE[row].name for row in rows[:3])
        if is_stored:
            # The requester is the first, and may be a pending peer.
            for peer in dict.fromkeys((*(() if requester is None else (requester,)), *self._context.peers)):
                if peer is requester or not peer.is_satellite:
                    for row in rows:
                        self._queue_row(peer, row)
                    self.pump(peer, self._context.now_s)
                    peer.outbox.flush(self._context.now_s)
            reboot_names = [TABLE[row].name for row in rows if TABLE[row].reboot] if is_changed else []
            if reboot_names:
                self._context.send_text_all(
                    Severity.NOTICE, f"{', '.join(reboot_names[:3])}: takes effect at the next start"
                )
        else:
            self._context.send_text_all(Severity.ERROR, f"{names} active but not stored")
        self._context.flush_all()

    def _refuse(self, peer: Peer, message: Message, row: int, error: int) -> None:
        self._send_error(peer, message, row, error)
        # pymavlink takes the first reply for an acknowledgement, and only the second one for the present value.
        self._context.send(peer, self._value_message(row))
        self._queue_row(peer, row)

    def report_unknown(self, peer: Peer, message: Message, index: int) -> None:
        """Report that the parameter of a message does not exist."""
        self._send_error(peer, message, index, _DOES_NOT_EXIST)

    def _send_error(self, peer: Peer, message: Message, index: int, error: int) -> None:
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        name = encode_text(message.param_id, 16)
        self._context.send(peer, mavlink.MAVLink_param_error_message(sender, component, name, index, error))

    def apply_file(self, content: bytes, origin: Origin, finish: Callable[[str], None]) -> None:
        """Set all parameters of an uploaded param.pck, or none (`Sink` in link/files/tree.py)."""
        request_handler = self._context.request_handler
        try:
            uploaded = unpack(content)
            # The combination must be valid, too.
            values = request_handler.parameters()
            for name, value in uploaded.items():
                values = values.replaced(name, value)
        except ParameterError as error:
            finish(str(error))
            return
        present = request_handler.parameters()
        changed = {name: value for name, value in uploaded.items() if value != present[name] or name == _ALWAYS_SET}
        answer = request_handler.decide_together(
            [
                Request(origin.now_s, SetParameter(name, value), origin.system, origin.component)
                for name, value in changed.items()
            ]
        )
        if answer.verdict is not Verdict.ACCEPTED:
            finish(answer.text or "refused")
            return
        self._unstored[None] += 1

        def report(is_stored: bool) -> None:  # noqa: FBT001 - callback of the store
            self._report_stored(None, tuple(INDEX[name] for name in changed), is_stored=is_stored)
            finish("" if is_stored else "active but not stored")

        request_handler.when_stored(report)


class ExtendedParameters:
    """Lists, reads and sets the same parameters by PARAM_EXT messages.

    MAVSDK uses them for `set_param_custom` and for a component with ProtocolVersion.EXT; without a reply to a list
    request it waits forever. The first bytes of the text field contain the value in its binary type.
    """

    def __init__(self, context: LinkContext, server: ParameterServer) -> None:
        """Store the context and the server that changes parameters."""
        self._context = context
        self._server = server

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {_REQUEST_READ: self._read, _REQUEST_LIST: self._list, _SET: self._set}

    def pump(self, peer: Peer, now_s: float) -> None:
        """Send a peer its due rows, within the free capacity of its link."""
        due = peer.extended_rows_due
        if not due:
            return
        frames = min(_MAX_ROWS_PER_CALL, len(due), peer.bulk_frames(_EXTENDED_FRAME_BYTES, now_s))
        for _ in range(frames):
            row = next(iter(due))
            del due[row]
            self._context.send(peer, self._value_message(row))
        peer.bulk.spend(frames * _EXTENDED_FRAME_BYTES)
        if due:
            peer.bulk.mark_unfinished()

    def _value_message(self, row: int) -> Message:
        name, kind = encode_text(TABLE[row].name, 16), int(TABLE[row].kind)
        value = _pack_value(self._context.request_handler.parameters().values()[row], kind)
        return mavlink.MAVLink_param_ext_value_message(name, value, kind, len(TABLE), row)

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - common interface of handlers
        """List all parameters."""
        peer.extended_rows_due.update(dict.fromkeys(range(len(TABLE))))

    def _read(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002
        """Read a parameter; the reply to an unknown one is PARAM_ERROR, since PARAM_EXT has no error message."""
        row = INDEX.get(message.param_id) if message.param_index == BY_NAME else message.param_index
        if row is None or not 0 <= row < len(TABLE):
            self._server.report_unknown(peer, message, message.param_index)
        else:
            peer.extended_rows_due[row] = None

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; PARAM_EXT_ACK is sent once it is stored."""
        row, layout = INDEX.get(message.param_id), _LAYOUTS.get(message.param_type)
        if row is None:
            self._acknowledge(peer, message, _FAILED)
        elif layout is None:
            self._acknowledge(peer, message, _UNSUPPORTED)
        else:
            self._server.change(
                *(peer, message, row, _unpack_value(message, layout), now_s),
                on_refused=lambda _error: self._acknowledge(peer, message, _UNSUPPORTED),
                on_stored=lambda is_stored: self._acknowledge(peer, message, _ACCEPTED if is_stored else _FAILED),
            )

    def _acknowledge(self, peer: Peer, message: Message, result: int) -> None:
        name, row = encode_text(message.param_id, 16), INDEX.get(message.param_id)
        kind, value = message.param_type, _raw_value(message)
        if row is not None:  # The reply has the present value, as after a refused PARAM_SET.
            kind = int(TABLE[row].kind)
            value = _pack_value(self._context.request_handler.parameters().values()[row], kind)
        self._context.send(peer, mavlink.MAVLink_param_ext_ack_message(name, value, kind, result), Priority.URGENT)


def _pack_value(number: float, kind: int) -> bytes:
    layout = _LAYOUTS[kind]
    return struct.pack(layout, number if layout in ("<f", "<d") else int(number))


def _raw_value(message: Message) -> bytes:
    return bytes(message._param_value_raw)  # noqa: SLF001 - the text attribute ends at the first zero byte


def _unpack_value(message: Message, layout: str) -> float:
    # pymavlink removes the zero bytes at the end.
    content = _raw_value(message).ljust(struct.calcsize(layout), b"\0")
    return float(struct.unpack_from(layout, content)[0])
