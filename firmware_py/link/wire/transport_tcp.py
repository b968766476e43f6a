"""MAVLink over TCP: a server for several ground stations, and a client that reconnects."""

from __future__ import annotations

import errno
import math
import socket
from collections.abc import Sequence

from firmware_py.link.wire.transport import MAX_READ_BYTES, Address
from firmware_py.link.wire.transport_udp import bind, is_exposed
from firmware_py.link.wire.urls import HostLookup, LinkUrl, resolve

MAX_CLIENTS = 25  # active and pending peers of a link and one new peer; the link evicts peers
RECONNECT_S = 1.0
_LOOKUP_INTERVAL_S = 10.0  # of a server that does not accept the connection
_MAX_UNSENT_BYTES = 1 << 12  # in the send buffer of the system; newer data is sent after them
_RECEIVE_BUFFER_BYTES = 1 << 15  # small, so that no old data remains to be read after a flood
_ACKNOWLEDGE_TIMEOUT_MS = 60_000  # the system closes a connection without acknowledgement for this long
_KEEPALIVE_DELAY_S = 20  # time without data before the first keep-alive probe
_KEEPALIVE_INTERVAL_S = 10
_CONNECTING_ERRORS = (errno.EINPROGRESS, errno.EALREADY)


def _new_socket() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    # Set before the socket listens, so that the sockets of the clients inherit it.
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
    _set_options(opened)
    return opened


def _set_options(opened: socket.socket) -> None:
    opened.setblocking(False)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, True)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _MAX_UNSENT_BYTES)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, True)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _KEEPALIVE_DELAY_S)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _KEEPALIVE_INTERVAL_S)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _ACKNOWLEDGE_TIMEOUT_MS)


class _Connection:
    """Connected socket with its unsent data."""

    __slots__ = ("_socket", "_unsent", "host", "is_open")

    def __init__(self, connected: socket.socket, host: str) -> None:
        self._socket = connected
        self.host = host
        self._unsent = b""
        self.is_open = True

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        """Return received data; close the connection at its end or after an error."""
        try:
            data = self._socket.recv(MAX_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def write(self, data: bytes) -> bool:
        """Send or buffer `data`; return False if the connection is closed or has unsent data."""
        self.flush()
        if not self.is_open or self._unsent:
            return False
        self._unsent = data
        self.flush()
        return True

    def flush(self) -> None:
        """Send as much of the unsent data as the system accepts."""
        if not self._unsent:
            return
        try:
            self._unsent = self._unsent[self._socket.send(self._unsent) :]
        except BlockingIOError:
            return
        except OSError:
            self.close()

    def close(self) -> None:
        self.is_open = False
        self._unsent = b""
        self._socket.close()


class TcpServer:
    """TCP server; each client is a peer."""

    byte_rate: float | None = None
    is_datagram = False
    blocked_reason = ""

    def __init__(self, url: LinkUrl) -> None:
        """Listen on the port; raise LinkError if that fails."""
        self.name = url.text
        self.options = url.options
        self.has_radio_rates = url.options.uses_radio_rates(default=False)
        self._listener = _new_socket()
        # Without it, the port is in use for a minute after a restart.
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, True)
        bind(self._listener, url)
        self.is_exposed = is_exposed(self._listener)
        self._listener.listen(MAX_CLIENTS)
        self._clients: dict[int, _Connection] = {}  # by a number that is not reused
        self._next_number = 0

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors of the listener and of the clients."""
        return (self._listener.fileno(), *(client.fileno() for client in self._clients.values() if client.is_open))

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Accept one client, or read from one."""
        if descriptor == self._listener.fileno():
            self._accept()
        for number, client in self._clients.items():
            if client.fileno() == descriptor:
                data = client.read()
                return ((number, data),) if data else ()
        return ()

    def send(self, address: Address, data: bytes) -> bool:
        """Send data to a client; return False if it is disconnected or has unsent data."""
        client = self._clients.get(address) if isinstance(address, int) else None
        return client is not None and client.write(data)

    def addresses(self) -> Sequence[Address]:
        """Return no peers: clients connect by themselves."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the IP address of a client."""
        client = self._clients.get(address) if isinstance(address, int) else None
        return None if client is None else client.host

    def drop(self, address: Address) -> None:
        """Close the connection of a client."""
        if isinstance(address, int) and (client := self._clients.pop(address, None)) is not None:
            client.close()

    def connections(self) -> Sequence[Address]:
        """Return the connected clients."""
        return tuple(number for number, client in self._clients.items() if client.is_open)

    def poll(self, now_s: float) -> None:  # noqa: ARG002 - nothing here depends on time
        """Send buffered data and remove closed connections."""
        for client in self._clients.values():
            client.flush()
        self._clients = {number: client for number, client in self._clients.items() if client.is_open}

    def close(self) -> None:
        """Close the port and all connections."""
        for client in self._clients.values():
            client.close()
        self._listener.close()

    def _accept(self) -> None:
        try:
            accepted, address = self._listener.accept()
        except OSError:
            return
        if len(self.connections()) >= MAX_CLIENTS:
            accepted.close()
            return
        try:
            _set_options(accepted)
        except OSError:
            accepted.close()
            return
        self._clients[self._next_number] = _Connection(accepted, str(address[0]))
        self._next_number += 1


