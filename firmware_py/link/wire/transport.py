"""Interface of transports, which exchange bytes with peers."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

from firmware_py.common.link_status import SatelliteStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.wire.urls import LinkClass, LinkOptions

Address: TypeAlias = Hashable  # one peer on a transport

MAX_RADIO_BAUD = 115_200  # a serial line up to this rate is treated as a radio modem
# Per read of a stream. The rest stays in the buffer of the system, and the descriptor remains readable.
MAX_READ_BYTES = 256


class Transport(Protocol):
    """Exchange of bytes with one or more peers. No method blocks or raises an exception."""

    @property
    def name(self) -> str:
        """The URL, for messages to the operator."""

    @property
    def options(self) -> LinkOptions:
        """The options of the URL."""

    @property
    def byte_rate(self) -> float | None:
        """Maximum rate of a line in bytes per second; None for a network."""

    @property
    def has_radio_rates(self) -> bool:
        """Whether telemetry is sent at the lower rates."""

    @property
    def is_datagram(self) -> bool:
        """Whether data comes without a connection, from any address."""

    def descriptors(self) -> Sequence[int]:
        """Return the file descriptors that `receive` reads."""

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read a bounded amount of data from a descriptor; return pairs of peer address and data."""

    def send(self, address: Address, data: bytes) -> bool:
        """Send or buffer all of `data`, or return False and send none of it."""

    @property
    def is_exposed(self) -> bool:
        """Whether other computers can start to send to this transport."""

    @property
    def blocked_reason(self) -> str:
        """Reason why sending is blocked; empty if it is not."""

    def addresses(self) -> Sequence[Address]:
        """Return the permanent peers, to which the boat sends first."""

    def connections(self) -> Sequence[Address]:
        """Return the peers with an open incoming connection."""

    def host(self, address: Address) -> Hashable:
        """Return an identifier of the computer of a peer, such as its IP address."""

    def drop(self, address: Address) -> None:
        """Close the connection of a peer."""

    def poll(self, now_s: float) -> None:
        """Reconnect and send buffered data; called periodically."""

    def close(self) -> None:
        """Close all descriptors."""


def link_class_of(transport: Transport) -> LinkClass:
    """Return the link class of the URL; without one, RADIO or FAST by the kind of transport."""
    return transport.options.link_class or (LinkClass.RADIO if transport.has_radio_rates else LinkClass.FAST)


@runtime_checkable
class Satellite(Protocol):
    """Additional interface of a transport with paid messages."""

    def attach(
        self,
        parameters: Callable[[], ParameterSet],
        compute_hmac: Callable[[bytes], bytes | None],
        mark_signed: Callable[[bytes], None],
    ) -> None:
        """Store three functions of the link.

        `parameters` returns the current parameters, `compute_hmac` the HMAC with the boat's key (None without a key),
        and `mark_signed` marks a received frame as signed.
        """

    def satellite_status(self, now_s: float) -> SatelliteStatus:
        """Return the status of modem, sessions and budget."""


class MessageTransport(Transport, Satellite, Protocol):
    """Transport with paid messages."""
