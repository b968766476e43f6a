"""NMEA 2000: lost, repeated and exchanged frames and damaged bytes never give a wrong heading or position."""

import math

from hypothesis import given
from hypothesis import strategies as st

from firmware_py.sensors.nmea2000_compass import Nmea2000Compass
from firmware_py.sensors.nmea2000_position import Nmea2000Position
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from hil.devices import nmea2000_frames as n2k
from support.line import FakeLine

VESSEL_HEADING, GNSS_POSITION = 127250, 129029  # PGNs
COMPASS, RECEIVERS = 0x23, (0x10, 0x15)  # source addresses
HEADINGS_RAD = st.floats(0.0, 6.28)
# Latitude and longitude in degrees, at least one of them not near 0.
PLACES = st.tuples(st.floats(-89.0, 89.0), st.floats(-179.0, 179.0)).filter(lambda place: max(map(abs, place)) > 1.0)


def headings_of(stream, name="/dev/bus"):
    line = FakeLine(name=name)
    compass = Nmea2000Compass(line, Nmea2000Options())
    line.inbox += stream
    for cycle in range(1 + len(stream) // 4096):
        compass.receive(cycle * 0.1)
    return [sample.heading_rad for sample in compass.poll()]


def fixes_of(frames):
    """Return the places of the fixes of a receiver that gets CAN frames, 10 ms apart."""
    line = FakeLine(name="tcp:192.0.2.1:1457")
    receiver = Nmea2000Position(line, Nmea2000Options())
    fixes = []
    for number, (pgn, source, frame) in enumerate(frames):
        line.inbox += n2k.raw_line(pgn, source, frame)
        receiver.receive(number * 0.01)
        fixes += receiver.poll()
    return [
        (math.degrees(fix.latitude_rad), math.degrees(fix.longitude_rad))
        for fix in fixes
        if fix.latitude_rad is not None
    ]


@given(HEADINGS_RAD, st.integers(0), st.integers(1, 255), st.booleans())
def test_one_damaged_byte_of_an_actisense_message_gives_no_heading(angle_rad, position, change, is_true):
    """The checksum detects every damage to one byte; a damaged DLE may hide the end of the message."""
    message = n2k.actisense_message(VESSEL_HEADING, COMPASS, n2k.heading(angle_rad, int(not is_true)))
    assert len(headings_of(message)) == 1
    damaged = bytearray(message)
    damaged[position % len(message)] ^= change
    assert headings_of(bytes(damaged)) == []


@given(st.lists(st.binary(max_size=60) | HEADINGS_RAD, max_size=12))
def test_headings_between_any_bytes_are_those_that_were_sent(parts):
    sent, stream = [], b""
    for part in parts:
        if isinstance(part, bytes):
            stream += part + b"\x10\x03"
        else:
            sent.append(part)
            stream += n2k.actisense_message(VESSEL_HEADING, COMPASS, n2k.heading(part, n2k.TRUE))
    received = headings_of(stream)
    assert all(any(abs(heading - angle) < 1e-4 for angle in sent) for heading in received)
    assert len(received) == len(sent)


@given(st.lists(HEADINGS_RAD, min_size=1, max_size=12), st.data())
def test_lines_with_lost_bytes_give_only_headings_that_were_sent(angles_rad, data):
    """A text line has no checksum: bytes that are lost within it make it too short."""
    lines = b"".join(n2k.raw_line(VESSEL_HEADING, COMPASS, n2k.heading(angle, n2k.TRUE)) for angle in angles_rad)
    start = data.draw(st.integers(0, len(lines) - 1))
    stop = start + data.draw(st.integers(1, 40))
    received = headings_of(lines[:start] + lines[stop:], "udp:2000")
    assert all(any(abs(heading - angle) < 1e-4 for angle in angles_rad) for heading in received)


@given(
    st.lists(PLACES, min_size=1, max_size=5),
    st.lists(st.tuples(st.sampled_from(["lose", "repeat", "exchange"]), st.integers(0)), max_size=6),
)
def test_lost_repeated_and_exchanged_frames_never_give_a_wrong_position(places, faults):
    """Each message has another sequence number; the number repeats after eight messages."""
    frames = [
        (GNSS_POSITION, source, frame)
        for number, place in enumerate(places)
        for source in RECEIVERS
        for frame in n2k.frames(n2k.gnss_position(*place, 1.6e9 + number), number + source)
    ]
    for fault, position in faults:
        index = position % len(frames)
        if fault == "lose" and len(frames) > 1:
            del frames[index]
        elif fault == "repeat":
            frames.insert(index, frames[index])
        else:
            frames[index - 1], frames[index] = frames[index], frames[index - 1]
    for fix in fixes_of(frames):
        assert any(math.dist(fix, place) < 1e-9 for place in places)


@given(st.permutations(range(14)))
def test_frames_of_two_sources_in_any_order_give_only_whole_messages(order):
    places = dict(zip(RECEIVERS, ((50.0, -3.0), (-20.0, 130.0)), strict=True))
    frames = [
        (GNSS_POSITION, source, frame)
        for source, place in places.items()
        for frame in n2k.frames(n2k.gnss_position(*place, 1.6e9), 1)
    ]
    for fix in fixes_of([frames[index] for index in order]):
        assert any(math.dist(fix, place) < 1e-9 for place in places.values())
