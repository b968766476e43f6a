"""Binary protocol UBX of u-blox receivers: framing, and the message NAV-PVT.

Source: u-blox 8 / M8 receiver description, UBX-13003221, sections 32.2 and 32.17.14.
"""

from __future__ import annotations

import datetime as dt
import itertools
import re
import struct
from collections.abc import Iterator

import msgspec

from firmware_py.common.driver import CaptureFormat
from firmware_py.common.records import FixType
from firmware_py.sensors.binary_framing import PacketFramer
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range

NAV_PVT = 0x0107
_NAV_PVT_SIZE = 84  # of u-blox 7; later models send 92, with a flag for an invalid position
_FLAGS3_OFFSET, _FLAGS3_MIN_SIZE = 78, 92

# B5 62, class and id, then the length, little endian, below 2560 (RXM-RAWX of 72 measurements is 2320).
_HEADER = re.compile(rb"\xb5\x62..[\x00-\xff][\x00-\x09]", re.DOTALL)
_NAV_PVT = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiiiii")  # up to the course
# Bits of `flags`, `valid` and `flags3`; the upper two bits of `flags` are the carrier phase solution.
_FIX_OK, _DIFFERENTIAL, _CARRIER_SHIFT = 1 << 0, 1 << 1, 6
_UTC_KNOWN = 0b111  # date valid, time valid, no uncertainty of seconds
_POSITION_INVALID = 1 << 0
_FIX_TYPES = {2: FixType.FIX_2D, 3: FixType.FIX_3D, 4: FixType.FIX_3D}  # 1: dead reckoning only, 5: time only
_CARRIER_FIXES = {1: FixType.RTK_FLOAT, 2: FixType.RTK_FIXED}


class NavPvt(msgspec.Struct, frozen=True):
    """A navigation solution; without a valid fix all fields but fix and satellites are None."""

    fix: FixType
    satellites: int
    lat_deg: float | None = None
    lon_deg: float | None = None
    altitude_m: float | None = None  # above mean sea level
    sog_m_s: float | None = None
    cog_deg: float | None = None
    utc_s: float | None = None
    accuracy_m: float | None = None  # horizontal standard deviation estimated by the receiver


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, 6, lambda header: int.from_bytes(header[4:6], "little") + 8, _Fletcher())


class _Fletcher:
    """The 8-bit Fletcher checksum from class to payload, computed from cumulative sums.

    The time per packet does not depend on its length, so false headers with long lengths cost no extra time.
    """

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._sums = [0]  # sum of all bytes since the start before each index
        self._sums_of_sums = [0]

    def extend(self, data: bytes) -> None:
        """Note bytes that were appended to the buffer."""
        sums = list(itertools.accumulate(data, initial=self._sums[-1]))[1:]
        self._sums += sums
        self._sums_of_sums += list(itertools.accumulate(sums, initial=self._sums_of_sums[-1]))[1:]

    def drop(self, count: int) -> None:
        """Note that bytes were removed from the start of the buffer."""
        del self._sums[:count], self._sums_of_sums[:count]

    def is_packet(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a complete packet."""
        begin, end = begin + 2, end - 2
        first = self._sums[end] - self._sums[begin]
        second = self._sums_of_sums[end] - self._sums_of_sums[begin] - (end - begin) * self._sums[begin]
        return buffer[end] == first & 0xFF and buffer[end + 1] == second & 0xFF


def message_id(packet: bytes) -> int:
    """Return class and id of a packet as one number."""
    return int.from_bytes(packet[2:4], "big")


def payload(packet: bytes) -> bytes:
    """Return the payload of a packet."""
    return packet[6:-2]


def parse_nav_pvt(data: bytes) -> NavPvt:
    """Return the solution of a NAV-PVT; raises MessageError if it is too short or out of range."""
    if len(data) < _NAV_PVT_SIZE:
        raise MessageError(MALFORMED, f"NAV-PVT of {len(data)} bytes")
    fields = _NAV_PVT.unpack_from(data)
    fix_type, flags, satellites = fields[10], fields[11], fields[13]
    fix = _FIX_TYPES.get(fix_type, FixType.NONE)
    is_invalid = len(data) >= _FLAGS3_MIN_SIZE and data[_FLAGS3_OFFSET] & _POSITION_INVALID
    if not flags & _FIX_OK or is_invalid or fix is FixType.NONE:
        return NavPvt(FixType.NONE, satellites)
    if fix is FixType.FIX_3D:
        fix = _CARRIER_FIXES.get(flags >> _CARRIER_SHIFT, FixType.DGPS if flags & _DIFFERENTIAL else fix)
    lon_deg, lat_deg, altitude_m = fields[14] * 1e-7, fields[15] * 1e-7, fields[17] * 1e-3
    sog_m_s, cog_deg = fields[23] * 1e-3, fields[24] * 1e-5
    for name, value, low, high in (
        ("latitude", lat_deg, -90.0, 90.0),
        ("longitude", lon_deg, -180.0, 180.0),
        ("altitude", altitude_m, -1e3, 1e5),
        ("speed", sog_m_s, 0.0, 200.0),
        ("course", cog_deg, 0.0, 360.0),
    ):
        check_range(value, low, high, f"NAV-PVT {name}")
    accuracy_m = fields[18] * 1e-3
    return NavPvt(fix, satellites, lat_deg, lon_deg, altitude_m, sog_m_s, cog_deg, _compute_utc_s(fields), accuracy_m)


def _compute_utc_s(fields: tuple[int, ...]) -> float | None:
    """Return the UTC, None unless the receiver marks it as valid with known leap seconds and it is in range."""
    _, year, month, day, hour, minute, second, valid, _, nanosecond = fields[:10]
    if valid & _UTC_KNOWN != _UTC_KNOWN:
        return None
    if not (1980 <= year <= 2099 and hour <= 23 and minute <= 59 and second <= 60 and abs(nanosecond) <= 10**9):
        return None
    try:
        midnight = dt.datetime(year, month, day, tzinfo=dt.UTC)
    except ValueError:
        return None
    return midnight.timestamp() + hour * 3600 + minute * 60 + second + nanosecond * 1e-9


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_packet)


def _decode_packet(packet: bytes) -> Result:
    number = message_id(packet)
    if number != NAV_PVT:
        return {"type": "other", "message": f"{number >> 8:02X}-{number & 0xFF:02X}"}
    solution = msgspec.structs.asdict(parse_nav_pvt(payload(packet)))
    fix = {"fix": solution.pop("fix").name}
    return {"type": "position", "message": "NAV-PVT", **fix, **round_values("position", solution)}


CAPTURE_FORMAT = CaptureFormat("ubx", _decode_capture)
