"""MAVLink over TCP: a server for several ground stations, or a client that reconnects."""

from __future__ import annotations

import errno
import socket
from collections.abc import Sequence

from firmware_py.link.wire.transport import READ_BYTES, Address
from firmware_py.link.wire.transport_udp import bind, exposed
from firmware_py.link.wire.urls import HostLookup, LinkUrl, resolve

# Connections at once: active and pending peers of a link, and one new. The link evicts peers.
MAX_CLIENTS = 25
RECONNECT_S = 1.0
_LOOK_S = 10.0  # between two lookups of a server that does not answer
_UNSENT_BYTES = 1 << 12  # in the system's send buffer: newer data would wait behind them
_UNREAD_BYTES = 1 << 15  # in the system's receive buffer, so that a flood is over soon after its end
_DEAD_MS = 60_000  # a connection without acknowledgement for this long is closed
_PROBE_AFTER_S = 20  # keep-alive of an idle connection
_PROBE_EVERY_S = 10
_PENDING = (errno.EINPROGRESS, errno.EALREADY)


def _new_socket() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _UNREAD_BYTES)  # before listening: clients inherit it
    _tune(opened)
    return opened


def _tune(opened: socket.socket) -> None:
    opened.setblocking(False)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _PROBE_AFTER_S)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _PROBE_EVERY_S)
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_MS)


class _Connection:
    """One connected socket and its unsent data."""

    __slots__ = ("_held", "_socket", "host", "open")

    def __init__(self, connected: socket.socket, host: str) -> None:
        self._socket = connected
        self.host = host
        self._held = b""
        self.open = True

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def write(self, data: bytes) -> bool:
        self.push()
        if not self.open or self._held:
            return False
        self._held = data
        self.push()
        return True

    def push(self) -> None:
        """Send buffered data, as far as the system takes it."""
        if not self._held or not self.open:
            return
        try:
            self._held = self._held[self._socket.send(self._held) :]
        except BlockingIOError:
            return
        except OSError:
            self.close()

    def close(self) -> None:
        self.open = False
        self._held = b""
        self._socket.close()


class TcpServer:
    """A server; every client is a peer."""

    byte_rate: float | None = None
    datagrams = False
    blocked_reason = ""

    def __init__(self, url: LinkUrl) -> None:
        """Open the port, or raise LinkError."""
        self.name = url.text
        self.options = url.options
        self.radio = url.options.at_radio_rates(usual=False)
        self._listener = _new_socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # else a restart waits a minute
        bind(self._listener, url)
        self.exposed = exposed(self._listener)
        self._listener.listen(MAX_CLIENTS)
        self._clients: dict[int, _Connection] = {}  # by a number that is never used again
        self._next = 0

    def descriptors(self) -> Sequence[int]:
        """Return the listener's and the clients' descriptors."""
        return (self._listener.fileno(), *(client.fileno() for client in self._clients.values() if client.open))

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Accept one client, or read from one."""
        if descriptor == self._listener.fileno():
            self._accept()
            return ()
        for number, client in self._clients.items():
            if client.open and client.fileno() == descriptor:
                data = client.read()
                return ((number, data),) if data else ()
        return ()

    def send(self, address: Address, data: bytes) -> bool:
        """Hand data to a client; False when it is gone or takes no more."""
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
        """End the connection of a client."""
        if isinstance(address, int) and (client := self._clients.pop(address, None)) is not None:
            client.close()

    def connections(self) -> Sequence[Address]:
        """Return the connected clients."""
        return tuple(number for number, client in self._clients.items() if client.open)

    def poll(self, now_s: float) -> None:  # noqa: ARG002 - nothing here depends on time
        """Send buffered data and remove closed clients."""
        for client in self._clients.values():
            client.push()
        self._clients = {number: client for number, client in self._clients.items() if client.open}

    def close(self) -> None:
        """Close the port and all connections."""
        for client in self._clients.values():
            client.close()
        self._clients = {}
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
            _tune(accepted)
        except OSError:
            accepted.close()
            return
        self._clients[self._next] = _Connection(accepted, str(address[0]))
        self._next += 1


class TcpClient:
    """Connects to a server, and again RECONNECT_S after a loss, at the address that its name has then."""

    byte_rate: float | None = None
    datagrams = False
    blocked_reason = ""
    exposed = False

    def __init__(self, url: LinkUrl) -> None:
        """Look up the server, or raise LinkError; it need not be running yet."""
        self.name = url.text
        self.options = url.options
        self.radio = url.options.at_radio_rates(usual=False)
        self._server = resolve(url)
        self._lookup = HostLookup(url, _LOOK_S)
        self._connecting: socket.socket | None = None
        self._connection: _Connection | None = None
        self._number = 0
        self._next_s: float | None = None

    def descriptors(self) -> Sequence[int]:
        """Return the connection's descriptor, if there is one."""
        return () if self._connection is None or not self._connection.open else (self._connection.fileno(),)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - it has one only
        """Read from the server."""
        data = self._connection.read() if self._connection is not None and self._connection.open else b""
        return ((self._number, data),) if data else ()

    def send(self, address: Address, data: bytes) -> bool:
        """Hand data to the connection; False when it is gone or takes no more."""
        return self._connection is not None and address == self._number and self._connection.write(data)

    def addresses(self) -> Sequence[Address]:
        """Return the server while it is connected."""
        return (self._number,) if self._connection is not None and self._connection.open else ()

    def connections(self) -> Sequence[Address]:
        """Return no peers: there are no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the connection itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the server is permanent."""

    def poll(self, now_s: float) -> None:
        """Send buffered data; connect when it is time."""
        if self._connection is not None:
            self._connection.push()
            if self._connection.open:
                return
            self._connection = None
        if self._next_s is not None and now_s < self._next_s and self._connecting is None:
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
            self._server = self._next_address(), self._server[1]
            self._connecting = _new_socket()
            self._next_s = now_s + RECONNECT_S
        failure = self._connecting.connect_ex(self._server)
        if failure in (0, errno.EISCONN):
            self._connection = _Connection(self._connecting, self._server[0])
            self._connecting = None
            self._number += 1
        elif failure not in _PENDING:
            self._connecting.close()
            self._connecting = None
            self._lookup.ask(now_s)

    def _next_address(self) -> str:
        """Return the next address of the name."""
        found = self._lookup.found or (self._server[0],)
        return found[(found.index(self._server[0]) + 1) % len(found)] if self._server[0] in found else found[0]
