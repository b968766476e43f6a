"""No bytes from a sensor's line can harm its driver, and no damaged message becomes another heading."""

import itertools
import math
import struct
from types import SimpleNamespace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common.records import DeviceHealth
from firmware_py.devices import CAPTURE_FORMATS, SECTIONS, decode
from firmware_py.sensors import mti_protocol, pni_protocol, ubx_protocol
from firmware_py.sensors.decode import format_text
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.mti import MtiCompass, MtiOptions
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_fields import to_number
from firmware_py.sensors.nmea_framing import MAX_BODY_LENGTH, NmeaFramer
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions

HDG = b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n"
HDT = b"$HEHDT,341.8,T*21\r\n"
RMC = b"$GPRMC,115631,A,5229.6446,N,00518.6558,E,5.0,78.0,150816,1.0,E,A*24\r\n"
GGA = b"$GNGGA,103607.00,5327.03942,N,00214.42462,W,1,06,5.88,56.0,M,48.5,M,,*64\r\n"
PASHR = b"$PASHR,142509.000,179.885,T,-0.624,0.245,,0.029,0.029,0.502,2,3*17\r\n"
PNI = pni_protocol.encode(5, bytes([2, 5]) + struct.pack(">f", 98.5) + bytes([8, 0]))
STATUS_GOOD = bytes.fromhex("E0200400000003")
MTI = mti_protocol.encode(
    0x36,
    STATUS_GOOD + struct.pack(">HB3f", 0x2034, 12, 178.0, 1.0, 98.5) + struct.pack(">HB3f", 0x8020, 12, 0.0, 0.0, -0.1),
)
PVT = bytes.fromhex(
    "b56201075c0030985811e1070713083200370300000027 80ad2f0303 0a0eadeb9d528 9bb31eb50630000df7000006c04000042060000"
    "f6ffffffe4ffffff260000001e000000aa053000e5000000685f0d00910000e0ac4c220000e000e000000080c855".replace(" ", "")
)

