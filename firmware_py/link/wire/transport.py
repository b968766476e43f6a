"""Interface of transports."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

from firmware_py.common.link_status import SatelliteStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.wire.urls import LinkClass, LinkOptions

Address: TypeAlias = Hashable  # one peer on a transport

RADIO_BAUD = 115_200  # a serial line no faster than this is taken for a radio modem
READ_BYTES = 256  # one read of a stream: the rest stays in the system's buffer, and the descriptor readable


class Transport(Protocol):
    """Carries bytes to and from one or more peers; never blocks, never raises."""

    @property
    def name(self) -> str:
        """The URL, for messages."""

    @property
    def options(self) -> LinkOptions:
        """The options of the URL."""

    @property
    def byte_rate(self) -> float | None:
        """Maximum rate of a line in bytes a second; None for a network."""

    @property
    def radio(self) -> bool:
        """Whether telemetry is sent at the lower rates."""

    @property
    def datagrams(self) -> bool:
        """Whether data comes without a connection, from any address."""

    def descriptors(self) -> Sequence[int]:
        """The descriptors that `receive` reads."""

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read a bounded piece from a descriptor."""

    def send(self, address: Address, data: bytes) -> bool:
        """Take all of data, or none of it (False)."""

    @property
    def exposed(self) -> bool:
        """Whether other computers can send here unasked."""

    @property
    def blocked_reason(self) -> str:
        """Why sending is blocked; empty if it is not."""

    def addresses(self) -> Sequence[Address]:
        """The permanent peers, which are served before they send."""

    def connections(self) -> Sequence[Address]:
        """The peers with an open incoming connection."""

    def host(self, address: Address) -> Hashable:
        """The computer of a peer."""

    def drop(self, address: Address) -> None:
        """Close a connection."""

    def poll(self, now_s: float) -> None:
        """Do periodic work: reconnect, send buffered data."""

    def close(self) -> None:
        """Close all descriptors."""


def usual_class(transport: Transport) -> LinkClass:
    """Return the class of a transport: that of its URL, otherwise by its kind."""
    return transport.options.link_class or (LinkClass.RADIO if transport.radio else LinkClass.FAST)


@runtime_checkable
class Satellite(Protocol):
    """Further interface of a transport with paid messages."""

    def attach(
        self,
        parameters: Callable[[], ParameterSet],
        code: Callable[[bytes], bytes | None],
        vouch: Callable[[bytes], None],
    ) -> None:
        """Take the parameters in force, the HMAC by the boat's key, and the function that marks a frame as signed."""

    def satellite_status(self, now_s: float) -> SatelliteStatus:
        """Status of modem, sessions and budget."""


class MessageTransport(Transport, Satellite, Protocol):
    """A transport that carries messages."""
