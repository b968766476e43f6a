"""Lines of bytes from a boat's network: datagrams, and a TCP server such as a multiplexer. They are only read."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

from firmware_py.system.serial_port import READ_LIMIT, REOPEN_INTERVAL_S, PortError

LONGEST_DATAGRAM = 2048
MOST_DATAGRAMS = 64  # read at once; the kernel drops what is more than its buffer holds
DEFAULT_HOST = "127.0.0.1"
_SILENT_S, _PROBE_EVERY_S, _PROBES, _SYN_RETRIES = 10, 5, 3, 3  # a server that does not answer is gone after 25 s


class NetworkLine:
    """What both lines share; `open` makes the socket and raises PortError with the remedy."""

    form = ""  # of the name

    def __init__(self, name: str) -> None:
        """Remember the address; `open` or `reopen` opens the socket."""
        self.name = name
        self.openings = 0
        self.baud = 0  # a network has none
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

    def address(self) -> tuple[str, int]:
        """Return host (empty where none is named) and port of the name."""
        host, _, port = self.name.partition(":")[2].rpartition(":")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and 0 < int(port) <= 65535):
            raise PortError(f"port {self.name}: write {self.form}")
        return host, int(port)

    def open(self) -> None:
        """Open the socket."""
        raise NotImplementedError

    def reopen(self, now_s: float) -> str:
        """Try once a second to open a socket that is not there; there is nothing to report."""
        if self._socket is None and now_s >= self._retry_s:
            self._retry_s = now_s + REOPEN_INTERVAL_S
            with suppress(PortError):
                self.open()
        return ""

    def write(self, data: bytes) -> bool:  # noqa: ARG002 - a line like the others
        """Send nothing: devices on a network are only heard."""
        return False

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class UdpLine(NetworkLine):
    """A UDP socket as a line, by `udp:[HOST:]PORT`; without a host, from this computer."""

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


class TcpLine(NetworkLine):
    """A connection to a TCP server as a line, by `tcp:ADDRESS:PORT`; a server that is away is tried each second."""

    form = "tcp:ADDRESS:PORT of the server, with a numeric address, as in tcp:192.0.2.7:10110"

    def open(self) -> None:
        """Begin to connect, which nothing waits for; PortError for what is no address."""
        host, port = self.address()
        try:
            socket.inet_pton(socket.AF_INET, host)  # a name would have to be looked up, which takes time
        except (OSError, ValueError):
            raise PortError(f"port {self.name}: write {self.form}") from None
        client = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _SILENT_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _PROBE_EVERY_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, _PROBES)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_SYNCNT, _SYN_RETRIES)
        client.connect_ex((host, port))  # an error shows when it is read
        self._socket = client
        self.openings += 1

    def read(self) -> bytes:
        """The bytes that are there; a connection that has ended is closed, and `reopen` connects again."""
        if self._socket is None:
            return b""
        try:
            if data := self._socket.recv(READ_LIMIT):
                return data
        except BlockingIOError:
            return b""
        except OSError:
            pass
        self.close()
        return b""
