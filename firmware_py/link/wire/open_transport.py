"""Opens the transport that a URL names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import msgspec

from firmware_py.common.interfaces import ByteLine, Vault
from firmware_py.common.records import Event
from firmware_py.link.security.key_record import NO_VAULT
from firmware_py.link.wire.transport import LinkUrl, Transport, parse_url
from firmware_py.link.wire.transport_late import LateTransport
from firmware_py.link.wire.transport_serial import SerialTransport
from firmware_py.link.wire.transport_tcp import TcpClient, TcpServer
from firmware_py.link.wire.transport_udp import OF_MANY_ANYWHERE, UdpTransport

_SOCKETS: dict[str, Callable[[LinkUrl], Transport]] = {
    "udpout": UdpTransport,
    "udpin": UdpTransport,
    "tcpin": TcpServer,
    "tcpout": TcpClient,
}


NMEA = "nmea:"  # before the URL of an output of NMEA 0183, which is no link of MAVLink: see link.nmea


class Ashore(msgspec.Struct, frozen=True):
    """What a link by satellite needs beside its line: what keeps its record, the clock, and what tells an event."""

    vault: Vault = NO_VAULT
    utc_s: Callable[[], float] = lambda: 0.0
    tell: Callable[[Event], None] = lambda _event: None


_ALONE = Ashore()


def open_transport(
    url: str,
    open_line: Callable[[str, int], ByteLine],
    ashore: Ashore = _ALONE,
    *,
    say: Callable[[str], None] | None = None,
    hears: bool = True,
) -> Transport:
    """Open the transport of a URL, or raise LinkError; `open_line` takes the path and baud rate of a serial line.

    With `say` a socket that cannot be opened now is opened when it can, and that is said. What does not have to be
    heard (`hears`) may be sent to many at once.
    """
    parsed = parse_url(url)
    if parsed.kind == "sbd":
        from firmware_py.link.wire.transport_sbd import SbdTransport  # noqa: PLC0415 - who has none pays nothing

        line = open_line(parsed.host, parsed.number)
        return SbdTransport(parsed, line, ashore.vault, ashore.utc_s, ashore.tell)
    if parsed.kind == "serial":
        return SerialTransport(parsed.text, open_line(parsed.host, parsed.number), parsed.number, parsed.options)
    open_now: Callable[[], Transport] = partial(_SOCKETS[parsed.kind], parsed)
    if parsed.kind == "udpout":
        if hears and parsed.host in OF_MANY_ANYWHERE:
            open_now()  # raises: no waiting mends it
        open_now = partial(UdpTransport, parsed, hears=hears)
    if say is None:
        return open_now()
    late = LateTransport(parsed, open_now)
    if late.opened is None:
        say(f"{late.problem}; it is tried again")
    return late.opened or late
