"""Opens the transport that a URL names."""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.interfaces import ByteLine
from firmware_py.link.wire.transport import LinkUrl, Transport, parse_url
from firmware_py.link.wire.transport_serial import SerialTransport
from firmware_py.link.wire.transport_tcp import TcpClient, TcpServer
from firmware_py.link.wire.transport_udp import UdpTransport

_SOCKETS: dict[str, Callable[[LinkUrl], Transport]] = {
    "udpout": UdpTransport,
    "udpin": UdpTransport,
    "tcpin": TcpServer,
    "tcpout": TcpClient,
}


def open_transport(url: str, open_line: Callable[[str, int], ByteLine]) -> Transport:
    """Open the transport of a URL, or raise LinkError; `open_line` takes the path and baud rate of a serial line."""
    parsed = parse_url(url)
    if parsed.kind == "serial":
        return SerialTransport(parsed.text, open_line(parsed.host, parsed.number), parsed.number, parsed.options)
    return _SOCKETS[parsed.kind](parsed)
