"""Whom a service deals with: a station, however it comes, and the way to answer it."""

from __future__ import annotations

from firmware_py.link.peer import Peer
from firmware_py.link.wire.dialect import Message

Sender = tuple[int, int]  # MAVLink system and component


class Correspondent:
    """A station and the way by which it was heard; equal are those of one station, by whatever way.

    Its numbers alone do not tell a station, since 255 and 190 are everybody's: `ways` says which ways are one's.
    """

    __slots__ = ("_key", "peer", "sender")

    def __init__(self, peer: Peer, sender: Sender) -> None:
        """Take the way, and the numbers."""
        self.peer = peer
        self.sender = sender
        self._key = (peer.way.station, sender)

    def __eq__(self, other: object) -> bool:
        """Compare the stations."""
        return isinstance(other, Correspondent) and self._key == other._key

    def __hash__(self) -> int:
        """Hash the station."""
        return hash(self._key)


def sender_of(message: Message) -> Sender:
    """Return who sent a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def correspondent(peer: Peer, message: Message) -> Correspondent:
    """Return who sent a message, and by which way."""
    return Correspondent(peer, sender_of(message))
