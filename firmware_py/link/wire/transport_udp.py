"""MAVLink over UDP: to one ground station (udpout), or to each station that sends first (udpin)."""

from __future__ import annotations

import errno
import ipaddress
import math
import os
import socket
from collections.abc import Sequence

from firmware_py.link.wire.transport import Address
from firmware_py.link.wire.urls import HostLookup, LinkError, LinkUrl, resolve

_MAX_DATAGRAMS_PER_CALL = 48  # enough in a flood: the receive queue drops most of its datagrams
_MAX_DATAGRAM_BYTES = 2048
_SEND_BUFFER_BYTES = 1 << 18
# Linux constants that Python lacks. By default datagrams must not be fragmented: on a path with a smaller MTU and
# without ICMP every longer one would be lost.
_IP_MTU_DISCOVER, _IP_PMTUDISC_DONT = 10, 0
GROUP_ADDRESSES = ("0.0.0.0", "255.255.255.255")  # noqa: S104 - not bound, only rejected
_LOOKUP_INTERVAL_S = 60.0  # a target that is silent for this long is looked up again


def is_exposed(listener: socket.socket) -> bool:
    """Return whether other computers can reach a bound socket."""
    return not str(listener.getsockname()[0]).startswith("127.")


def bind(listener: socket.socket, url: LinkUrl) -> None:
    """Bind a socket to the address of a URL; on failure close it and raise LinkError."""
    try:
        listener.bind(resolve(url))
    except (OSError, LinkError) as error:
        listener.close()
        if isinstance(error, LinkError):
            raise
        remedy = {
            errno.EADDRINUSE: "end the program that has the port, or choose another port",
            errno.EADDRNOTAVAIL: "use 0.0.0.0 or an address of this machine",
            errno.EACCES: "use a port above 1023",
        }.get(error.errno or 0, "choose another address")
        reason = os.strerror(error.errno or 0).lower()
        raise LinkError(f"link {url.text!r}: {reason}; {remedy}") from error


def _is_group_address(address: tuple[str, int]) -> bool:
    """Return whether an address is a multicast, broadcast or unspecified address."""
    numeric = ipaddress.IPv4Address(address[0])
    if numeric.is_multicast or numeric.is_unspecified:
        return True
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(address)
        except PermissionError:
            return True  # a broadcast address, which needs SO_BROADCAST
        except OSError:
            return False  # there is no route at present
    return False


def _check_target(url: LinkUrl, target: tuple[str, int]) -> None:
    """Raise LinkError for a group address: the replies have another address and would be rejected."""
    if _is_group_address(target):
        raise LinkError(
            f"link {url.text!r}: {target[0]} is not the address of one station, so replies would be ignored; "
            f"use the address of the station, or udpin:0.0.0.0:{url.number}"
        )


class UdpTransport:
    """Transport with one UDP socket.

    `udpout` sends to its target from the start. It receives from the host of the target only, but from any port, since
    ground stations often reply from another port; each port is a peer. While the target is silent, its host name is
    looked up again. `udpin` receives from any address.
    """

    byte_rate: float | None = None
    is_datagram = True

    def __init__(self, url: LinkUrl, *, receives: bool = True) -> None:
        """Open the socket, or raise LinkError; `receives` False allows broadcast targets."""
        self.name = url.text
        self.options = url.options
        self.has_radio_rates = url.options.uses_radio_rates(default=False)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._target: tuple[str, int] | None = None
        self._lookup: HostLookup | None = None
        self._has_received = True  # since the latest lookup
        self._next_lookup_s = -math.inf
        self.is_exposed = False
        self.blocked_reason = ""  # of the last datagram to the target
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self._socket.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _IP_PMTUDISC_DONT)
        if url.kind == "udpin":
            bind(self._socket, url)
            self.is_exposed = is_exposed(self._socket)
            return
        try:
            self._target = resolve(url)
            if receives:
                _check_target(url, self._target)
        except LinkError:
            self._socket.close()
            raise
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, not receives)
        self._lookup = HostLookup(url, _LOOKUP_INTERVAL_S)

    def descriptors(self) -> Sequence[int]:
        """Return the descriptor of the socket."""
        return (self._socket.fileno(),)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - there is only one
        """Read at most 48 datagrams."""
        received: list[tuple[Address, bytes]] = []
        for _ in range(_MAX_DATAGRAMS_PER_CALL):
            try:
                data, address = self._socket.recvfrom(_MAX_DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except OSError:
                # An ICMP error of an earlier datagram, such as ECONNREFUSED: no program listens on that port.
                continue
            if self._target is None or address[0] == self._target[0]:
                received.append((address, data))
                self._has_received = True
        return received

    def send(self, address: Address, data: bytes) -> bool:
        """Send one datagram; return False if the system refuses it (full buffer, no route)."""
        try:
            self._socket.sendto(data, address)  # type: ignore[call-overload]
        except BlockingIOError:
            return False
        except OSError as error:
            if address == self._target:
                self.blocked_reason = os.strerror(error.errno or 0).lower()
            return False
        if address == self._target:
            self.blocked_reason = ""
        return True

    def addresses(self) -> Sequence[Address]:
        """Return the target of `udpout`."""
        return () if self._target is None else (self._target,)

    def connections(self) -> Sequence[Address]:
        """Return no peers: UDP has no connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the IP address of a peer."""
        return address[0] if isinstance(address, tuple) else address

    def drop(self, address: Address) -> None:
        """Do nothing: UDP has no connections."""

    def poll(self, now_s: float) -> None:
        """Look up a silent target again; change to its new address."""
        if self._lookup is None or self._target is None:
            return
        if now_s >= self._next_lookup_s:
            self._next_lookup_s = now_s + _LOOKUP_INTERVAL_S
            if not self._has_received:
                self._lookup.start(now_s)
            self._has_received = False
        addresses = self._lookup.addresses
        if addresses and self._target[0] not in addresses:
            self._target = addresses[0], self._target[1]

    def close(self) -> None:
        """Close the socket."""
        if self._lookup is not None:
            self._lookup.close()
        self._socket.close()