# Noise with the beginnings of real messages in it, which plain random bytes hardly ever have.
WHOLE = (HDG, HDT, RMC, GGA, PASHR, PNI, MTI, PVT)
HEADS = tuple(message[: len(message) * 2 // 3] for message in WHOLE)
ODD = (
    b"$",
    b"!",
    b"*",
    b"$GPHDT,",
    b"$GPHDT,1e999,T*00\n",
    b"*2",
    b"\xb5\x62\x01\x07\xff\x09",
    b"\x00\x80\x05",
    b"\n",
    b"\xfa\xff\x36\xff\x08\x00",
    b"\xfa\xff\x3e\x00\xc3",
    b"\xfa\xff\x31\x00\xd0",
    b"\xfa\xff\xc1\x00\x40",
)
PIECES = st.sampled_from(WHOLE + HEADS + ODD) | st.binary(max_size=12)
STREAMS = st.lists(PIECES, max_size=16).map(b"".join)


DRIVERS = {
    f"{section} {name}": lambda line, driver=driver: driver.make(line, driver.options())
    for section in ("compass", "position")
    for name, driver in SECTIONS[section].items()
}
FRAMERS = (NmeaFramer, pni_protocol.framer, mti_protocol.framer, ubx_protocol.framer)


def a_line(stream, size):
    """A ByteLine that gives a stream in pieces."""
    pieces = iter([stream[start : start + size] for start in range(0, len(stream), size)])
    return SimpleNamespace(
        name="line",
        openings=1,
        connected=True,
        fileno=lambda: 7,
        read=lambda: next(pieces, b""),
        write=lambda _data: True,
    )


def test_the_recorded_packet_is_whole():
    (packet,) = ubx_protocol.framer().feed(PVT)
    assert packet.fault == ""


@pytest.mark.parametrize("make", DRIVERS.values(), ids=DRIVERS)
@given(stream=STREAMS | st.binary(max_size=5000), size=st.integers(1, 4096))
def test_drivers_take_anything_and_give_only_sound_samples(make, stream, size):
    driver = make(a_line(stream, size))
    for turn in range(1 + len(stream) // size):
        driver.receive(turn * 0.1)
        assert isinstance(driver.health(turn * 0.1), DeviceHealth)
        for sample in driver.poll():
            for name, limit in (
                ("heading_rad", 2 * math.pi),
                ("latitude_rad", math.pi / 2),
                ("longitude_rad", math.pi),
            ):
                value = getattr(sample, name, None)
                assert value is None or abs(value) <= limit
            assert 0.0 <= getattr(sample, "heading_rad", 0.0) < 2 * math.pi


@pytest.mark.parametrize("make", FRAMERS)
@given(stream=STREAMS, cuts=st.lists(st.integers(0, 400), max_size=8))
def test_how_a_stream_is_cut_does_not_matter(make, stream, cuts):
    whole = make()
    expected = whole.feed(stream) + whole.finish()
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    framer = make()
    found = [message for start, stop in itertools.pairwise(edges) for message in framer.feed(stream[start:stop])]
    assert found + framer.finish() == expected


@pytest.mark.parametrize("make", FRAMERS)
@given(
    noise=STREAMS
    | st.sampled_from(
        [
            b"$GPHDT," + b"1" * 9000,
            b"\xb5\x62\x01\x07\xff\x09" * 1500,
            b"\x00\x80\x05" * 3000,
            b"\xfa\xff\x36\xff\x08\x00" * 1500,
        ]
    )
)
def test_memory_is_bounded(make, noise):
    framer = make()
    for _ in range(4):
        framer.feed(noise)
        assert len(framer._buffer) <= max(MAX_BODY_LENGTH + 4, 0x9FF + 8)


@pytest.mark.parametrize(
    ("make", "message"),
    [(NmeaFramer, HDT), (pni_protocol.framer, PNI), (ubx_protocol.framer, PVT)],
    ids=["nmea", "pni", "ubx"],
)
@given(noise=STREAMS)
def test_a_good_message_after_any_noise_is_found_at_once(make, message, noise):
    framer = make()
    framer.feed(noise)
    found = framer.feed(message)
    assert found
    last = found[-1]
    assert last.fault == ""
    assert getattr(last, "data", message) == message


@pytest.mark.parametrize("message", [HDG, HDT, PASHR], ids=["HDG", "HDT", "PASHR"])
def test_no_single_bit_flip_makes_another_heading_nmea(message):
    """XOR finds every single flip, any odd number of flips in one bit column, and nothing else.

    It cannot see two flips of the same bit in two characters, characters that change
    places, or a cut that falls on an equal sum; those are left to the ranges and to the
    observer. The bits after the checksum carry nothing.
    """
    (good,) = headings(message)
    for bit in range(8 * (len(message) - 2)):
        damaged = bytearray(message)
        damaged[bit // 8] ^= 1 << bit % 8
        # A flipped case of a hexadecimal digit states the same checksum.
        assert headings(bytes(damaged)) in ([], [good]), bit


def headings(stream):
    compass = NmeaCompass(a_line(stream, 4096), NmeaCompassOptions())
    compass.receive(1.0)
    return [sample.heading_rad for sample in compass.poll()]


def test_what_xor_cannot_catch():
    assert headings(b"$HEHDT,341.8,T*21\r\n") != headings(b"$HEHDT,143.8,T*21\r\n") != []


@given(st.integers(0, 3599).map(lambda tenths: tenths / 10), st.integers(0), st.integers(0))
def test_no_two_bit_flips_make_another_heading_pni(heading_deg, first, second):
    frame = bytearray(pni_protocol.encode(5, bytes([1, 5]) + struct.pack(">f", heading_deg)))
    bits = 8 * len(frame)
    for bit in {first % bits, second % bits}:
        frame[bit // 8] ^= 1 << bit % 8
    compass = PniCompass(a_line(bytes(frame), 4096), PniOptions())
    compass.receive(1.0)
    assert first % bits == second % bits or len(compass.poll()) == 0


@given(st.floats(-180.0, 180.0, width=32), st.integers(0), st.integers(1, 255))
def test_no_damage_to_one_byte_makes_another_heading_mti(yaw_deg, place, change):
    """A sum finds any damage to one byte, and of a cut or of two bytes 255 in 256; the rest is left to the ranges."""
    packet = bytearray(mti_protocol.encode(0x36, STATUS_GOOD + struct.pack(">HB3f", 0x2034, 12, 178.0, 1.0, yaw_deg)))
    assert len(mti_headings(bytes(packet))) == 1
    packet[place % len(packet)] ^= change
    assert mti_headings(bytes(packet)) == []


def mti_headings(stream):
    compass = MtiCompass(a_line(stream, 4096), MtiOptions())
    compass.receive(1.0)
    return [sample.heading_rad for sample in compass.poll()]


@given(st.text(max_size=12) | st.from_regex(r"[-+]?[0-9.]{0,12}", fullmatch=True))
@example("0.-6")
def test_a_number_is_what_float_says_or_refused(text):
    try:
        value = to_number(text)
    except MessageError:
        return
    if value is None:
        assert text == ""
    elif ".-" not in text:
        assert value == float(text)
        assert math.isfinite(value)


@pytest.mark.parametrize("kind", sorted(CAPTURE_FORMATS))
@given(data=STREAMS)
def test_any_capture_can_be_decoded(kind, data):
    for result in decode(kind, data):
        assert result["line"] >= 1
        assert format_text(result).isprintable()
