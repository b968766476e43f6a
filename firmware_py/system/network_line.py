"""Read-only byte lines on the boat's network: UDP datagrams, or a TCP server such as an NMEA multiplexer."""

from __future__ import annotations

import os
import socket
from abc import ABC, abstractmethod
from contextlib import suppress

from firmware_py.system.serial_port import MAX_READ_BYTES, REOPEN_INTERVAL_S, PortError

MAX_DATAGRAM_BYTES = 2048
MAX_DATAGRAMS = 64  # per read
DEFAULT_HOST = "127.0.0.1"
_KEEPALIVE_IDLE_S, _KEEPALIVE_INTERVAL_S, _KEEPALIVE_PROBES, _SYN_RETRIES = 10, 5, 3, 3  # times out after 25 s


class NetworkLine(ABC):
    """Base class of the lines; `open` creates the socket or raises PortError with the remedy."""

    name_format = ""  # described in errors

    def __init__(self, name: str) -> None:
        """Store the address; `open` or `reopen` opens the socket."""
        self.name = name
        self.openings = 0
        self.baud = 0  # a network line has none
        self.written = 0
        self._socket: socket.socket | None = None
        self._retry_s = 0.0

    @property
    def connected(self) -> bool:
        """Whether the socket is open."""
        return self._socket is not None

    def fileno(self) -> int:
        """Return the descriptor, or -1 without a socket."""
        return -1 if self._socket is None else self._socket.fileno()

    def address(self) -> tuple[str, int]:
        """Return host and port from the name; the host is empty if the name has none. Raises PortError."""
        host, _, port = self.name.partition(":")[2].rpartition(":")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and 0 < int(port) <= 65535):
            raise PortError(f"port {self.name}: write {self.name_format}")
        return host, int(port)

    @abstractmethod
    def open(self) -> None:
        """Open the socket."""

    @abstractmethod
    def read(self) -> bytes:
        """Return the pending bytes, at most about MAX_READ_BYTES; close a line that has failed."""

    def reopen(self, now_s: float) -> str:
        """Try to open a missing socket, at most once a second; return an empty report."""
        if self._socket is None and now_s >= self._retry_s:
            self._retry_s = now_s + REOPEN_INTERVAL_S
            with suppress(PortError):
                self.open()
        return ""

    def write(self, data: bytes) -> bool:  # noqa: ARG002 - part of ByteLine
        """Return False: network lines are read-only."""
        return False

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class UdpLine(NetworkLine):
    """A UDP socket as a line, `udp:[HOST:]PORT`; without a host it receives only from this computer."""

    name_format = "udp:PORT or udp:HOST:PORT, with the address to listen at"

    def open(self) -> None:
        """Bind the socket; raises PortError with the remedy."""
        host, port = self.address()
        listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            listener.bind((host or DEFAULT_HOST, port))
        except (OSError, UnicodeError) as error:
            listener.close()
            code = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(code).lower() if code and code > 0 else "no such address"
            raise PortError(f"port {self.name}: {reason}; choose another, 0.0.0.0 for any of this computer") from None
        self._socket = listener
        self.openings += 1

    def read(self) -> bytes:
        """Return the pending datagrams, up to about MAX_READ_BYTES, each followed by a line feed."""
        datagrams: list[bytes] = []
        total_bytes = 0
        for _ in range(MAX_DATAGRAMS if self._socket is not None else 0):
            try:
                datagrams.append(self._socket.recv(MAX_DATAGRAM_BYTES) + b"\n")  # type: ignore[union-attr]
            except OSError:
                break
            total_bytes += len(datagrams[-1])
            if total_bytes >= MAX_READ_BYTES:
                break
        return b"".join(datagrams)


class TcpLine(NetworkLine):
    """A connection to a TCP server as a line, `tcp:ADDRESS:PORT`; a failed connection is retried each second."""

    name_format = "tcp:ADDRESS:PORT of the server, with a numeric address, as in tcp:192.0.2.7:10110"

    def open(self) -> None:
        """Start to connect without waiting; raises PortError for an invalid address. `read` notices a failure."""
        host, port = self.address()
        try:
            socket.inet_pton(socket.AF_INET, host)  # the lookup of a name would block
        except (OSError, ValueError):
            raise PortError(f"port {self.name}: write {self.name_format}") from None
        client = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _KEEPALIVE_IDLE_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _KEEPALIVE_INTERVAL_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _KEEPALIVE_PROBES)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_SYNCNT, _SYN_RETRIES)
        client.connect_ex((host, port))  # the next read notices an error
        self._socket = client
        self.openings += 1

    def read(self) -> bytes:
        """Return the pending bytes; close an ended connection, which `reopen` opens again."""
        if self._socket is None:
            return b""
        try:
            if data := self._socket.recv(MAX_READ_BYTES):
                return data
        except BlockingIOError:
            return b""
        except OSError:
            pass
        self.close()
        return b""
