"""Sensor drivers accept arbitrary bytes, and a damaged message never gives a wrong heading."""

import itertools
import math
import struct
from types import SimpleNamespace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common.records import DeviceHealth
from firmware_py.devices import SECTIONS
from firmware_py.sensors import bno08x_rvc, mavlink_frames, mti_protocol, pni_protocol, rion, ubx_protocol, witmotion
from firmware_py.sensors.mavlink_compass import MavlinkCompass, MavlinkCompassOptions
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.mti import MtiCompass, MtiOptions
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_fields import to_number
from firmware_py.sensors.nmea_framing import NmeaFramer
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions
from support.flight_controller import Board

MAX_BODY_LENGTH = 1024
DATA_RESPONSE = 5  # frame type of the PNI compass
MT_DATA_2, EULER_NED, RATE_OF_TURN = 0x36, 0x2034, 0x8020  # message of the MTi, and data identifiers in it

HDG = b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n"
HDT = b"$HEHDT,341.8,T*21\r\n"
RMC = b"$GPRMC,115631,A,5229.6446,N,00518.6558,E,5.0,78.0,150816,1.0,E,A*24\r\n"
GGA = b"$GNGGA,103607.00,5327.03942,N,00214.42462,W,1,06,5.88,56.0,M,48.5,M,,*64\r\n"
MWV = b"$WIMWV,251.4,R,3.1,N,A*23\r\n"
DPT = b"$IIDPT,4.1,1.0*44\r\n"
RSA = b"$IIRSA,10.5,A,,V*4D\r\n"
PASHR = b"$PASHR,142509.000,179.885,T,-0.624,0.245,,0.029,0.029,0.502,2,3*17\r\n"
# Two components: heading (5) and distortion (8).
PNI = pni_protocol.encode(DATA_RESPONSE, bytes([2, 5]) + struct.pack(">f", 98.5) + bytes([8, 0]))
STATUS_GOOD = bytes.fromhex("E0200400000003")
MTI = mti_protocol.encode(
    MT_DATA_2,
    STATUS_GOOD
    + struct.pack(">HB3f", EULER_NED, 12, 178.0, 1.0, 98.5)
    + struct.pack(">HB3f", RATE_OF_TURN, 12, 0.0, 0.0, -0.1),
)
PVT = bytes.fromhex(
    "b56201075c0030985811e1070713083200370300000027 80ad2f0303 0a0eadeb9d528 9bb31eb50630000df7000006c04000042060000"
    "f6ffffffe4ffffff260000001e000000aa053000e5000000685f0d00910000e0ac4c220000e000e000000080c855".replace(" ", "")
)
BOARD = Board()
MAVLINK = BOARD.heartbeat() * 2 + BOARD.ekf() + BOARD.attitude(98.5)

RVC = bytes.fromhex("AAAADE010092FF25088DFEECFFD103000000E7")  # the example of the data sheet
RION = bytes.fromhex("680D00840020101005250180007C")
RION_LONG, RION_DECLINATION = bytes.fromhex("680E0084001050101005010401001D"), bytes.fromhex("6806008700008D")
WITMOTION_ANGLE, WITMOTION_ANSWER = (
    body + bytes([sum(body) % 256])
    for body in (struct.pack("<BB4h", 0x55, 0x53, 100, -200, 16384, 70), struct.pack("<BB4h", 0x55, 0x5F, 0, 0, 0, 0))
)

