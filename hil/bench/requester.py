"""A ground station that asks as fast as it is answered, and spends next to nothing on it."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as dialect

SYSTEM, COMPONENT = 252, 190
RETRY_S = 0.25
RETRIES = 20
BUFFER_BYTES = 1 << 22  # as much of it as the system grants
_READ_BYTES = 65536
_HEADER, _CHECKSUM, _SIGNATURE = 10, 2, 13
_MARKER = 0xFD
_LONGEST_PAYLOAD = 255


class Heard(NamedTuple):
    """A message by its number and its payload, zeros at the end included."""

    number: int
    payload: bytes


class Requester:
    """Speaks to a `udpin` link of an autopilot; close it."""

    def __init__(self, port: int) -> None:
        """Open a port towards the link."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._socket.connect(("127.0.0.1", port))
        self._sender = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def pack(self, message: Any) -> bytes:
        """Return a message as a frame of this station."""
        return bytes(message.pack(self._sender))

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.send(frame)

    def listen(self, seconds: float) -> Iterator[Heard]:
        """Yield what comes until nothing has come for so long."""
        while select.select([self._socket], [], [], seconds)[0]:
            yield from walk(self._socket.recv(_READ_BYTES))

    def ask(self, frame: bytes, answers: Callable[[Heard], bool]) -> Heard | None:
        """Send a frame, again when it is not answered; return the answer, None in vain."""
        for _ in range(RETRIES):
            self.send(frame)
            end_s = time.monotonic() + RETRY_S
            while (left_s := end_s - time.monotonic()) > 0.0:
                if not select.select([self._socket], [], [], left_s)[0]:
                    break
                for heard in walk(self._socket.recv(_READ_BYTES)):
                    if answers(heard):
                        return heard
        return None


def walk(data: bytes) -> Iterator[Heard]:
    """Yield the MAVLink 2 messages of a datagram from a sender that is trusted: no checksum is looked at."""
    place = 0
    while place + _HEADER <= len(data) and data[place] == _MARKER:
        size = data[place + 1]
        number = int.from_bytes(data[place + 7 : place + 10], "little")
        start = place + _HEADER
        yield Heard(number, data[start : start + size].ljust(_LONGEST_PAYLOAD, b"\0"))
        place = start + size + _CHECKSUM + (_SIGNATURE if data[place + 2] & 1 else 0)
