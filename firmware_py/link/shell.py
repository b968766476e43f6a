"""SERIAL_CONTROL: the console of a ground station, which finds no shell on board."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message, mavlink

_SERIAL_CONTROL = 126
_REPLY = mavlink.SERIAL_CONTROL_FLAG_REPLY
_NO_SHELL = b"no shell over MAVLink; log in to her computer by ssh\r\n"
_DATA = _NO_SHELL.ljust(70, b"\0")


class Shell:
    """Says that there is none, where a station would wait for ever."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to answer through."""
        self._context = context

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {_SERIAL_CONTROL: self._answer}

    def _answer(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        """Answer what is typed into a console with a line that there is no shell; an answer is not answered."""
        if message.device == mavlink.SERIAL_CONTROL_DEV_SHELL and message.count and not message.flags & _REPLY:
            make = mavlink.MAVLink_serial_control_message
            self._context.send(peer, make(message.device, _REPLY, 0, 0, len(_NO_SHELL), _DATA))
