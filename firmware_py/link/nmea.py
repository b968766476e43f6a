"""Output of NMEA 0183 for plotters, loggers and other instruments: `nmea:udpout:HOST:PORT?sentences=HDT,RMC&rate=2`.

Source: E. S. Raymond, "NMEA Revealed". A field whose value is unknown or old is empty.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence

import msgspec

from firmware_py.common.angles import compass_degrees, degrees, wrap_pi
from firmware_py.common.calendar import is_possible
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.reading_notes import abbreviate
from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Activity, Snapshot
from firmware_py.link.wire.open_transport import NMEA_PREFIX, open_transport
from firmware_py.link.wire.transport import Transport
from firmware_py.link.wire.urls import LinkError

MAX_SENTENCE_BYTES = 82  # with the line end
_KNOT_M_S = 1852.0 / 3600.0
_MILE_M = 1852.0
_MAX_XTE_MILES = 9.99
_GGA_QUALITY: Mapping[FixType, int] = {FixType.DGPS: 2, FixType.RTK_FIXED: 4, FixType.RTK_FLOAT: 5}

_KINDS = {"udpout": "udpout", "udp": "udpout", "tcpin": "tcpin", "tcpout": "tcpout", "serial": "serial"}
_FORMS = "nmea:udpout:HOST:PORT, nmea:tcpin:HOST:PORT, nmea:tcpout:HOST:PORT or nmea:serial:PATH:BAUD"
_MIN_RATE_HZ, _MAX_RATE_HZ = 0.01, 10.0


class NmeaData(msgspec.Struct, frozen=True):
    """Snapshot after a tick, time, and present declination (east positive)."""

    snapshot: Snapshot
    utc_s: float
    declination_rad: float

    @property
    def fix(self) -> PositionSample | None:
        """The GNSS position; None if it is old or incomplete."""
        fix = self.snapshot.position
        is_usable = self.snapshot.position_ok and fix is not None and None not in (fix.latitude_rad, fix.longitude_rad)
        return fix if is_usable else None

    @property
    def heading_rad(self) -> float | None:
        """The heading from true north; None if it is old."""
        return self.snapshot.heading_rad if self.snapshot.heading_ok else None

    def to_magnetic(self, true_rad: float | None) -> float | None:
        """Convert an angle from true north to an angle from magnetic north."""
        return None if true_rad is None else true_rad - self.declination_rad


Fields = Sequence[str] | None  # None: no sentence


def sentence(talker: str, name: str, fields: Sequence[str]) -> bytes:
    """Build a sentence with its checksum."""
    body = ",".join((talker + name, *fields))
    check = 0
    for byte in body.encode("ascii"):
        check ^= byte
    return f"${body}*{check:02X}\r\n".encode("ascii")


def _number(value: float | None, places: int = 1, scale: float = 1.0) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f"{round(value * scale, places) + 0.0:.{places}f}"


def _angle(angle_rad: float | None) -> str:
    if angle_rad is None or not math.isfinite(angle_rad):
        return ""
    return f"{round(compass_degrees(angle_rad), 1) % 360.0:.1f}"


def _magnitude_and_side(value: float, places: int, positive: str, negative: str) -> tuple[str, str]:
    return _number(abs(value), places), positive if value >= 0.0 else negative


def _position(fix: PositionSample | None) -> tuple[str, str, str, str]:
    if fix is None or fix.latitude_rad is None or fix.longitude_rad is None:
        return "", "", "", ""
    longitude_rad = wrap_pi(fix.longitude_rad)
    return (
        *_degrees_minutes(fix.latitude_rad, 2, "NS"),
        *_degrees_minutes(longitude_rad, 3, "EW"),
    )


def _degrees_minutes(angle_rad: float, width: int, sides: str) -> tuple[str, str]:
    # The angle is rounded before it is divided, so that there are never 60 minutes.
    units = round(abs(degrees(angle_rad)) * 600_000.0)
    whole, minutes = divmod(units, 600_000)
    return f"{whole:0{width}d}{minutes / 10_000.0:07.4f}", sides[angle_rad < 0.0]


def _time_and_date(data: NmeaData) -> tuple[str, str]:
    """Return time and date of the receiver, otherwise of the computer; empty if they are implausible."""
    fix = data.fix
    utc_s = fix.utc_s if fix is not None and fix.utc_s is not None else data.utc_s
    if not is_possible(utc_s):
        return "", ""
    whole_s, hundredths = divmod(math.floor(utc_s * 100.0), 100)
    utc = time.gmtime(whole_s)
    return f"{time.strftime('%H%M%S', utc)}.{hundredths:02d}", time.strftime("%d%m%y", utc)


def _hdt(data: NmeaData) -> Fields:
    return None if data.heading_rad is None else (_angle(data.heading_rad), "T")


def _hdg(data: NmeaData) -> Fields:
    if data.heading_rad is None:
        return None
    variation = _magnitude_and_side(degrees(data.declination_rad), 1, "E", "W")
    return (_angle(data.to_magnetic(data.heading_rad)), "", "", *variation)


def _rot(data: NmeaData) -> Fields:
    rate_rad_s = data.snapshot.yaw_rate_rad_s
    if data.heading_rad is None or rate_rad_s is None:
        return None
    return (_number(degrees(rate_rad_s) * 60.0), "A")


def _rmc(data: NmeaData) -> Fields:
    fix = data.fix
    state, mode = ("V", "N") if fix is None else ("A", "A")
    speed = _number(fix.speed_over_ground_m_s, 2, 1.0 / _KNOT_M_S) if fix else ""
    course = _angle(fix.course_over_ground_rad) if fix else ""
    variation = _magnitude_and_side(degrees(data.declination_rad), 1, "E", "W")
    clock, date = _time_and_date(data)
    return (clock, state, *_position(fix), speed, course, date, *variation, mode)


def _gga(data: NmeaData) -> Fields:
    fix, clock = data.fix, _time_and_date(data)[0]
    if fix is None:
        return (clock, "", "", "", "", "0", "", "", "", "M", "", "M", "", "")
    satellites = "" if fix.satellites is None else f"{min(max(fix.satellites, 0), 99):02d}"
    quality = str(_GGA_QUALITY.get(fix.fix, 1))
    height = (_number(fix.altitude_m), "M", "", "M", "", "")
    return (clock, *_position(fix), quality, satellites, _number(fix.hdop), *height)


def _rsa(data: NmeaData) -> Fields:
    angle_rad = data.snapshot.rudder_rad if data.snapshot.rudder_ok else None
    # As in NMEA 0183, positive turns the boat to starboard. The boat has one rudder.
    return ("", "V", "", "V") if angle_rad is None else (_number(degrees(angle_rad)), "A", "", "V")


def _cross_track(data: NmeaData) -> tuple[str, str, str] | None:
    """Return cross-track distance, side to steer to, and unit; None without a line."""
    navigation = data.snapshot.navigation
    if navigation.activity is not Activity.LINE or navigation.cross_track_m is None:
        return None
    distance = min(abs(navigation.cross_track_m) / _MILE_M, _MAX_XTE_MILES)
    return _number(distance, 3), "L" if navigation.cross_track_m > 0.0 else "R", "N"


def _xte(data: NmeaData) -> Fields:
    cross_track = _cross_track(data)
    return None if cross_track is None or data.fix is None else ("A", "A", *cross_track, "A")


def _apb(data: NmeaData) -> Fields:
    cross_track, snapshot = _cross_track(data), data.snapshot
    if cross_track is None or data.fix is None:
        return None
    index = snapshot.mission.index
    name = "GOAL" if index is None else f"{index + 1:03d}"
    arrived = "A" if snapshot.navigation.arrived else "V"
    line, bearing = _angle(_line_rad(snapshot)), _angle(snapshot.bearing_rad)
    goal = _angle(snapshot.goal_heading_rad)
    return ("A", "A", *cross_track, arrived, "V", line, "T", name, bearing, "T", goal, "T", "A")


def _line_rad(snapshot: Snapshot) -> float | None:
    """Return the direction of the line to the waypoint.

    Return None if it is unknown, or if the boat is not farther from the waypoint than from the line.
    """
    bearing_rad, distance_m, off_m = snapshot.bearing_rad, snapshot.distance_m, snapshot.navigation.cross_track_m
    if bearing_rad is None or distance_m is None or off_m is None or abs(off_m) >= distance_m:
        return None
    return bearing_rad + math.asin(off_m / distance_m)


def _vhw(data: NmeaData) -> Fields:
    water = data.snapshot.water
    speed_m_s = water.speed_m_s if water is not None else None
    if speed_m_s is None and data.heading_rad is None:
        return None
    heading, magnetic = _angle(data.heading_rad), _angle(data.to_magnetic(data.heading_rad))
    speeds = (_number(speed_m_s, 2, 1.0 / _KNOT_M_S), "N", _number(speed_m_s, 2, 3.6), "K")
    return (heading, "T", magnetic, "M", *speeds)


# Name: talker, function that returns the fields. Talkers: compass, rate of turn, satellite receivers, autopilot, speed
# through the water.
TABLE: Mapping[str, tuple[str, Callable[[NmeaData], Fields]]] = {
    "HDT": ("HC", _hdt),
    "HDG": ("HC", _hdg),
    "ROT": ("TI", _rot),
    "RMC": ("GN", _rmc),
    "GGA": ("GN", _gga),
    "RSA": ("AG", _rsa),
    "XTE": ("AG", _xte),
    "APB": ("AG", _apb),
    "VHW": ("VW", _vhw),
}


def sentences(data: NmeaData, names: Sequence[str]) -> list[bytes]:
    """Build the sentences with these names, without those that have no value."""
    built = ((talker, name, build(data)) for name in names for talker, build in (TABLE[name],))
    return [sentence(talker, name, fields) for talker, name, fields in built if fields is not None]


class NmeaOptions(msgspec.Struct, frozen=True):
    """Options of an output: names and rate of the sentences."""

    sentences: tuple[str, ...] = tuple(TABLE)
    rate_hz: float = 1.0


class NmeaOutput:
    """Sends sentences to all listeners; received bytes are discarded."""

    def __init__(self, name: str, transport: Transport, options: NmeaOptions) -> None:
        """Store the URL, the transport and the options."""
        self._name, self._transport, self._options = name, transport, options
        self._due_s = 0.0
        self._sent_bytes = self._dropped = 0

    def publish(self, get_data: Callable[[], NmeaData], now_s: float) -> None:
        """Send the sentences if they are due; missed intervals are skipped."""
        if now_s < self._due_s:
            return
        period_s = 1.0 / self._options.rate_hz
        self._due_s = self._due_s + period_s if self._due_s + period_s > now_s else now_s + period_s
        transport = self._transport
        transport.poll(now_s)
        for descriptor in transport.descriptors():
            transport.receive(descriptor)
        listeners = (*transport.addresses(), *transport.connections())
        if not listeners:
            return
        data = b"".join(sentences(get_data(), self._options.sentences))
        for address in listeners:
            if not data:
                continue
            if transport.send(address, data):
                self._sent_bytes += len(data)
            else:
                self._dropped += 1

    def status(self, _now_s: float) -> LinkStatus:
        """Return the sent bytes, and the number of dropped messages."""
        listeners = PeerStatus(
            address=f"{len(self._transport.addresses()) + len(self._transport.connections())} listening",
            ground_station=False,
            has_place=True,
            signs=False,
            heard_age_s=None,
            sent_bytes=self._sent_bytes,
            dropped=self._dropped,
            rejected=0,
        )
        return LinkStatus(self._name, "NMEA 0183", (listeners,), blocked_reason=self._transport.blocked_reason)

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()


def open_output(
    url: str, open_line: Callable[[str, int], ByteLine], report_retry: Callable[[str], None] | None = None
) -> NmeaOutput:
    """Open an output; raise LinkError if that fails. `report_retry` is that of `open_transport`."""
    location, _, query = url.removeprefix(NMEA_PREFIX).partition("?")
    kind, _, rest = location.partition(":")
    if kind not in _KINDS:
        raise LinkError(f"link {url[:120]!r}: {abbreviate(kind)} is not supported for NMEA 0183; use {_FORMS}")
    options = _options(url, query)
    transport = open_transport(f"{_KINDS[kind]}:{rest}", open_line, report_retry=report_retry, receives=False)
    needed_byte_rate = len(options.sentences) * MAX_SENTENCE_BYTES * options.rate_hz
    if transport.byte_rate is not None and needed_byte_rate > transport.byte_rate:
        transport.close()
        raise LinkError(
            f"link {url[:120]!r}: {needed_byte_rate:.0f} bytes/s may be needed, and the line has "
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
                f"link {url[:120]!r}: {abbreviate(item)}: there are sentences={','.join(TABLE)} "
                f"and rate={_MIN_RATE_HZ:g} to {_MAX_RATE_HZ:g} (Hz)"
            )
    return NmeaOptions(names, rate_hz)


def _rate_hz(text: str) -> float | None:
    try:
        rate_hz = float(text)
    except ValueError:
        return None
    return rate_hz if _MIN_RATE_HZ <= rate_hz <= _MAX_RATE_HZ else None
