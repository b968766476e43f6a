"""Fixtures of the driver tests: a serial line, messages with independently computed checksums, recordings."""

import math
import struct

import pytest

from support.line import FakeLine
from support.paths import DATA


@pytest.fixture
def line():
    return FakeLine()


def nmea_sentence(body):
    checksum = 0
    for byte in body.encode("latin-1"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("latin-1")


@pytest.fixture
def nmea():
    """Function that makes a sentence from its body."""
    return nmea_sentence


@pytest.fixture
def deliver(line):
    """Function that delivers data (bytes, or bodies of sentences) to a driver on `line` and returns its samples."""

    def deliver(driver, *data, now_s=1.0):
        line.inbox += b"".join(nmea_sentence(item) if isinstance(item, str) else item for item in data)
        driver.receive(now_s)
        return driver.poll()

    return deliver


def crc16(data):
    """CRC-16, polynomial 0x1021, initial value 0, not reflected, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def pni_frame(frame_id, payload=b""):
    body = struct.pack(">HB", len(payload) + 5, frame_id) + payload
    return body + struct.pack(">H", crc16(body))


PNI_DATA, NAV_PVT = 5, 0x0107  # frame id of PNI; class and id of UBX


def pni_data(heading_deg, pitch_deg=1.5, roll_deg=-2.5, distortion=0, temperature_c=18.0):
    # Number of components; then id and value of heading, pitch, roll, distortion, temperature.
    values = (5, 5, heading_deg, 24, pitch_deg, 25, roll_deg, 8, distortion, 7, temperature_c)
    return pni_frame(PNI_DATA, struct.pack(">BBfBfBfBBBf", *values))


@pytest.fixture
def pni():
    """Function that makes a frame of a PNI module."""
    return pni_frame


@pytest.fixture
def pni_heading():
    """Function that makes a DATA frame of a PNI module."""
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
    altitude_mm=28895,
    date=(2017, 7, 19),
    time=(8, 50, 1),
    nanosecond=250_000_000,
    flags3=0,
):
    """Return a NAV-PVT: lat and lon in 1e-7 deg, speed in mm/s, course in 1e-5 deg."""
    payload = struct.pack("<IHBBBBBBIi", 0, *date, *time, valid, 0, nanosecond)
    payload += struct.pack("<BBBBiiiiII", fix_type, flags, 0, 14, lon, lat, 25424, altitude_mm, accuracy_mm, 1602)
    payload += struct.pack("<iiiiiIIHH", 0, 0, 0, speed, course, 0, 0, 145, flags3)
    return ubx_packet(NAV_PVT, payload.ljust(92, b"\0"))


@pytest.fixture
def ubx():
    """Function that makes a UBX packet."""
    return ubx_packet


@pytest.fixture
def solution():
    """Function that makes a NAV-PVT packet."""
    return nav_pvt


@pytest.fixture
def recordings():
    """The folder of recordings; skip the test without it."""
    if not DATA.is_dir():
        pytest.skip("the recordings of tests/data are missing")
    return DATA


@pytest.fixture
def near():
    """Function that compares an angle in radians with one in degrees."""
    return lambda angle_rad, angle_deg: math.isclose(math.degrees(angle_rad), angle_deg, abs_tol=1e-9)
