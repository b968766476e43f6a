"""A line, a checksum made by hand, and the real recordings."""

import math
import struct

import pytest

from support.line import FakeLine
from support.paths import DATA


@pytest.fixture
def line():
    return FakeLine()


@pytest.fixture
def make_line():
    return FakeLine


def checksummed(body):
    value = 0
    for byte in body.encode("latin-1"):
        value ^= byte
    return f"${body}*{value:02X}\r\n".encode("latin-1")


@pytest.fixture
def nmea():
    """Make a sentence from its body."""
    return checksummed


def crc_by_hand(data):
    """CRC-16, polynomial 0x1021, init 0, not reflected, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def pni_frame(frame_id, payload=b""):
    body = struct.pack(">HB", len(payload) + 5, frame_id) + payload
    return body + struct.pack(">H", crc_by_hand(body))


def pni_data(heading_deg, pitch_deg=1.5, roll_deg=-2.5, distortion=0, temperature_c=18.0):
    payload = struct.pack(
        ">BBfBfBfBBBf", 5, 5, heading_deg, 24, pitch_deg, 25, roll_deg, 8, distortion, 7, temperature_c
    )
    return pni_frame(5, payload)


@pytest.fixture
def pni():
    """Make a frame of a PNI module."""
    return pni_frame


@pytest.fixture
def pni_heading():
    """Make a data frame of a PNI module."""
    return pni_data


def ubx_packet(message, payload):
    body = struct.pack(">H", message) + struct.pack("<H", len(payload)) + payload
    first = second = 0
    for byte in body:
        first = (first + byte) % 256
        second = (second + first) % 256
    return b"\xb5\x62" + body + bytes((first, second))


def nav_pvt(
    *,
    fix_type=3,
    flags=1,
    valid=7,
    lat=-349062263,
    lon=1386081197,
    accuracy_mm=1132,
    speed=500,
    course=9000000,
    date=(2017, 7, 19),
    flags3=0,
):
    payload = struct.pack("<IHBBBBBBIi", 0, *date, 8, 50, 1, valid, 0, 250_000_000)
    payload += struct.pack("<BBBBiiiiII", fix_type, flags, 0, 14, lon, lat, 25424, 28895, accuracy_mm, 1602)
    payload += struct.pack("<iiiiiIIHH", 0, 0, 0, speed, course, 0, 0, 145, flags3)
    return ubx_packet(0x0107, payload.ljust(92, b"\0"))


@pytest.fixture
def ubx():
    """Make a UBX packet."""
    return ubx_packet


@pytest.fixture
def solution():
    """Make a NAV-PVT packet."""
    return nav_pvt


@pytest.fixture
def recordings():
    """The folder of real recordings, or skip."""
    if not DATA.is_dir():
        pytest.skip("the recordings of tests/data are not here")
    return DATA


@pytest.fixture
def near():
    """Compare an angle in radians with one in degrees."""
    return lambda angle_rad, angle_deg: math.isclose(math.degrees(angle_rad), angle_deg, abs_tol=1e-9)
