"""MAVLink over a serial line, such as a radio modem's."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_py.common.interfaces import ByteLine
from firmware_py.link.wire.transport import RADIO_BAUD, Address
from firmware_py.link.wire.url_options import PLAIN, LinkOptions

_BITS_PER_BYTE = 10  # start bit, eight bits, stop bit
_FAR_END: Address = "line"


class SerialTransport:
    """One serial line with one correspondent at its far end; the line may vanish and come back."""

    datagrams = False
    exposed = False

    def __init__(self, name: str, line: ByteLine, baud: int, options: LinkOptions = PLAIN) -> None:
        """Take an opened line and its speed."""
        self.name = name
        self.options = options
        self.byte_rate: float | None = baud / _BITS_PER_BYTE
        self.radio = options.at_radio_rates(usual=baud <= RADIO_BAUD)
        self._line = line

    def descriptors(self) -> Sequence[int]:
        """Return the line's descriptor while it is there."""
        descriptor = self._line.fileno()
        return () if descriptor < 0 else (descriptor,)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - it has one only
        """Read what is there, at most the 4096 bytes of a ByteLine."""
        data = self._line.read()
        return ((_FAR_END, data),) if data else ()

    def send(self, address: Address, data: bytes) -> bool:  # noqa: ARG002 - it has one only
        """Hand data to the line, all or nothing."""
        return self._line.write(data)

    @property
    def blocked_reason(self) -> str:
        """Say when the line has vanished."""
        return "" if self._line.fileno() >= 0 else "the line is not there"

    def addresses(self) -> Sequence[Address]:
        """Return the far end: whether anybody is there, a line cannot tell."""
        return (_FAR_END,)

    def guests(self) -> Sequence[Address]:
        """Return nobody: nobody connects to a line."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the far end itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the far end is there for good."""

    def poll(self, now_s: float) -> None:
        """Do nothing: the line opens itself again."""

    def close(self) -> None:
        """Do nothing: the line belongs to whoever opened it."""
