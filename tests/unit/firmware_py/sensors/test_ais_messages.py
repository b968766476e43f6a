"""Decoding of AIS messages: recordings compared with pyais and, if installed, gpsd; limits of single values."""

import json
import math
import shutil
import subprocess

import pyais
import pytest
from pyais.exceptions import AISBaseException

from firmware_py.common.angles import degrees
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.sensors.ais_messages import decode_reports
from firmware_py.sensors.ais_payload import TYPE_24_PART_B, Payload, read_payload
from firmware_py.sensors.ais_sentences import Assembler, SentenceFinder
from firmware_py.sensors.message_error import MessageError
from support.paths import DATA

RECORDINGS = sorted((DATA / "ais").iterdir())
DECODED_TYPES = {1, 2, 3, 4, 5, 18, 19, 21, 24, 27}
KNOT = 1852.0 / 3600.0


def messages(path):
    """Yield each message of a recording with its payload, and its reports or the MessageError."""
    finder, assembler = SentenceFinder(), Assembler()
    for body, checksum in finder.feed(path.read_bytes()):
        try:
            message = assembler.add(body, checksum, 0.0)
        except MessageError:
            continue
        if message is None:
            continue
        try:
            payload = read_payload(message.payload, message.fill_bits)
            yield message, payload, () if payload is None else decode_reports(payload, 0.0)
        except MessageError as error:
            yield message, None, error


def decode_with_pyais(message):
    sentence = f"AIVDM,1,1,,A,{message.payload.decode()},{message.fill_bits}"
    checksum = 0
    for byte in sentence.encode():
        checksum ^= byte
    return pyais.decode(f"!{sentence}*{checksum:02X}".encode()).asdict()


def check_position(report, expected, message_type):
    assert degrees(report.latitude_rad) == pytest.approx(expected["lat"], abs=1e-5)
    assert degrees(report.longitude_rad) == pytest.approx(expected["lon"], abs=1e-5)
    assert report.accurate == bool(expected["accuracy"])
    speed, course, heading = (expected.get(name) for name in ("speed", "course", "heading"))
    has_speed = speed is not None and speed != (63 if message_type == 27 else 102.3)
    assert report.speed_m_s == (pytest.approx(speed * KNOT) if has_speed else None)
    # pyais does not check the range of the course.
    has_course = course is not None and course < 360.0
    assert report.course_rad == (pytest.approx(math.radians(course), abs=1e-9) if has_course else None)
    has_heading = heading is not None and heading < 360
    assert report.heading_rad == (pytest.approx(math.radians(heading)) if has_heading else None)
    assert report.status == int(expected.get("status", 15))
    turn = expected.get("turn")
    if isinstance(turn, float) and math.isfinite(turn) and report.turn_rad_s is not None:
        assert degrees(report.turn_rad_s) * 60.0 == pytest.approx(turn, abs=0.6)  # pyais rounds


def check_identity(report, expected):
    name = expected.get("shipname", expected.get("name"))
    if name is not None:
        assert report.name.strip() == name.partition("@")[0].strip()  # pyais continues after the end of the text
    assert report.call_sign.strip() == expected.get("callsign", "").strip()
    if "ship_type" in expected:
        assert report.ship_type == expected["ship_type"]
    if report.dimensions_m is not None:
        assert report.dimensions_m == tuple(expected[f"to_{side}"] for side in ("bow", "stern", "port", "starboard"))


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name)
def test_recordings_are_decoded_as_by_pyais(path):
    compared = 0
    for message, payload, reports in messages(path):
        if payload is None and not isinstance(reports, MessageError):
            continue  # the type is not decoded
        try:
            expected = decode_with_pyais(message)
        except AISBaseException:
            assert isinstance(reports, MessageError)
            continue
        if isinstance(reports, MessageError):
            assert abs(expected["lat"]) > 90.0 or abs(expected["lon"]) > 180.0
            continue
        assert expected["msg_type"] in {payload.message_type, min(payload.message_type, 24)}
        for report in reports:
            compared += 1
            assert report.mmsi == int(expected["mmsi"])
            if isinstance(report, VesselPosition):
                check_position(report, expected, payload.message_type)
            else:
                check_identity(report, expected)
        if "lat" in expected and not any(isinstance(report, VesselPosition) for report in reports):
            assert expected["lat"] == pytest.approx(91.0, abs=0.01) or expected["lon"] == pytest.approx(181.0, abs=0.01)
    assert compared >= 20


def encoded_reports(**values):
    """Encode a message with pyais; return its reports."""
    finder, assembler = SentenceFinder(), Assembler()
    stream = "\r\n".join(pyais.encode_dict({"mmsi": 211000001, **values})).encode()
    messages = [assembler.add(*sentence, 0.0) for sentence in finder.feed(stream)]
    return decode_reports(read_payload(messages[-1].payload, messages[-1].fill_bits), 0.0)