# Noise with complete and truncated messages, which reach more states of the parsers than random bytes alone.
MESSAGES = (HDG, HDT, RMC, GGA, RSA, PASHR, MWV, DPT, PNI, MTI, PVT)
MESSAGES += (RION, RION_LONG, RION_DECLINATION, WITMOTION_ANSWER, WITMOTION_ANGLE, WITMOTION_ANSWER + WITMOTION_ANGLE)
MESSAGES += (RVC,)
MESSAGES += (MAVLINK, BOARD.attitude(98.5))
TRUNCATED_MESSAGES = tuple(message[: len(message) * 2 // 3] for message in MESSAGES)
MALFORMED_MESSAGES = (
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
    b"\x68\x0d\x00\x84",
    b"\x55\x53",
    b"\xaa\xaa",
    b"\xaa\xaa" + bytes(17),
    b"\xfd\xff\x01\x00\x00\x01\x01\x1e\x00\x00",
    b"\xfe\x1c\x00\x01\x01\x1e",
    b"\xfd",
)
PIECES = st.sampled_from(MESSAGES + TRUNCATED_MESSAGES + MALFORMED_MESSAGES) | st.binary(max_size=12)
STREAMS = st.lists(PIECES, max_size=16).map(b"".join)


DRIVERS = {
    f"{section} {name}": lambda line, driver=driver: driver.make(line, driver.options())
    for section in ("compass", "position", "power", "wind", "depth", "rudder_angle")
    for name, driver in SECTIONS[section].items()
}
FRAMERS = (
    NmeaFramer,
    *(protocol.create_framer for protocol in (pni_protocol, mti_protocol, ubx_protocol, rion, witmotion, bno08x_rvc)),
    mavlink_frames.create_framer,
)


def byte_line(stream, size):
    """Return a ByteLine that delivers a stream in pieces of `size` bytes."""
    pieces = iter([stream[start : start + size] for start in range(0, len(stream), size)])
    return SimpleNamespace(
        name="line",
        openings=1,
        connected=True,
        fileno=lambda: 7,
        read=lambda: next(pieces, b""),
        write=lambda _data: True,
    )


def test_recorded_packet_is_valid():
    (packet,) = ubx_protocol.create_framer().feed(PVT)
    assert packet.fault == ""


@pytest.mark.parametrize("make", DRIVERS.values(), ids=DRIVERS)
@given(stream=STREAMS | st.binary(max_size=5000), size=st.integers(1, 4096))
def test_drivers_accept_any_bytes_and_give_only_samples_in_range(make, stream, size):
    driver = make(byte_line(stream, size))
    for cycle in range(1 + len(stream) // size):
        driver.receive(cycle * 0.1)
        assert isinstance(driver.health(cycle * 0.1), DeviceHealth)
        for sample in driver.poll():
            for name, limit in (
                ("heading_rad", 2 * math.pi),
                ("latitude_rad", math.pi / 2),
                ("longitude_rad", math.pi),
                ("angle_rad", 2 * math.pi),
                ("wind_m_s", 120.0),
                ("depth_m", 12_100.0),
            ):
                value = getattr(sample, name, None)
                assert value is None or abs(value) <= limit
            assert 0.0 <= getattr(sample, "heading_rad", 0.0) < 2 * math.pi
            assert min(getattr(sample, name, 0.0) for name in ("angle_rad", "wind_m_s", "depth_m")) >= 0.0


@pytest.mark.parametrize("make", FRAMERS)
@given(stream=STREAMS, cuts=st.lists(st.integers(0, 400), max_size=8))
def test_framing_does_not_depend_on_the_pieces(make, stream, cuts):
    undivided = make()
    expected = undivided.feed(stream) + undivided.finish()
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    framer = make()
    messages = [message for start, stop in itertools.pairwise(edges) for message in framer.feed(stream[start:stop])]
    assert messages + framer.finish() == expected


@pytest.mark.parametrize("make", FRAMERS)
@given(
    noise=STREAMS
    | st.sampled_from(
        [
            b"$GPHDT," + b"1" * 9000,
            b"\xb5\x62\x01\x07\xff\x09" * 1500,
            b"\x00\x80\x05" * 3000,
            b"\xfa\xff\x36\xff\x08\x00" * 1500,
            b"\x68\x0d\x00\x84" * 2000,
            b"\x55\x53" * 4000,
            b"\xaa" * 9000,
            b"\xfd\xff\x01\x00\x00\x01\x01\x1e\x00\x00" * 900,
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
    [
        (NmeaFramer, HDT),
        (pni_protocol.create_framer, PNI),
        (ubx_protocol.create_framer, PVT),
        (rion.create_framer, RION),
        (witmotion.create_framer, WITMOTION_ANGLE),
        (bno08x_rvc.create_framer, RVC),
        (mavlink_frames.create_framer, BOARD.attitude(98.5)),
    ],
    ids=["nmea", "pni", "ubx", "rion", "witmotion", "bno08x_rvc", "mavlink"],
)
@given(noise=STREAMS)
def test_valid_message_after_noise_is_decoded(make, message, noise):
    framer = make()
    framer.feed(noise)
    messages = framer.feed(message)
    assert messages
    last = messages[-1]
    assert last.fault == ""
    assert getattr(last, "data", message) == message


@pytest.mark.parametrize("message", [HDG, HDT, PASHR], ids=["HDG", "HDT", "PASHR"])
def test_single_bit_flip_never_gives_a_wrong_heading_nmea(message):
    """The XOR checksum detects an odd number of flips of one bit position.

    It does not detect two flips of one bit position or exchanged characters; the range checks and the estimator have
    to reject these. The line end after the checksum is not tested.
    """
    (good,) = headings(message)
    for bit in range(8 * (len(message) - 2)):
        damaged = bytearray(message)
        damaged[bit // 8] ^= 1 << bit % 8
        # A flip may only change the case of a hexadecimal digit, which keeps the checksum.
        assert headings(bytes(damaged)) in ([], [good]), bit


def headings(stream):
    compass = NmeaCompass(byte_line(stream, 4096), NmeaCompassOptions())
    compass.receive(1.0)
    return [sample.heading_rad for sample in compass.poll()]


def test_xor_checksum_does_not_detect_exchanged_digits():
    assert headings(b"$HEHDT,341.8,T*21\r\n") != headings(b"$HEHDT,143.8,T*21\r\n") != []


@given(st.integers(0, 3599).map(lambda tenths: tenths / 10), st.integers(0), st.integers(0))
def test_two_bit_flips_never_give_a_wrong_heading_pni(heading_deg, first_bit, second_bit):
    frame = bytearray(pni_protocol.encode(DATA_RESPONSE, bytes([1, 5]) + struct.pack(">f", heading_deg)))
    bits = 8 * len(frame)
    for bit in {first_bit % bits, second_bit % bits}:
        frame[bit // 8] ^= 1 << bit % 8
    compass = PniCompass(byte_line(bytes(frame), 4096), PniOptions())
    compass.receive(1.0)
    assert first_bit % bits == second_bit % bits or len(compass.poll()) == 0


@given(st.floats(-180.0, 180.0, width=32), st.integers(0), st.integers(1, 255))
def test_one_damaged_byte_never_gives_a_wrong_heading_mti(yaw_deg, position, change):
    """The sum detects every damage to one byte, but only 255 of 256 damages to two bytes."""
    packet = bytearray(
        mti_protocol.encode(MT_DATA_2, STATUS_GOOD + struct.pack(">HB3f", EULER_NED, 12, 178.0, 1.0, yaw_deg))
    )
    assert len(mti_headings(bytes(packet))) == 1
    packet[position % len(packet)] ^= change
    assert mti_headings(bytes(packet)) == []


def mti_headings(stream):
    compass = MtiCompass(byte_line(stream, 4096), MtiOptions())
    compass.receive(1.0)
    return [sample.heading_rad for sample in compass.poll()]


def rion_headings(packet):
    """Return the headings of a compass that has answered about its declination."""
    pieces = iter([b"", RION, b"", RION_DECLINATION, packet])
    compass = rion.RionCompass(byte_line(b"", 1), rion.RionOptions())
    compass._line.read = lambda: next(pieces, b"")
    for now_s in (0.0, 0.1, 0.6, 0.7, 0.8):
        compass.receive(now_s)
    return [sample.heading_rad for sample in compass.poll()]


@given(st.integers(0, 35999), st.integers(0), st.integers(1, 255))
def test_one_damaged_byte_never_gives_a_wrong_heading_rion(hundredths, position, change):
    """The sum detects every damage to one byte; decimal digits and fixed bytes also most damages to two."""
    packet = bytearray(bytes.fromhex(f"0D0084 001050 101005 {hundredths:06d}"))
    packet = bytearray(b"\x68") + packet + bytes([sum(packet) % 256])
    assert rion_headings(bytes(packet)) == [pytest.approx(math.radians(hundredths / 100), abs=1e-9)]
    packet[position % len(packet)] ^= change
    assert rion_headings(bytes(packet)) == []


def witmotion_headings(stream):
    compass = witmotion.WitmotionCompass(byte_line(stream, 4096), witmotion.WitmotionOptions(algorithm="nine_axis"))
    compass.receive(0.0)
    return [sample.heading_rad for sample in compass.poll()]


@given(st.integers(-32768, 32767), st.integers(0), st.integers(1, 255))
def test_one_damaged_byte_never_gives_a_wrong_heading_witmotion(yaw, position, change):
    body = struct.pack("<BB4h", 0x55, 0x53, 100, -200, yaw, 70)
    packet = bytearray(body + bytes([sum(body) % 256]))
    assert len(witmotion_headings(WITMOTION_ANSWER + bytes(packet))) == 1
    packet[position % len(packet)] ^= change
    assert witmotion_headings(WITMOTION_ANSWER + bytes(packet)) == []


@given(st.lists(st.binary(max_size=40) | st.just(WITMOTION_ANGLE), max_size=20))
def test_noise_between_packets_never_gives_a_heading_witmotion(pieces):
    """A false packet passes the sum once in 256 times, but not directly after another one."""
    stream = b"\x00".join(pieces)
    assert witmotion_headings(stream) == []


@given(st.floats(-180.0, 180.0, width=32), st.integers(0), st.integers(1, 255), st.integers(1, 255))
def test_two_damaged_neighbouring_bytes_never_give_a_wrong_heading_mavlink(heading_deg, position, first, second):
    """A CRC of 16 bits detects each burst of at most 16 bits; the header is checked with it."""
    attitude = bytearray(BOARD.attitude(heading_deg))
    assert len(mavlink_headings(bytes(attitude))) == 1
    start = position % len(attitude)
    attitude[start] ^= first
    if start + 1 < len(attitude):
        attitude[start + 1] ^= second
    assert mavlink_headings(bytes(attitude)) == []


def mavlink_headings(stream):
    """Return the headings of a stream after the selection of the board and a valid status."""
    compass = MavlinkCompass(byte_line(BOARD.heartbeat() * 2 + BOARD.ekf() + stream, 4096), MavlinkCompassOptions())
    compass.receive(1.0)
    return [sample.heading_rad for sample in compass.poll()]


@given(st.text(max_size=12) | st.from_regex(r"[-+]?[0-9.]{0,12}", fullmatch=True))
@example("0.-6")
def test_number_equals_float_or_is_refused(text):
    try:
        value = to_number(text)
    except MessageError:
        return
    if value is None:
        assert text == ""
    elif ".-" not in text:
        assert value == float(text)
        assert math.isfinite(value)
