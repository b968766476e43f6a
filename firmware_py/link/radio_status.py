"""RADIO_STATUS: the modem in a serial line says how full its buffer is."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.context import Handler
from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message

RADIO_STATUS = 109


def handlers() -> Mapping[int, Handler]:
    """Return the messages handled here."""
    return {RADIO_STATUS: _keep_pace}


def _keep_pace(peer: Peer, message: Message, now_s: float) -> None:
    """Send no faster than the radio modem in a serial line keeps up with."""
    peer.keep_pace(message.txbuf, now_s)
