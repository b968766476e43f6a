"""Opens the transport of a URL: a serial line, or a socket, at once or as soon as that is possible."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import msgspec

from firmware_py.common.interfaces import ByteLine, Vault
from firmware_py.common.records import Event
from firmware_py.link.signing import NO_VAULT
from firmware_py.link.wire.transport import RADIO_BAUD, Address, Transport
from firmware_py.link.wire.transport_tcp import TcpClient, TcpServer
from firmware_py.link.wire.transport_udp import OF_MANY_ANYWHERE, UdpTransport
from firmware_py.link.wire.urls import PLAIN, LinkError, LinkOptions, LinkUrl, parse_url

_SOCKETS: dict[str, Callable[[LinkUrl], Transport]] = {
    "udpout": UdpTransport,
    "udpin": UdpTransport,
    "tcpin": TcpServer,
    "tcpout": TcpClient,
}


NMEA = "nmea:"  # prefix of the URL of an NMEA 0183 output: see link.nmea

RETRY_S = 5.0
FIRST_TRY_S = 1.0  # maximum wait for the first attempt

_BITS_PER_BYTE = 10  # start bit, eight bits, stop bit
_FAR_END: Address = "line"


class SatelliteSupport(msgspec.Struct, frozen=True):
    """Further needs of a satellite link: storage of its record, the clock, and a function that reports events."""

    vault: Vault = NO_VAULT
    utc_s: Callable[[], float] = lambda: 0.0
    report: Callable[[Event], None] = lambda _event: None


_ALONE = SatelliteSupport()


def open_transport(
    url: str,
    open_line: Callable[[str, int], ByteLine],
    support: SatelliteSupport = _ALONE,
    *,
    say: Callable[[str], None] | None = None,
    receives: bool = True,
) -> Transport:
    """Open the transport of a URL, or raise LinkError; `open_line` takes the path and baud rate of a serial line.

    With `say` a socket that cannot be opened now is opened later, and that is reported. `receives` False allows
    broadcast targets.
    """
    parsed = parse_url(url)
    if parsed.kind == "sbd":
        from firmware_py.link.satellite.transport import SbdTransport  # noqa: PLC0415 - imported only for a satellite link

        line = open_line(parsed.host, parsed.number)
        return SbdTransport(parsed, line, support.vault, support.utc_s, support.report)
    if parsed.kind == "serial":
        return SerialTransport(parsed.text, open_line(parsed.host, parsed.number), parsed.number, parsed.options)
    open_now: Callable[[], Transport] = partial(_SOCKETS[parsed.kind], parsed)
    if parsed.kind == "udpout":
        if receives and parsed.host in OF_MANY_ANYWHERE:
            open_now()  # raises: waiting does not help
        open_now = partial(UdpTransport, parsed, receives=receives)
    if say is None:
        return open_now()
    late = LateTransport(parsed, open_now)
    if late.opened is None:
        say(f"{late.problem}; it is tried again")
    return late.opened or late


class LateTransport:
    """A transport without peers until it is `opened`; then it delegates to the opened one.

    A thread tries to open it, since a name server may block for long.
    """

    byte_rate: float | None = None

    def __init__(self, url: LinkUrl, open_now: Callable[[], Transport], retry_s: float = RETRY_S) -> None:
        """Start to try `open_now`, which raises LinkError on failure."""
        self.name = url.text
        self.options = url.options
        self.radio = url.options.at_radio_rates(usual=False)
        self.datagrams = url.kind.startswith("udp")
        self.exposed = url.kind.endswith("in") and not url.host.startswith(("127.", "localhost"))
        self.opened: Transport | None = None
        self.problem = f"link {url.text!r}: host {url.host!r} is not resolved yet"
        self._open_now, self._retry_s = open_now, retry_s
        self._tried, self._ended = threading.Event(), threading.Event()
        threading.Thread(target=self._try, name="link", daemon=True).start()
        self._tried.wait(FIRST_TRY_S)

    def _try(self) -> None:
        while self.opened is None and not self._ended.is_set():
            try:
                self.opened = self._open_now()
            except LinkError as error:
                self.problem = str(error)
            self._tried.set()
            if self.opened is None:
                self._ended.wait(self._retry_s)
        if self._ended.is_set():
            self.close()

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to be read."""
        return () if self.opened is None else self.opened.descriptors()

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read from a descriptor."""
        return () if self.opened is None else self.opened.receive(descriptor)

    def send(self, address: Address, data: bytes) -> bool:
        """Take all of data, or none of it."""
        return self.opened is not None and self.opened.send(address, data)

    @property
    def blocked_reason(self) -> str:
        """Why sending is blocked."""
        return self.problem if self.opened is None else self.opened.blocked_reason

    def addresses(self) -> Sequence[Address]:
        """Return the permanent peers."""
        return () if self.opened is None else self.opened.addresses()

    def connections(self) -> Sequence[Address]:
        """Return the connected peers."""
        return () if self.opened is None else self.opened.connections()

    def host(self, address: Address) -> Address:
        """Return the computer of a peer."""
        return address if self.opened is None else self.opened.host(address)

    def drop(self, address: Address) -> None:
        """Close a connection."""
        if self.opened is not None:
            self.opened.drop(address)

    def poll(self, now_s: float) -> None:
        """Do periodic work."""
        if self.opened is not None:
            self.opened.poll(now_s)

    def close(self) -> None:
        """End the attempts, and close the opened transport."""
        self._ended.set()
        if self.opened is not None:
            self.opened.close()


class SerialTransport:
    """One serial line with one peer at its far end; the line may vanish and return."""

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
        """Return the line's descriptor while it is open."""
        descriptor = self._line.fileno()
        return () if descriptor < 0 else (descriptor,)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:  # noqa: ARG002 - it has one only
        """Read at most the 4096 bytes of a ByteLine."""
        data = self._line.read()
        return ((_FAR_END, data),) if data else ()

    def send(self, address: Address, data: bytes) -> bool:  # noqa: ARG002 - it has one only
        """Hand data to the line, all or nothing."""
        return self._line.write(data)

    @property
    def blocked_reason(self) -> str:
        """Why sending is blocked: the line has vanished."""
        return "" if self._line.fileno() >= 0 else "the line is not there"

    def addresses(self) -> Sequence[Address]:
        """Return the far end, whether it is connected or not."""
        return (_FAR_END,)

    def connections(self) -> Sequence[Address]:
        """Return no peers: a line has no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the far end itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the far end is permanent."""

    def poll(self, now_s: float) -> None:
        """Do nothing: the line opens itself again."""

    def close(self) -> None:
        """Do nothing: the opener closes the line."""
