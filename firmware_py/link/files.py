"""File transfer: none yet; a refusal at once, so that ground stations fall back to the parameter protocol."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.dialect import Message, mavlink
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session

_SEQUENCE, _SESSION, _OPCODE, _SIZE, _ASKED, _DATA = 0, 2, 3, 4, 5, 12  # offsets in the payload
_PAYLOAD = 251
_ACK, _NAK = 128, 129
_UNKNOWN_COMMAND = 7


class Files:
    """Answers every request of FILE_TRANSFER_PROTOCOL with NAK, unknown command."""

    def __init__(self, session: Session) -> None:
        """Take the session to answer through."""
        self._session = session

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {110: self._refuse}

    def _refuse(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        asked = bytes(message.payload)
        if asked[_OPCODE] in (_ACK, _NAK):
            return
        reply = bytearray(_PAYLOAD)
        sequence = int.from_bytes(asked[_SEQUENCE : _SEQUENCE + 2], "little") + 1
        reply[_SEQUENCE : _SEQUENCE + 2] = (sequence & 0xFFFF).to_bytes(2, "little")
        reply[_SESSION] = asked[_SESSION]
        reply[_OPCODE] = _NAK
        reply[_SIZE] = 1
        reply[_ASKED] = asked[_OPCODE]
        reply[_DATA] = _UNKNOWN_COMMAND
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        self._session.send(peer, mavlink.MAVLink_file_transfer_protocol_message(0, sender, component, bytes(reply)))
