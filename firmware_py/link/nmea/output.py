"""One output of NMEA 0183: `nmea:udpout:HOST:PORT?sentences=HDT,RMC&rate=2`."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.reading_notes import shown
from firmware_py.link.nmea.sentences import LONGEST, TABLE, Scene, sentences
from firmware_py.link.wire.open_transport import NMEA, open_transport
from firmware_py.link.wire.transport import Transport
from firmware_py.link.wire.urls import LinkError

_KINDS = {"udpout": "udpout", "udp": "udpout", "tcpin": "tcpin", "tcpout": "tcpout", "serial": "serial"}
_FORMS = "nmea:udpout:HOST:PORT, nmea:tcpin:HOST:PORT, nmea:tcpout:HOST:PORT or nmea:serial:PATH:BAUD"
_SLOWEST_HZ, _FASTEST_HZ = 0.01, 10.0


class NmeaOptions(msgspec.Struct, frozen=True):
    """Which sentences, and how often."""

    sentences: tuple[str, ...] = tuple(TABLE)
    rate_hz: float = 1.0


class NmeaOutput:
    """Says the sentences to whoever listens; what listeners say is read and forgotten."""

    def __init__(self, name: str, transport: Transport, options: NmeaOptions) -> None:
        """Take the way out."""
        self._name, self._transport, self._options = name, transport, options
        self._due_s = 0.0
        self._sent_bytes = self._dropped = 0

    def publish(self, scene: Callable[[], Scene], now_s: float) -> None:
        """Say what is due; at most once in a call, and late ones are left out."""
        if now_s < self._due_s:
            return
        period_s = 1.0 / self._options.rate_hz
        self._due_s = self._due_s + period_s if self._due_s + period_s > now_s else now_s + period_s
        transport = self._transport
        transport.poll(now_s)
        for descriptor in transport.descriptors():
            transport.receive(descriptor)
        listeners = (*transport.addresses(), *transport.guests())
        if not listeners:
            return
        said = b"".join(sentences(scene(), self._options.sentences))
        for address in listeners:
            if not said:
                continue
            if transport.send(address, said):
                self._sent_bytes += len(said)
            else:
                self._dropped += 1

    def status(self, _now_s: float) -> LinkStatus:
        """Return how much was said, and how often a listener had no room for it."""
        said = PeerStatus(
            address=f"{len(self._transport.addresses()) + len(self._transport.guests())} listening",
            ground_station=False,
            has_place=True,
            signs=False,
            heard_age_s=None,
            sent_bytes=self._sent_bytes,
            dropped=self._dropped,
            rejected=0,
        )
        return LinkStatus(self._name, "NMEA 0183", (said,), blocked_reason=self._transport.blocked_reason)

    def close(self) -> None:
        """Close the way out."""
        self._transport.close()


def open_output(
    url: str, open_line: Callable[[str, int], ByteLine], say: Callable[[str], None] | None = None
) -> NmeaOutput:
    """Open an output, or raise LinkError; as `open_transport`."""
    place, _, query = url.removeprefix(NMEA).partition("?")
    kind, _, rest = place.partition(":")
    if kind not in _KINDS:
        raise LinkError(f"link {url[:120]!r}: {shown(kind)} is not a way out for NMEA 0183; use {_FORMS}")
    options = _options(url, query)
    transport = open_transport(f"{_KINDS[kind]}:{rest}", open_line, say=say, hears=False)
    needed = len(options.sentences) * LONGEST * options.rate_hz
    if transport.byte_rate is not None and needed > transport.byte_rate:
        transport.close()
        raise LinkError(
            f"link {url[:120]!r}: {needed:.0f} bytes a second may be needed, and the line carries "
            f"{transport.byte_rate:.0f}; give fewer sentences=, a lower rate= or a faster line"
        )
    return NmeaOutput(url, transport, options)


def _options(url: str, query: str) -> NmeaOptions:
    names, rate_hz = NmeaOptions().sentences, NmeaOptions().rate_hz
    for item in query.split("&") if query else ():
        name, _, value = item.partition("=")
        if name == "sentences" and value and set(value.split(",")) <= set(TABLE):
            names = tuple(dict.fromkeys(value.split(",")))
        elif name == "rate" and (rate := _rate_hz(value)) is not None:
            rate_hz = rate
        else:
            raise LinkError(
                f"link {url[:120]!r}: {shown(item)}: there are sentences={','.join(TABLE)} "
                f"and rate={_SLOWEST_HZ:g} to {_FASTEST_HZ:g} (Hz)"
            )
    return NmeaOptions(names, rate_hz)


def _rate_hz(text: str) -> float | None:
    try:
        rate_hz = float(text)
    except ValueError:
        return None
    return rate_hz if _SLOWEST_HZ <= rate_hz <= _FASTEST_HZ else None
