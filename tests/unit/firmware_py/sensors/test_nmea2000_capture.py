"""`rambler decode nmea2000`: the three forms, and the recordings as the package nmea2000 decodes them."""

import csv
import math

import pytest
from nmea2000.consts import FieldTypes
from nmea2000.decoder import NMEA2000Decoder

from firmware_py.devices import decode
from firmware_py.sensors.nmea2000_table import LAYOUTS
from hil.devices import nmea2000_frames as n2k
from support.paths import DATA

FOLDER = DATA / "nmea2000"
HEADING = n2k.heading(math.radians(98.3), n2k.MAGNETIC, variation_rad=math.radians(-10.0))


def results(data):
    return list(decode("nmea2000", data))


def test_actisense_capture():
    message = n2k.actisense_message(127250, 0x23, HEADING)
    damaged = message[:15] + bytes([message[15] ^ 1]) + message[16:]
    first, error, other = results(b"?" + message + damaged + n2k.actisense_message(127488, 5, bytes(8)))
    assert (first["line"], first["offset"], first["type"], first["pgn"], first["source"]) == (
        1,
        1,
        "heading",
        127250,
        0x23,
    )
    assert (first["message"], first["reference"]) == ("Vessel Heading", 1)
    assert (first["true_deg"], first["heading_deg"]) == (pytest.approx(88.3, abs=0.01), pytest.approx(98.3, abs=0.01))
    assert (error["type"], error["error"], error["line"]) == ("error", "checksum", 2)
    assert (other["type"], other["pgn"], other["source"]) == ("other", 127488, 5)


def test_lines_of_yacht_devices_and_candump():
    raw = n2k.raw_line(127250, 0x23, HEADING) + b"\r\nnonsense\r\n" + n2k.raw_line(127488, 5, bytes(8))
    first, error, other = results(raw)
    assert (first["type"], first["line"], error["line"], error["error"], other["type"]) == (
        "heading",
        1,
        3,
        "malformed",
        "other",
    )
    frames = list(n2k.frames(n2k.gnss_position(50.0, -3.0, 1.6e9), 1))
    lines = [f"(1745600961.335462) can0 {n2k.identifier(129029, 1):08X}#{frame.hex().upper()}\n" for frame in frames]
    (fix,) = results("".join(lines).encode())
    assert (fix["type"], fix["line"], fix["latitude_deg"]) == ("position", 7, pytest.approx(50.0))
    (lost,) = results("".join(lines[:2] + lines[3:]).encode())
    assert (lost["type"], lost["detail"]) == ("error", "incomplete message")


@pytest.mark.parametrize("pgn", LAYOUTS)
def test_every_message_of_the_table_is_decoded(pgn):
    (result,) = results(n2k.actisense_message(pgn, 5, bytes(LAYOUTS[pgn].min_bytes)))
    assert result["message"] == LAYOUTS[pgn].name


@pytest.mark.parametrize(("lines_between", "kind"), [(70, "position"), (80, "error")])
def test_frames_of_a_message_follow_within_75_lines(lines_between, kind):
    first, *others = n2k.frames(n2k.gnss_position(50.0, -3.0, 1.6e9), 1)
    stream = n2k.raw_line(129029, 1, first) + n2k.raw_line(127488, 5, bytes(8)) * lines_between
    stream += b"".join(n2k.raw_line(129029, 1, frame) for frame in others)
    assert [result["type"] for result in results(stream)] == ["other"] * lines_between + [kind]


def test_short_message_and_missing_heading():
    (error,) = results(n2k.actisense_message(127250, 0x23, bytes(3)))
    assert (error["type"], error["detail"]) == ("error", "Vessel Heading: 3 bytes")
    (empty,) = results(n2k.actisense_message(127250, 0x23, n2k.heading(None, n2k.TRUE)))
    assert empty["heading_deg"] is None
    assert "true_deg" not in empty


def camel_case(name):
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)


def agree(result, message):
    """Return the number of values in which a result agrees with the package; fail for a different one."""
    fields = {field.id: field for field in message.fields}
    compared = 0
    for name, value in result.items():
        base = name
        for unit in ("_deg_s", "_m_s", "_deg", "_m", "_s", "_days"):
            base = base.removesuffix(unit) if base == name else base
        field = fields.get(camel_case(base))
        if field is None or name.endswith(("time_s", "_days")) or name == "source":
            continue
        expected = field.value
        if isinstance(value, str):
            assert value == (expected or "").partition("@")[0].strip(), name
        elif field.type == FieldTypes.LOOKUP:
            assert value in (field.raw_value, None), name
        elif value is None:
            assert expected is None or abs(expected) > 900, (name, expected)
        else:
            if name.endswith(("_deg", "_deg_s")) and field.unit_of_measurement in ("rad", "rad/s"):
                expected = math.degrees(expected)
            assert value == pytest.approx(expected, abs=1e-6), name
        compared += 1
    return compared


def by_package(lines):
    decoder = NMEA2000Decoder()
    messages = [decoder.decode(line) for line in lines]
    return [message for message in messages if message is not None]


def test_recorded_lines_agree_with_the_package_nmea2000():
    data = (FOLDER / "canboat_merrimac-ydwg-2020_excerpt.raw").read_bytes()
    ours = [result for result in results(data) if result["type"] not in ("other", "error")]
    pgns = {result["pgn"] for result in ours}
    theirs = [message for message in by_package(data.decode().splitlines()) if message.PGN in pgns]
    assert len(ours) == len(theirs) > 100
    compared = 0
    for result, message in zip(ours, theirs, strict=True):
        assert (result["pgn"], result["source"]) == (message.PGN, message.source)
        compared += agree(result, message)
    assert compared > 400


def test_recorded_bytes_agree_with_the_package_nmea2000():
    data = (FOLDER / "canboat_ydnu-02-raymarine-ev1_excerpt.dle").read_bytes()
    ours = [result for result in results(data) if result["type"] not in ("other", "error")]
    assert {result["pgn"] for result in ours} == {127245, 127250, 127251, 127257}
    bodies = [
        frame[3:].replace(b"\x10\x10", b"\x10") for frame in data[data.index(b"\x10\x02") :].split(b"\x10\x03")[:-1]
    ]
    rows = [(int.from_bytes(body[2:5], "little"), body[6], body[12:-1]) for body in bodies]
    lines = [
        f"2020-01-01T00:00:00.000Z,2,{pgn},{source},255,{len(frame)},{frame.hex(',')}" for pgn, source, frame in rows
    ]
    theirs = [message for message in by_package(lines) if message.PGN in {127245, 127250, 127251, 127257}]
    assert len(ours) == len(theirs) > 150
    assert sum(agree(result, message) for result, message in zip(ours, theirs, strict=True)) > 500


def test_recorded_vessels_agree_with_the_package_nmea2000():
    rows = list(csv.reader((FOLDER / "canboat_susteranna_ais_excerpt.csv").read_text().splitlines()))
    stream = b"".join(
        n2k.actisense_message(int(row[2]), int(row[3]), bytes(int(byte, 16) for byte in row[6:])) for row in rows
    )
    ours = results(stream)
    theirs = by_package([",".join(row) for row in rows])
    assert len(ours) == len(theirs) == len(rows)
    assert sum(agree(result, message) for result, message in zip(ours, theirs, strict=True)) > 500
