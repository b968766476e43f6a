"""What recorded AIS messages tell, held against two other decoders: pyais, and gpsd's where it is installed."""

import json
import math
import shutil
import subprocess

import pyais
import pytest
from pyais.exceptions import AISBaseException

from firmware_py.common.angles import degrees
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.sensors.ais_messages import reports_of
from firmware_py.sensors.ais_payload import Payload, read_payload
from firmware_py.sensors.ais_sentences import Assembler, SentenceFinder
from firmware_py.sensors.message_error import MessageError
from support.paths import DATA

RECORDINGS = sorted((DATA / "ais").iterdir())
READ = {1, 2, 3, 4, 5, 18, 19, 21, 24, 27}
KNOT = 1852.0 / 3600.0


def messages(path):
    """Yield the sentences of each message of a recording, with its reports or the MessageError."""
    finder, assembler = SentenceFinder(), Assembler()
    for line in path.read_bytes().splitlines(keepends=True):
        for body, checksum in finder.feed(line):
            try:
                message = assembler.add(body, checksum, 0.0)
            except MessageError:
                continue
            if message is None:
                continue
            try:
                payload = read_payload(message.payload, message.fill_bits)
                yield message, payload, () if payload is None else reports_of(payload, 0.0)
            except MessageError as error:
                yield message, None, error


def theirs(message):
    """What pyais reads of the same payload."""
    letters = message.payload.decode()
    sentence = f"AIVDM,1,1,,A,{letters},{message.fill_bits}"
    check = 0
    for byte in sentence.encode():
        check ^= byte
    return pyais.decode(f"!{sentence}*{check:02X}".encode()).asdict()


def known(value, unknown):
    return None if value is None or value in unknown else value


def check_position(ours, expected, kind):
    assert ours.mmsi == int(expected["mmsi"])
    assert degrees(ours.latitude_rad) == pytest.approx(expected["lat"], abs=1e-5)
    assert degrees(ours.longitude_rad) == pytest.approx(expected["lon"], abs=1e-5)
    assert ours.accurate == bool(expected["accuracy"])
    coarse = kind == 27
    speed = known(expected.get("speed"), (63,) if coarse else (102.3,))
    assert ours.speed_m_s == (None if speed is None else pytest.approx(speed * KNOT))
    course = expected.get("course")
    # pyais gives the number as it is; what is no course is none.
    assert ours.course_rad == (
        None if course is None or course >= 360.0 else pytest.approx(math.radians(course), abs=1e-9)
    )
    heading = expected.get("heading")
    assert ours.heading_rad == (None if heading is None or heading >= 360 else pytest.approx(math.radians(heading)))
    assert ours.status == int(expected.get("status", 15))
    turn = expected.get("turn")
    if isinstance(turn, float) and math.isfinite(turn) and ours.turn_rad_s is not None:
        assert degrees(ours.turn_rad_s) * 60.0 == pytest.approx(turn, abs=0.6)  # theirs is rounded


def check_identity(ours, expected):
    """The texts are the same to the first letter that is none; theirs are stripped at both ends."""
    assert ours.mmsi == int(expected["mmsi"])
    name = expected.get("shipname", expected.get("name"))
    if name is not None:
        assert ours.name.strip() == name.partition("@")[0].strip()  # theirs may go on behind the end
    assert ours.call_sign.strip() == expected.get("callsign", "").strip()
    if "ship_type" in expected:
        assert ours.ship_type == expected["ship_type"]
    if ours.dimensions_m is not None:
        assert ours.dimensions_m == tuple(expected[f"to_{side}"] for side in ("bow", "stern", "port", "starboard"))


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name)
def test_recordings_are_read_as_pyais_reads_them(path):
    compared = 0
    for message, payload, reports in messages(path):
        if payload is None and not isinstance(reports, MessageError):
            continue  # of a type that is not read
        try:
            expected = theirs(message)
        except AISBaseException:
            assert isinstance(reports, MessageError)
            continue
        if isinstance(reports, MessageError):
            # The one that is: a place that is none.
            assert abs(expected["lat"]) > 90.0 or abs(expected["lon"]) > 180.0
            continue
        assert expected["msg_type"] == min(payload.message_type, 24) or payload.message_type == expected["msg_type"]
        for report in reports:
            compared += 1
            if isinstance(report, VesselPosition):
                check_position(report, expected, payload.message_type)
            else:
                check_identity(report, expected)
        if "lat" in expected and not any(isinstance(report, VesselPosition) for report in reports):
            assert expected["lat"] == pytest.approx(91.0, abs=0.01) or expected["lon"] == pytest.approx(181.0, abs=0.01)
    assert compared >= 20


