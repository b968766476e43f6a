"""A line of bytes that come as datagrams, as AIS receivers and multiplexers on a boat's network send them."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

from firmware_py.system.serial_port import READ_LIMIT, REOPEN_INTERVAL_S, PortError

PREFIX = "udp:"
LONGEST_DATAGRAM = 2048
MOST_DATAGRAMS = 64  # read at once; the kernel drops what is more than its buffer holds
DEFAULT_HOST = "127.0.0.1"


class UdpLine:
    """A UDP socket as a line that is only read, by `udp:[HOST:]PORT`; without a host, from this computer."""

    def __init__(self, name: str) -> None:
        """Remember the address to listen at; `open` or `reopen` binds the socket."""
        self.name = name
        self.openings = 0
        self.baud = 0  # datagrams have none
        self.written = 0
        self._socket: socket.socket | None = None
        self._retry_s = 0.0

    @property
    def connected(self) -> bool:
        """Whether the socket is there."""
        return self._socket is not None

    def fileno(self) -> int:
        """The descriptor, or -1 while there is no socket."""
        return -1 if self._socket is None else self._socket.fileno()

    def open(self) -> None:
        """Bind the socket, or raise PortError with the remedy."""
        host, _, port = self.name.removeprefix(PREFIX).rpartition(":")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and 0 < int(port) <= 65535):
            raise PortError(f"port {self.name}: write udp:PORT or udp:HOST:PORT, with the address to listen at")
        listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            listener.bind((host or DEFAULT_HOST, int(port)))
        except (OSError, UnicodeError) as error:
            listener.close()
            number = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(number).lower() if number and number > 0 else "no such address"
            raise PortError(f"port {self.name}: {reason}; choose another, 0.0.0.0 for any of this computer") from None
        self._socket = listener
        self.openings += 1

    def reopen(self, now_s: float) -> str:
        """Try once a second to bind a socket that is not there; there is nothing to report."""
        if self._socket is None and now_s >= self._retry_s:
            self._retry_s = now_s + REOPEN_INTERVAL_S
            with suppress(PortError):
                self.open()
        return ""

    def read(self) -> bytes:
        """The datagrams that are there, until 4096 bytes or more have come; each ends a line."""
        pieces: list[bytes] = []
        count = 0
        for _ in range(MOST_DATAGRAMS if self._socket is not None else 0):
            try:
                pieces.append(self._socket.recv(LONGEST_DATAGRAM) + b"\n")  # type: ignore[union-attr]
            except OSError:
                break
            count += len(pieces[-1])
            if count >= READ_LIMIT:
                break
        return b"".join(pieces)

    def write(self, data: bytes) -> bool:  # noqa: ARG002 - a line like the others
        """Send nothing: nobody listens."""
        return False

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
