"""The extended parameter protocol: the same rows, for who asks in PARAM_EXT.

MAVSDK does so for `set_param_custom` and for a component chosen with ProtocolVersion.EXT; after a list that nobody
answers it asks nothing more in it, and waits for ever. A value is in the first bytes of a text, as its type says.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.parameters.server import BY_NAME, ParameterServer
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.outbox import Priority

_REQUEST_READ, _REQUEST_LIST, _SET = 320, 321, 323
_AT_ONCE = 8  # values in one call: half a millisecond
_FRAME_BYTES = 174  # signed
_LAYOUTS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i", 7: "<Q", 8: "<q", 9: "<f", 10: "<d"}
_TYPE_BYTES = 8  # of the longest
_ACCEPTED, _UNSUPPORTED = mavlink.PARAM_ACK_ACCEPTED, mavlink.PARAM_ACK_VALUE_UNSUPPORTED
_FAILED = mavlink.PARAM_ACK_FAILED


class ExtendedParameters:
    """Lists, reads and sets the rows of params.TABLE for who asks in PARAM_EXT."""

    def __init__(self, context: LinkContext, server: ParameterServer) -> None:
        """Take the context to answer through and who changes parameters."""
        self._context = context
        self._server = server

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {_REQUEST_READ: self._read, _REQUEST_LIST: self._list, _SET: self._set}

    def pump(self, peer: Peer, now_s: float) -> None:
        """Send a peer what it is owed, as far as its line keeps up."""
        due = peer.extended_rows_due
        if not due:
            return
        frames = min(_AT_ONCE, len(due), peer.bulk_frames(_FRAME_BYTES, now_s))
        for _ in range(frames):
            row = next(iter(due))
            del due[row]
            self._context.send(peer, self._value(row))
        peer.bulk.spend(frames * _FRAME_BYTES)
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
        """Read a parameter; one that does not exist is answered by PARAM_ERROR, since PARAM_EXT knows none."""
        row = INDEX.get(message.param_id) if message.param_index == BY_NAME else message.param_index
        if row is None or not 0 <= row < len(TABLE):
            self._server.no_such(peer, message, message.param_index)
        else:
            peer.extended_rows_due[row] = None

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Change a value; it is acknowledged when it is on disk."""
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
        if row is not None:  # what is, as of a refusal of PARAM_SET
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
