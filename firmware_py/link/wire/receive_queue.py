"""What has been read and not yet been looked at: a fair share for each correspondent, and no more.

A datagram socket is shared by all who send to it. It is read much faster than frames can be
answered; what one correspondent sends beyond its share is dropped here, and not, in the
system's buffer, what the others send. Streams are read only when they have nothing waiting
here, so that their senders are held up instead.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable

from firmware_py.link.wire.transport import Address

Source = tuple[int, Address]  # index of the transport, and who
_SHARE_BYTES = 16_384  # may wait for one correspondent; one datagram may always
_STRANGERS: Source = (-1, None)  # who are not a peer share one share


class ReceiveQueue:
    """Queues of pieces by correspondent, emptied in turn."""

    def __init__(self, is_peer: Callable[[int, Address], bool]) -> None:
        """Take what tells whether somebody is a peer."""
        self._is_peer = is_peer
        self._waiting: OrderedDict[Source, deque[tuple[int, Address, bytes]]] = OrderedDict()
        self._bytes: dict[Source, int] = {}
        self.dropped = 0  # datagrams beyond somebody's share

    def __bool__(self) -> bool:
        """Return whether something waits."""
        return bool(self._waiting)

    def holds(self, index: int) -> bool:
        """Return whether something of a transport waits."""
        return any(source[0] == index for source in self._waiting)

    def offer(self, index: int, address: Address, data: bytes) -> None:
        """Queue a piece, or drop and count it."""
        source = (index, address) if self._is_peer(index, address) else _STRANGERS
        held = self._bytes.get(source, 0)
        if held and held + len(data) > _SHARE_BYTES:
            self.dropped += 1
            return
        self._waiting.setdefault(source, deque()).append((index, address, data))
        self._bytes[source] = held + len(data)

    def put_back(self, index: int, address: Address, data: bytes) -> None:
        """Queue the rest of a piece of a known correspondent before all else of his."""
        source = (index, address)
        self._waiting.setdefault(source, deque()).appendleft((index, address, data))
        self._bytes[source] = self._bytes.get(source, 0) + len(data)

    def pop(self) -> tuple[int, Address, bytes]:
        """Return the next piece, of another correspondent than the last one if there is one; KeyError of none."""
        source, queue = self._waiting.popitem(last=False)
        piece = queue.popleft()
        if queue:
            self._waiting[source] = queue
            self._bytes[source] -= len(piece[2])
        else:
            del self._bytes[source]
        return piece
