"""A network link to an autopilot on another computer."""

from __future__ import annotations

import contextlib
import socket

DEFAULT_PORT = 5760
CONNECT_TIMEOUT_S = 10.0
_READ_SIZE = 65_536
PROTOCOLS = ("tcp", "udpout", "udpin")


class NetworkLineError(OSError):
    """The link cannot be opened; the text contains its URL and the reason."""


class NetworkLine:
    """A TCP or UDP link with the interface of a PtyLine, for the ground station.

    `tcp:HOST:PORT` and `udpout:HOST:PORT` connect to the autopilot; `udpin:HOST:PORT` waits for it and sends to the
    last sender. `HOST` stands for tcp:HOST:5760.
    """

    def __init__(self, url: str) -> None:
        """Open the link; raise NetworkLineError if that fails."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        kind, host, port = _parse_url(url)
        self._peer: tuple[str, int] | None = (host, port) if kind == "udpout" else None
        self._is_udp = kind != "tcp"
        try:
            if kind == "tcp":
                self._socket = socket.create_connection((host, port), CONNECT_TIMEOUT_S)
            else:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.bind((host, port) if kind == "udpin" else ("", 0))
        except OSError as error:
            raise NetworkLineError(f"{url}: {error.strerror or error}") from None
        self._socket.setblocking(False)

    @property
    def is_plugged(self) -> bool:
        """True while the link is open."""
        return self._socket.fileno() >= 0

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1 when the link is closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the link."""
        self._socket.close()

    def read(self) -> bytes:
        """Return the received bytes, without waiting."""
        data = b""
        try:
            if self._is_udp:
                data, sender = self._socket.recvfrom(_READ_SIZE)
                self._peer = (sender[0], sender[1])
            elif not (data := self._socket.recv(_READ_SIZE)):
                self.close()
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            # A refused datagram means that the peer is not up yet; a failed stream is closed.
            if not self._is_udp:
                self.close()
        self.total_read += len(data)
        return data

    def write(self, data: bytes) -> int:
        """Send bytes and return the number sent."""
        sent = 0
        with contextlib.suppress(OSError):
            if not self._is_udp:
                sent = self._socket.send(data)
            elif self._peer is not None:
                sent = self._socket.sendto(data, self._peer)
        self.total_written += sent
        self.overrun_bytes += len(data) - sent
        return sent


def _parse_url(url: str) -> tuple[str, str, int]:
    """Return protocol, host and port; raise NetworkLineError for an invalid URL."""
    kind, *rest = url.split(":")
    if kind not in PROTOCOLS:
        kind, rest = "tcp", [kind, *rest]
    host, port = [*rest, str(DEFAULT_PORT)][:2]
    if not host or len(rest) > 2 or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise NetworkLineError(f"{url}: write HOST, or tcp:HOST:PORT, udpout:HOST:PORT, udpin:HOST:PORT")
    return kind, host, int(port)
