"""Byte lines on the boat's network: UDP datagrams, and a TCP server such as a multiplexer. They are read-only."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

from firmware_py.system.serial_port import MAX_READ_BYTES, REOPEN_INTERVAL_S, PortError

MAX_DATAGRAM_BYTES = 2048
MAX_DATAGRAMS = 64  # per read; the kernel drops what exceeds its buffer
DEFAULT_HOST = "127.0.0.1"
_SILENT_S, _PROBE_EVERY_S, _PROBES, _SYN_RETRIES = 10, 5, 3, 3  # the connection times out after 25 s


class NetworkLine:
    """The common part of both lines; `open` creates the socket or raises PortError with the remedy."""

    form = ""  # the expected form of the name

    def __init__(self, name: str) -> None:
        """Store the address; `open` or `reopen` opens the socket."""
        self.name = name
        self.openings = 0
        self.baud = 0  # not applicable
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
        """Return host (empty if not given) and port."""
        host, _, port = self.name.partition(":")[2].rpartition(":")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and 0 < int(port) <= 65535):
            raise PortError(f"port {self.name}: write {self.form}")
        return host, int(port)

    def open(self) -> None:
        """Open the socket."""
        raise NotImplementedError

    def reopen(self, now_s: float) -> str:
        """Try once a second to open a missing socket; the report is always empty."""
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
    """A UDP socket as a line, `udp:[HOST:]PORT`; without a host, only from this computer."""

    form = "udp:PORT or udp:HOST:PORT, with the address to listen at"

    def open(self) -> None:
        """Bind the socket, or raise PortError with the remedy."""
        host, port = self.address()
        listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            listener.bind((host or DEFAULT_HOST, port))
        except (OSError, UnicodeError) as error:
            listener.close()
            number = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(number).lower() if number and number > 0 else "no such address"
            raise PortError(f"port {self.name}: {reason}; choose another, 0.0.0.0 for any of this computer") from None
        self._socket = listener
        self.openings += 1

    def read(self) -> bytes:
        """Return the pending datagrams up to about 4096 bytes; each is a line."""
        pieces: list[bytes] = []
        count = 0
        for _ in range(MAX_DATAGRAMS if self._socket is not None else 0):
            try:
                pieces.append(self._socket.recv(MAX_DATAGRAM_BYTES) + b"\n")  # type: ignore[union-attr]
            except OSError:
                break
            count += len(pieces[-1])
            if count >= MAX_READ_BYTES:
                break
        return b"".join(pieces)


class TcpLine(NetworkLine):
    """A connection to a TCP server as a line, `tcp:ADDRESS:PORT`; a failed connection is retried each second."""

    form = "tcp:ADDRESS:PORT of the server, with a numeric address, as in tcp:192.0.2.7:10110"

    def open(self) -> None:
        """Start to connect without waiting; raises PortError for an invalid address."""
        host, port = self.address()
        try:
            socket.inet_pton(socket.AF_INET, host)  # the lookup of a name would block
        except (OSError, ValueError):
            raise PortError(f"port {self.name}: write {self.form}") from None
        client = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _SILENT_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _PROBE_EVERY_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_SYNCNT, _SYN_RETRIES)
        client.connect_ex((host, port))  # the next read reports an error
        self._socket = client
        self.openings += 1

    def read(self) -> bytes:
        """Return the pending bytes; an ended connection is closed, and `reopen` connects again."""
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