@pytest.mark.parametrize("message_type", [1, 4, 18, 19, 21, 27])
def test_south_west_and_port_are_negative_and_other_numbers_are_not(message_type):
    place, motion = {"lat": -33.5, "lon": -71.25}, {"speed": 60.0, "course": 350.0, "heading": 300, "turn": -10}
    report = encoded_reports(msg_type=message_type, **place, **motion, status=11, accuracy=1)[0]
    assert (degrees(report.latitude_rad), degrees(report.longitude_rad)) == pytest.approx((-33.5, -71.25))
    has_motion, has_heading = message_type not in {4, 21}, message_type in {1, 18, 19}
    assert report.speed_m_s == (pytest.approx(60.0 * KNOT) if has_motion else None)
    assert report.course_rad == (pytest.approx(math.radians(350.0)) if has_motion else None)
    assert report.heading_rad == (pytest.approx(math.radians(300.0)) if has_heading else None)
    assert (report.status, report.accurate) == (11 if message_type in {1, 27} else 15, True)
    assert report.turn_rad_s is None if message_type != 1 else report.turn_rad_s < 0.0


@pytest.mark.parametrize(
    ("message", "ship_type"),
    [
        ({"msg_type": 5, "ship_type": 99, "shipname": "ANNA", "callsign": "DA1"}, 99),
        ({"msg_type": 19, "ship_type": 99, "shipname": "ANNA"}, 99),
        ({"msg_type": 21, "aid_type": 20, "name": "ANNA"}, 20),
        ({"msg_type": 24, "partno": 1, "ship_type": 200, "callsign": "DA1"}, 200),
    ],
)
def test_largest_dimensions_and_types_are_positive(message, ship_type):
    identity = encoded_reports(**message, to_bow=300, to_stern=510, to_port=40, to_starboard=62)[-1]
    has_name, has_call_sign = message["msg_type"] != 24, "callsign" in message
    expected = ("ANNA" if has_name else "", "DA1" if has_call_sign else "", ship_type, (300, 510, 40, 62))
    assert (identity.name, identity.call_sign, identity.ship_type, identity.dimensions_m) == expected


def test_recordings_contain_every_decoded_type():
    types = {payload.message_type for path in RECORDINGS for _, payload, _ in messages(path) if payload is not None}
    assert types >= DECODED_TYPES


GPSD_NAMES = {
    "longitude": "lon",
    "latitude": "lat",
    "accurate": "accuracy",
    "name": "shipname",
    "call_sign": "callsign",
    "ship_type": "shiptype",
}


def normalise(value):
    return value.strip() if isinstance(value, str) else int(value)


@pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="gpsdecode is not installed (Debian: gpsd-clients)")
@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name)
def test_recordings_are_decoded_as_by_gpsd(path):
    lines = b"".join(line + b"\n" for line in path.read_bytes().splitlines() if line.startswith(b"!"))
    output = subprocess.run(["gpsdecode", "-j", "-u"], input=lines, capture_output=True, check=True).stdout
    expected = {}
    for message in map(json.loads, output.splitlines()):
        if message.get("class") == "AIS" and message["type"] in DECODED_TYPES:
            key = (message["type"], message["mmsi"], message.get("lon"), message.get("lat"))
            expected.setdefault(key, []).append(message)
    compared = 0
    for _, payload, _ in messages(path):
        if payload is None:
            continue
        values = {GPSD_NAMES.get(name, name): value for name, value in (payload.numbers | payload.texts).items()}
        message_type = 27 if payload.message_type == 27 else min(payload.message_type, 24)
        candidates = expected.get((message_type, payload.mmsi, values.get("lon"), values.get("lat")))
        if not candidates:
            continue  # gpsd rejects the length, or waits for the second part
        shared = [name for name in values if all(name in candidate for candidate in candidates)]
        assert {name: normalise(values[name]) for name in shared} in [
            {name: normalise(candidate[name]) for name in shared} for candidate in candidates
        ]
        compared += bool(shared)
    assert compared >= 8


def payload(message_type, mmsi=211000000, **numbers):
    """Return a payload with numbers in the units of the protocol: 1/600000 deg, 0.1 knots, 0.1 deg, heading in deg."""
    position = {"latitude": 54 * 600_000, "longitude": 10 * 600_000, "accurate": 1}
    return Payload(message_type, mmsi, {**position, "speed": 123, "course": 2713, "heading": 270, **numbers}, {})


@pytest.mark.parametrize(
    ("numbers", "field"),
    [
        ({"speed": 1023}, "speed_m_s"),
        ({"course": 3600}, "course_rad"),
        ({"course": 4095}, "course_rad"),
        ({"heading": 511}, "heading_rad"),
        ({"heading": 360}, "heading_rad"),
        ({"turn": -128}, "turn_rad_s"),
        ({"turn": 127}, "turn_rad_s"),
    ],
)
def test_unavailable_and_undefined_numbers_become_none(numbers, field):
    (report,) = decode_reports(payload(1, **numbers), 0.0)
    assert getattr(report, field) is None


