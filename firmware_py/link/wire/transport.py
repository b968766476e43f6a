"""What a link needs of a transport, and the URLs that name one."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

from firmware_py.common.link_status import SatelliteStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.wire.urls import LinkClass, LinkOptions

Address: TypeAlias = Hashable  # one correspondent on a transport

RADIO_BAUD = 115_200  # a serial line no faster than this is taken for a radio modem
READ_BYTES = 256  # one read of a stream: the rest stays with the system, and the descriptor readable


class Transport(Protocol):
    """Carries bytes to and from one or more correspondents; never blocks, never raises."""

    @property
    def name(self) -> str:
        """The URL, for messages."""

    @property
    def options(self) -> LinkOptions:
        """What the URL says behind its question mark."""

    @property
    def byte_rate(self) -> float | None:
        """What the line carries at most, in bytes a second; None where that is no concern."""

    @property
    def radio(self) -> bool:
        """Whether telemetry goes out at the lower rates."""

    @property
    def datagrams(self) -> bool:
        """Whether anybody may send here, without a connection."""

    def descriptors(self) -> Sequence[int]:
        """The descriptors whose readability `receive` wants."""

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read a bounded piece of what has arrived on a descriptor."""

    def send(self, address: Address, data: bytes) -> bool:
        """Take all of data, or none of it (False)."""

    @property
    def exposed(self) -> bool:
        """Whether somebody on another computer can begin to speak here."""

    @property
    def blocked_reason(self) -> str:
        """Why nothing leaves now; empty for nothing."""

    def addresses(self) -> Sequence[Address]:
        """The correspondents that are to be served whether they have spoken or not."""

    def connections(self) -> Sequence[Address]:
        """Those who have connected by themselves."""

    def host(self, address: Address) -> Hashable:
        """Whose correspondent this is: the computer that it comes from."""

    def drop(self, address: Address) -> None:
        """End the connection of a guest."""

    def poll(self, now_s: float) -> None:
        """Connect again, push out what is held: whatever has to be done now and then."""

    def close(self) -> None:
        """Give up all descriptors."""


def usual_class(transport: Transport) -> LinkClass:
    """Return the class of a transport's rates: what its URL says, else what it is."""
    return transport.options.link_class or (LinkClass.RADIO if transport.radio else LinkClass.FAST)


@runtime_checkable
class Satellite(Protocol):
    """What a transport has beside that, if it carries messages that are paid for."""

    def attach(
        self,
        parameters: Callable[[], ParameterSet],
        code: Callable[[bytes], bytes | None],
        vouch: Callable[[bytes], None],
    ) -> None:
        """Take the parameters in force, what makes a code with the boat's key, and what lets a frame pass as signed."""

    def satellite_status(self, now_s: float) -> SatelliteStatus:
        """How modem, sessions and budget fare."""


class MessageTransport(Transport, Satellite, Protocol):
    """A transport that carries messages."""