class TcpClient:
    """TCP client. It reconnects RECONNECT_S after a loss, to the present address of the host name."""

    byte_rate: float | None = None
    is_datagram = False
    blocked_reason = ""
    is_exposed = False

    def __init__(self, url: LinkUrl) -> None:
        """Look up the server; raise LinkError if its name is not known. The server may start later."""
        self.name = url.text
        self.options = url.options
        self.has_radio_rates = url.options.uses_radio_rates(default=False)
        self._server = resolve(url)
        self._lookup = HostLookup(url, _LOOKUP_INTERVAL_S)
        self._connecting: socket.socket | None = None
        self._connection: _Connection | None = None
        self._connection_number = 0  # the address of the server as a peer
        self._next_attempt_s = -math.inf

    def descriptors(self) -> Sequence[int]:
        """Return the descriptor of the open connection, if there is one."""
        return () if self._connection is None or not self._connection.is_open else (self._connection.fileno(),)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - there is only one
        """Read from the server."""
        data = b"" if self._connection is None else self._connection.read()
        return ((self._connection_number, data),) if data else ()

    def send(self, address: Address, data: bytes) -> bool:
        """Send data to the server; return False if it is disconnected or has unsent data."""
        return self._connection is not None and address == self._connection_number and self._connection.write(data)

    def addresses(self) -> Sequence[Address]:
        """Return the server while it is connected."""
        return (self._connection_number,) if self._connection is not None and self._connection.is_open else ()

    def connections(self) -> Sequence[Address]:
        """Return no peers: there are no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the address itself: there is only one server."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the server is permanent."""

    def poll(self, now_s: float) -> None:
        """Send buffered data; without a connection, try to connect once per RECONNECT_S."""
        if self._connection is not None:
            self._connection.flush()
            if self._connection.is_open:
                return
            self._connection = None
        if now_s < self._next_attempt_s and self._connecting is None:
            return
        self._connect(now_s)

    def close(self) -> None:
        """Close the connection."""
        self._lookup.close()
        if self._connecting is not None:
            self._connecting.close()
        if self._connection is not None:
            self._connection.close()
        self._connecting = self._connection = None

    def _connect(self, now_s: float) -> None:
        if self._connecting is None:
            self._server = self._next_server()
            self._connecting = _new_socket()
            self._next_attempt_s = now_s + RECONNECT_S
        error_number = self._connecting.connect_ex(self._server)
        if error_number in (0, errno.EISCONN):
            self._connection = _Connection(self._connecting, self._server[0])
            self._connecting = None
            self._connection_number += 1
        elif error_number not in _CONNECTING_ERRORS:
            self._connecting.close()
            self._connecting = None
            self._lookup.start(now_s)

    def _next_server(self) -> tuple[str, int]:
        """Return the address of the host name that follows the present one, in rotation, and the port."""
        present, port = self._server
        addresses = self._lookup.addresses or (present,)
        # The position of an address that is no longer there is -1, so that the first one follows.
        position = addresses.index(present) if present in addresses else -1
        return addresses[(position + 1) % len(addresses)], port