def test_largest_valid_speed_and_sign_of_the_turn():
    (report,) = decode_reports(payload(1, speed=1022, turn=-20), 0.0)
    assert report.speed_m_s == pytest.approx(102.2 * KNOT)
    assert degrees(report.turn_rad_s) * 60.0 == pytest.approx(-((20 / 4.733) ** 2))
    assert (report.kind, report.accurate) == (VesselKind.CLASS_A, True)


@pytest.mark.parametrize(
    ("speed", "course", "speed_kn", "course_deg"),
    [(62, 359, 62.0, 359.0), (63, 360, None, None), (63, 511, None, None)],
)
def test_speed_and_course_of_type_27_are_in_knots_and_degrees(speed, course, speed_kn, course_deg):
    (report,) = decode_reports(payload(27, latitude=54 * 600, longitude=10 * 600, speed=speed, course=course), 0.0)
    assert report.speed_m_s == (None if speed_kn is None else pytest.approx(speed_kn * KNOT))
    assert report.course_rad == (None if course_deg is None else pytest.approx(math.radians(course_deg)))


def test_length_of_a_payload_is_limited():
    assert [read_payload(b"0" * count, 0) for count in (0, 7, 310)] == [None] * 3  # type 0 is not decoded
    for count in (6, 311):
        with pytest.raises(MessageError, match="length"):
            read_payload(b"0" * count, 0)


@pytest.mark.parametrize(
    "invalid",
    [
        *(payload(18, latitude=latitude) for latitude in (90 * 600_000 + 1, -(90 * 600_000 + 1))),
        *(payload(18, longitude=side * (180 * 600_000 + 1)) for side in (1, -1)),
        *(payload(1, mmsi) for mmsi in (0, 1_000_000_000, (1 << 30) - 1)),
    ],
)
def test_impossible_position_or_mmsi_is_rejected(invalid):
    with pytest.raises(MessageError, match="invalid"):
        decode_reports(invalid, 0.0)


def test_dimensions_of_an_auxiliary_craft_are_unknown():
    numbers = {"ship_type": 36, "to_bow": 5, "to_stern": 6, "to_port": 1, "to_starboard": 2}
    for mmsi, dimensions_m in ((211000000, (5, 6, 1, 2)), (982110000, None)):
        (identity,) = decode_reports(Payload(TYPE_24_PART_B, mmsi, numbers, {"call_sign": "AB"}), 0.0)
        assert identity == VesselIdentity(0.0, mmsi, "", "AB", 36, dimensions_m)


def test_message_without_a_position_is_no_report_except_of_a_distress_beacon():
    unavailable = {"latitude": 91 * 600_000, "longitude": 181 * 600_000}
    assert decode_reports(payload(1, **unavailable), 0.0) == ()
    for name, value in unavailable.items():
        assert decode_reports(payload(1, **{name: value}), 0.0) == ()
    for mmsi in (970000001, 972603802, 974001001):
        assert decode_reports(payload(1, mmsi, **unavailable, status=14), 5.0) == (VesselIdentity(5.0, mmsi),)
        (report,) = decode_reports(payload(1, mmsi, status=14), 5.0)
        assert report.status == 14


def coded(message_type, bits, part=0):
    """Return the payload of a message of zeros with this number of bits, and its number of fill bits."""
    fill_bits = -bits % 6
    number = (message_type << (bits - 6) | part << (bits - 40)) << fill_bits
    values = [number >> shift & 63 for shift in range(bits + fill_bits - 6, -1, -6)]
    return bytes(value + 48 if value < 40 else value + 56 for value in values), fill_bits


@pytest.mark.parametrize(
    ("message_type", "part", "min_bits", "max_bits"),
    [
        *((number, 0, 149, 174) for number in (1, 2, 3, 4)), (5, 0, 420, 426), (18, 0, 148, 174), (19, 0, 301, 318),
        (21, 0, 268, 400), (24, 0, 160, 312), (24, 1, 162, 312), (27, 0, 94, 168),
    ],
)  # fmt: skip
def test_length_of_a_message_is_that_of_its_type(message_type, part, min_bits, max_bits):
    for bits in (min_bits, max_bits):
        assert read_payload(*coded(message_type, bits, part)).message_type == message_type + part
    for bits in (min_bits - 1, max_bits + 1):
        with pytest.raises(MessageError, match=f"{bits} bits for a message of type {message_type}"):
            read_payload(*coded(message_type, bits, part))


def test_part_of_type_24_that_does_not_exist_is_no_message():
    assert read_payload(*coded(24, 168, 2)) is None
    assert read_payload(*coded(25, 168)) is None


@pytest.mark.parametrize(
    ("number", "deg_min"), [(126, 708.7), (-126, -708.7), (127, None), (-127, None), (-128, None), (0, 0.0)]
)
def test_turn_is_a_square_and_unknown_if_only_its_direction_is_sent(number, deg_min):
    (report,) = decode_reports(payload(1, turn=number), 0.0)
    expected = None if deg_min is None else pytest.approx(math.radians(deg_min / 60.0), rel=1e-4)
    assert report.turn_rad_s == expected


def test_largest_mmsi_is_accepted():
    assert decode_reports(payload(1, 999_999_999), 0.0)[0].mmsi == 999_999_999
