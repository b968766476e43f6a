"""MAVLink over UDP: to one ground station (udpout), or to any that sends first (udpin)."""

from __future__ import annotations

import errno
import ipaddress
import math
import os
import socket
from collections.abc import Sequence

from firmware_py.link.wire.transport import Address
from firmware_py.link.wire.urls import HostLookup, LinkError, LinkUrl, resolve

_DATAGRAMS = 48  # in one call, which keeps up with a flood, most of which is dropped unread
_LONGEST = 2048  # bytes of a datagram
_SEND_BUFFER = 1 << 18
# Linux constants that Python lacks. By default datagrams must not be fragmented: on a path with a smaller MTU and
# without ICMP every longer one would be lost.
_IP_MTU_DISCOVER, _IP_PMTUDISC_DONT = 10, 0
OF_MANY_ANYWHERE = ("0.0.0.0", "255.255.255.255")  # noqa: S104 - never the address of one station
_LOOK_S = 60.0  # of silence before the target is looked up again


def exposed(listener: socket.socket) -> bool:
    """Return whether a bound socket is reachable from other computers."""
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


def is_of_many(address: tuple[str, int]) -> bool:
    """Return whether an address is a multicast, broadcast or unspecified one."""
    numeric = ipaddress.IPv4Address(address[0])
    if numeric.is_multicast or numeric.is_unspecified:
        return True
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(address)
        except PermissionError:
            return True  # a broadcast, which needs SO_BROADCAST
        except OSError:
            return False  # no route to it now
    return False


def _check_target(url: LinkUrl, target: tuple[str, int]) -> None:
    """Raise LinkError for a target from which no answer would be accepted."""
    if is_of_many(target):
        raise LinkError(
            f"link {url.text!r}: {target[0]} is not the address of one station, and no other would be heard; "
            f"use the station's own, or udpin:0.0.0.0:{url.number}"
        )


class UdpTransport:
    """One UDP socket.

    `udpout` sends to its target from the start and receives from the target's host only, from any port: ground stations
    often answer from another one, and each port is a peer. A host name is looked up again while the target is silent.
    `udpin` receives from any address.
    """

    byte_rate: float | None = None
    datagrams = True

    def __init__(self, url: LinkUrl, *, receives: bool = True) -> None:
        """Open the socket, or raise LinkError; `receives` False allows broadcast targets."""
        self.name = url.text
        self.options = url.options
        self.radio = url.options.at_radio_rates(usual=False)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._target: tuple[str, int] | None = None
        self._lookup: HostLookup | None = None
        self._has_received = True  # from the target since the latest lookup
        self._look_s = -math.inf
        self.exposed = False
        self.blocked_reason = ""  # why the system refused the last datagram to the target
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._socket.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _IP_PMTUDISC_DONT)
        if url.kind == "udpin":
            bind(self._socket, url)
            self.exposed = exposed(self._socket)
            return
        try:
            self._target = resolve(url)
            if receives:
                _check_target(url, self._target)
        except LinkError:
            self._socket.close()
            raise
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, not receives)
        self._lookup = HostLookup(url, _LOOK_S)

    def descriptors(self) -> Sequence[int]:
        """Return the socket's descriptor."""
        return (self._socket.fileno(),)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - it has one only
        """Read a few datagrams."""
        datagrams: list[tuple[Address, bytes]] = []
        for _ in range(_DATAGRAMS):
            try:
                data, address = self._socket.recvfrom(_LONGEST)
            except BlockingIOError:
                break
            except OSError:
                # An ICMP error of an earlier send, such as ECONNREFUSED: no program listens there now.
                continue
            if self._target is None or address[0] == self._target[0]:
                datagrams.append((address, data))
                self._has_received = True
        return datagrams

    def send(self, address: Address, data: bytes) -> bool:
        """Send one datagram; False when the system refuses it: its buffer is full, or there is no way there now."""
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
        """Look up a silent target, and use its new address."""
        if self._lookup is None or self._target is None:
            return
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_S
            if not self._has_received:
                self._lookup.ask(now_s)
            self._has_received = False
        found = self._lookup.found
        if found and self._target[0] not in found:
            self._target = found[0], self._target[1]

    def close(self) -> None:
        """Close the socket."""
        if self._lookup is not None:
            self._lookup.close()
        self._socket.close()