def test_the_recordings_hold_every_type():
    kinds = {payload.message_type for path in RECORDINGS for _, payload, _ in messages(path) if payload is not None}
    assert kinds >= READ


@pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="gpsdecode is not installed (Debian: gpsd-clients)")
@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name)
def test_recordings_are_read_as_gpsd_reads_them_to_the_last_bit(path):
    lines = b"".join(line + b"\n" for line in path.read_bytes().splitlines() if line.startswith(b"!"))
    output = subprocess.run(["gpsdecode", "-j", "-u"], input=lines, capture_output=True, check=True).stdout
    expected = {}
    for line in output.splitlines():
        one = json.loads(line)
        if one.get("class") == "AIS" and one["type"] in READ:
            expected.setdefault((one["type"], one["mmsi"], one.get("lon"), one.get("lat")), []).append(one)
    compared = 0
    for _, payload, _ in messages(path):
        if payload is None:
            continue
        ours = {GPSD_NAMES.get(name, name): value for name, value in (payload.numbers | payload.texts).items()}
        candidates = expected.get((min(payload.message_type, 24), payload.mmsi, ours.get("lon"), ours.get("lat")))
        if payload.message_type == 27:
            candidates = expected.get((27, payload.mmsi, ours["lon"], ours["lat"]))
        if not candidates:
            continue  # of a length that gpsd refuses, or the first part of two that it waits for
        shared = [name for name in ours if all(name in one for one in candidates)]
        wanted = {name: ours[name].strip() if isinstance(ours[name], str) else ours[name] for name in shared}
        found = [{name: plain(one[name]) for name in shared} for one in candidates]
        assert wanted in found
        compared += bool(shared)
    assert compared >= 8


GPSD_NAMES = {
    "longitude": "lon",
    "latitude": "lat",
    "accurate": "accuracy",
    "name": "shipname",
    "call_sign": "callsign",
    "ship_type": "shiptype",
}


def plain(value):
    return value.strip() if isinstance(value, str) else int(value)


def payload(kind, mmsi=211000000, **numbers):
    position = {"latitude": 54 * 600_000, "longitude": 10 * 600_000, "accurate": 1}
    return Payload(kind, mmsi, {**position, "speed": 123, "course": 2713, "heading": 270, **numbers}, {})


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
def test_a_number_for_not_available_or_without_a_meaning_is_unknown(numbers, field):
    (report,) = reports_of(payload(1, **numbers), 0.0)
    assert getattr(report, field) is None


def test_a_position_that_is_not_available_is_no_report_and_one_that_is_nowhere_is_refused():
    assert reports_of(payload(1, latitude=91 * 600_000, longitude=181 * 600_000), 0.0) == ()
    for wrong in ({"latitude": 600_000 * 92}, {"longitude": -600_000 * 200}, {"latitude": -(90 * 600_000 + 1)}):
        with pytest.raises(MessageError, match="invalid"):
            reports_of(payload(18, **wrong), 0.0)


@pytest.mark.parametrize("mmsi", [0, 1_000_000_000, (1 << 30) - 1])
def test_a_number_that_no_vessel_has_is_refused(mmsi):
    with pytest.raises(MessageError, match="invalid"):
        reports_of(payload(1, mmsi), 0.0)


def test_the_fastest_speed_is_one_and_a_turn_has_its_side():
    (report,) = reports_of(payload(1, speed=1022, turn=-20), 0.0)
    assert report.speed_m_s == pytest.approx(102.2 * KNOT)
    assert degrees(report.turn_rad_s) * 60.0 == pytest.approx(-((20 / 4.733) ** 2))
    assert (report.kind, report.accurate) == (VesselKind.CLASS_A, True)


def test_the_mother_ship_of_a_craft_is_not_its_size():
    numbers = {"ship_type": 36, "to_bow": 5, "to_stern": 6, "to_port": 1, "to_starboard": 2}
    identities = [
        reports_of(Payload(25, mmsi, numbers, {"call_sign": "AB"}), 0.0)[0] for mmsi in (211000000, 982110000)
    ]
    assert identities == [
        VesselIdentity(0.0, 211000000, "", "AB", 36, (5, 6, 1, 2)),
        VesselIdentity(0.0, 982110000, "", "AB", 36, None),
    ]


@pytest.mark.parametrize("mmsi", [970000001, 972603802, 974001001])
def test_a_distress_beacon_calls_before_it_has_a_position(mmsi):
    nowhere = payload(1, mmsi, latitude=91 * 600_000, longitude=181 * 600_000, status=14)
    assert reports_of(nowhere, 5.0) == (VesselIdentity(5.0, mmsi),)
    (report,) = reports_of(payload(1, mmsi, status=14), 5.0)
    assert report.status == 14
