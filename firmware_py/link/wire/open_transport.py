"""Opening of the transport of a URL: a serial line, a satellite modem or a socket; a socket is retried if necessary."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import msgspec

from firmware_py.common.interfaces import ByteLine, Vault
from firmware_py.common.records import Event
from firmware_py.link.signing import NO_VAULT
from firmware_py.link.wire.transport import MAX_RADIO_BAUD, Address, Transport
from firmware_py.link.wire.transport_tcp import TcpClient, TcpServer
from firmware_py.link.wire.transport_udp import GROUP_ADDRESSES, UdpTransport
from firmware_py.link.wire.urls import PLAIN, LinkError, LinkOptions, LinkUrl, parse_url

_TRANSPORTS: dict[str, Callable[[LinkUrl], Transport]] = {
    "udpout": UdpTransport,
    "udpin": UdpTransport,
    "tcpin": TcpServer,
    "tcpout": TcpClient,
}


NMEA_PREFIX = "nmea:"  # of the URL of an NMEA 0183 output: see link.nmea

RETRY_S = 5.0
MAX_FIRST_WAIT_S = 1.0  # of the caller, for the first attempt

_BITS_PER_BYTE = 10  # start bit, eight bits, stop bit
_PEER: Address = "line"


class SatelliteSupport(msgspec.Struct, frozen=True):
    """Services for a satellite link: storage of its record, the clock, and a function that reports events."""

    vault: Vault = NO_VAULT
    utc_s: Callable[[], float] = lambda: 0.0
    report: Callable[[Event], None] = lambda _event: None


_NO_SUPPORT = SatelliteSupport()


def open_transport(
    url: str,
    open_line: Callable[[str, int], ByteLine],
    support: SatelliteSupport = _NO_SUPPORT,
    *,
    report_retry: Callable[[str], None] | None = None,
    receives: bool = True,
) -> Transport:
    """Open the transport of a URL; raise LinkError if that fails.

    `open_line` opens a serial line from its path and baud rate. With `report_retry`, a socket that cannot be opened is
    retried in the background, and the function receives the reason. `receives` False allows broadcast targets.
    """
    parsed = parse_url(url)
    if parsed.kind == "sbd":
        from firmware_py.link.satellite.transport import SbdTransport  # noqa: PLC0415 - imported only for a satellite link

        line = open_line(parsed.host, parsed.number)
        return SbdTransport(parsed, line, support.vault, support.utc_s, support.report)
    if parsed.kind == "serial":
        return SerialTransport(parsed.text, open_line(parsed.host, parsed.number), parsed.number, parsed.options)
    open_now: Callable[[], Transport] = partial(_TRANSPORTS[parsed.kind], parsed)
    if parsed.kind == "udpout":
        if receives and parsed.host in GROUP_ADDRESSES:
            open_now()  # raises LinkError: a retry would not help
        open_now = partial(UdpTransport, parsed, receives=receives)
    if report_retry is None:
        return open_now()
    retried = RetriedTransport(parsed, open_now, RETRY_S)
    if retried.opened is None:
        report_retry(f"{retried.problem}; it is tried again")
    return retried.opened or retried


class RetriedTransport:
    """Transport that is opened in the background. It has no peers until then, and delegates to `opened` afterwards.

    A thread opens it, since a name server may block for long.
    """

    byte_rate: float | None = None

    def __init__(self, url: LinkUrl, open_now: Callable[[], Transport], retry_s: float) -> None:
        """Start the thread that calls `open_now` every `retry_s` until it does not raise LinkError."""
        self.name = url.text
        self.options = url.options
        self.has_radio_rates = url.options.uses_radio_rates(default=False)
        self.is_datagram = url.kind.startswith("udp")
        self.is_exposed = url.kind.endswith("in") and not url.host.startswith(("127.", "localhost"))
        self.opened: Transport | None = None
        self.problem = f"link {url.text!r}: host {url.host!r} is not resolved yet"
        self._open_now, self._retry_s = open_now, retry_s
        self._first_attempt_done, self._is_closed = threading.Event(), threading.Event()
        threading.Thread(target=self._open_with_retries, name="link", daemon=True).start()
        self._first_attempt_done.wait(MAX_FIRST_WAIT_S)

    def _open_with_retries(self) -> None:
        while self.opened is None and not self._is_closed.is_set():
            try:
                self.opened = self._open_now()
            except LinkError as error:
                self.problem = str(error)
            self._first_attempt_done.set()
            if self.opened is None:
                self._is_closed.wait(self._retry_s)
        if self._is_closed.is_set():
            self.close()

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors of the opened transport."""
        return () if self.opened is None else self.opened.descriptors()

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read from a descriptor."""
        return () if self.opened is None else self.opened.receive(descriptor)

    def send(self, address: Address, data: bytes) -> bool:
        """Send or buffer all of `data`, or return False and send none of it."""
        return self.opened is not None and self.opened.send(address, data)

    @property
    def blocked_reason(self) -> str:
        """Reason why opening or sending fails."""
        return self.problem if self.opened is None else self.opened.blocked_reason

    def addresses(self) -> Sequence[Address]:
        """Return the permanent peers."""
        return () if self.opened is None else self.opened.addresses()

    def connections(self) -> Sequence[Address]:
        """Return the connected peers."""
        return () if self.opened is None else self.opened.connections()

    def host(self, address: Address) -> Address:
        """Return an identifier of the computer of a peer."""
        return address if self.opened is None else self.opened.host(address)

    def drop(self, address: Address) -> None:
        """Close the connection of a peer."""
        if self.opened is not None:
            self.opened.drop(address)

    def poll(self, now_s: float) -> None:
        """Do the periodic work of the opened transport."""
        if self.opened is not None:
            self.opened.poll(now_s)

    def close(self) -> None:
        """Stop the attempts, and close the opened transport."""
        self._is_closed.set()
        if self.opened is not None:
            self.opened.close()


class SerialTransport:
    """Serial line with one peer. The device may be unplugged and plugged in again."""

    is_datagram = False
    is_exposed = False

    def __init__(self, name: str, line: ByteLine, baud: int, options: LinkOptions = PLAIN) -> None:
        """Store an opened line; `baud` gives its byte rate."""
        self.name = name
        self.options = options
        self.byte_rate: float | None = baud / _BITS_PER_BYTE
        self.has_radio_rates = options.uses_radio_rates(default=baud <= MAX_RADIO_BAUD)
        self._line = line

    def descriptors(self) -> Sequence[int]:
        """Return the descriptor of the line while it is open."""
        descriptor = self._line.fileno()
        return () if descriptor < 0 else (descriptor,)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - there is only one
        """Read at most 4096 bytes, the limit of ByteLine."""
        data = self._line.read()
        return ((_PEER, data),) if data else ()

    def send(self, address: Address, data: bytes) -> bool:  # noqa: ARG002 - there is only one
        """Write all of `data` to the line, or return False."""
        return self._line.write(data)

    @property
    def blocked_reason(self) -> str:
        """Reason why sending is blocked: the device is missing."""
        return "" if self.descriptors() else "the line is not there"

    def addresses(self) -> Sequence[Address]:
        """Return the one peer, whether it is connected or not."""
        return (_PEER,)

    def connections(self) -> Sequence[Address]:
        """Return no peers: a line has no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the address itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the peer is permanent."""

    def poll(self, now_s: float) -> None:
        """Do nothing: ByteLine reopens the device."""

    def close(self) -> None:
        """Do nothing: the caller closes the line."""
