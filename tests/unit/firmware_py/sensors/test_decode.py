"""`decode` on every recording, value by value, and on what is refused."""

import json
import math
import re

import pytest

from firmware_py.devices import CAPTURE_FORMATS, decode
from firmware_py.sensors.decode import format_text
from support.paths import DATA

NMEA_FILES = sorted(path.name for path in (DATA / "nmea").glob("*.*")) or ["tests/data/nmea is not here"]
METRES_PER_SECOND = {"N": 1852 / 3600, "K": 1 / 3.6, "M": 1.0}

# Names of the expected files: our name, and the factor to it.
NAMES = {
    "sensor_deg": ("sensor_deg", 1.0),
    "deviation_deg": ("deviation_deg", 1.0),
    "variation_deg": ("variation_deg", 1.0),
    "heading_mag_deg": ("heading_magnetic_deg", 1.0),
    "heading_true_deg": ("heading_true_deg", 1.0),
    "rot_deg_min": ("turn_rate_deg_min", 1.0),
    "roll_deg": ("roll_deg", 1.0),
    "pitch_deg": ("pitch_deg", 1.0),
    "heave_m": ("heave_m", 1.0),
    "lat": ("lat_deg", 1.0),
    "lon": ("lon_deg", 1.0),
    "quality": ("quality", 1.0),
    "status": ("status", None),
    "sog_kn": ("sog_m_s", 1852 / 3600),
    "stw_kn": ("water_speed_m_s", 1852 / 3600),
    "cog_deg": ("cog_deg", 1.0),
    "cog_true_deg": ("cog_deg", 1.0),
    "wind_angle_deg": ("wind_angle_deg", 1.0),
    "ref": ("reference", None),
    "xte": ("cross_track_m", 1852.0),
    "dir": ("steer_to", None),
    "heading_to_steer_deg": ("heading_to_steer_deg", 1.0),
    "steer_ref": ("reference", None),
}


def expected_values(values):
    """The values of an expected file under our names and in our units."""
    values = dict(values)
    found = {}
    if "wind_speed" in values:
        found["wind_speed_m_s"] = values.pop("wind_speed") * METRES_PER_SECOND[values["unit"]]
    values.pop("unit", None)
    if isinstance(values.get("status"), list):
        values["status"] = values["status"][0]
    for name, value in values.items():
        ours, factor = NAMES[name]
        found[ours] = value if value is None or factor is None else value * factor
    return found


@pytest.mark.parametrize("name", NMEA_FILES)
def test_every_value_of_every_recording(recordings, name):
    expected = json.loads((recordings / "nmea" / "expected" / f"{name}.json").read_text())
    results = list(decode("nmea", (recordings / "nmea" / name).read_bytes()))
    assert len(results) == expected["sentences"]
    by_line = {result["line"]: result for result in results}
    assert len(by_line) == len(results)
    compared = 0
    for line, sentence, checksum, *values in expected["values"]:
        result = by_line[line]
        assert result["sentence"] == sentence
        assert (result["type"] == "error") == (checksum != 1)
        for key, value in expected_values(values[0] if values else {}).items():
            assert key in result, (line, key)
            if isinstance(value, float):
                assert result[key] == pytest.approx(value, abs=1e-7), (line, key)
            else:
                assert result[key] == value, (line, key)
            compared += 1
    assert compared or not any(len(row) > 3 for row in expected["values"])
    # And nothing else: what states a heading here states one there, and the refused are the refused there.
    keys = {"heading_true_deg", "heading_magnetic_deg", "heading_mag_deg"}
    headings = [result["line"] for result in results if keys & result.keys()]
    assert headings == [row[0] for row in expected["values"] if len(row) > 3 and keys & row[3].keys()]
    errors = [result["line"] for result in results if result["type"] == "error"]
    assert errors == sorted(expected["bad_checksum_lines"] + expected["no_checksum_lines"])


@pytest.mark.parametrize("name", ["avnav_20160815_excerpt.nmea", "gpsd_bundg_zeus_9.nmea"])
def test_every_rudder_angle_of_the_plotters(recordings, name):
    data = (recordings / "nmea" / name).read_bytes()
    written = re.findall(rb",(-?[0-9]+\.)(-?)([0-9]+),D,RUDDER\*", data)
    expected = [
        float(whole + digits) * (-1 if minus and not whole.startswith(b"-") else 1) for whole, minus, digits in written
    ]
    found = [result["rudder_deg"] for result in decode("nmea", data) if "rudder_deg" in result]
    assert found == pytest.approx(expected)
    assert len(found) > 100
    assert min(found) < 0.0 < max(found)


@pytest.mark.parametrize(
    ("raw", "result"),
    [
        (b"$HEHDT,341.8,T*21\r\n", {"line": 1, "type": "heading", "sentence": "HEHDT", "heading_true_deg": 341.8,
                                    "true_deg": 341.8}),
        (b"\n$GPHDT,,*4F", {"line": 2, "type": "heading", "sentence": "GPHDT", "heading_true_deg": None,
                            "true_deg": None}),
        (b"$IIHDM,70.6,M*13", {"line": 1, "type": "heading", "sentence": "IIHDM", "heading_magnetic_deg": 70.6,
                               "magnetic_deg": 70.6}),
        (b"$HEHDT,341.9,T*21\r\n", {"line": 1, "type": "error", "error": "checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,341.8,T\r\n", {"line": 1, "type": "error", "error": "no checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,341.8,T", {"line": 1, "type": "error", "error": "no checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,34\0", {"line": 1, "type": "error", "error": "malformed", "sentence": "HEHDT"}),
        (b"$GNFOO,,*4F\r\n", {"line": 1, "type": "other", "sentence": "GNFOO"}),
        (b"$GPROT,35.6,A*01\r\n", {"line": 1, "type": "turn_rate", "sentence": "GPROT", "turn_rate_deg_min": 35.6,
                                   "status": "A"}),
    ],
)  # fmt: skip
def test_results_are_as_the_contract_says(raw, result):
    assert list(decode("nmea", raw)) == [result]


def test_an_unknown_transducer_is_reported_once(nmea):
    results = list(decode("nmea", nmea("SDXDR,C,23.1,C,WTHI,A,1.0,D,ROLL") * 3 + nmea("SDXDR,C,1.0,C,WTLO")))
    assert [result.get("unknown") for result in results] == [
        "WTHI (type C, unit C)",
        None,
        None,
        "WTLO (type C, unit C)",
    ]
    assert [result.get("roll_deg") for result in results] == [1.0, 1.0, 1.0, None]


def test_a_sentence_without_a_use_is_named_as_such(nmea):
    answer, unheard_of = decode("nmea", nmea("PAMTR,EN,1,1") + nmea("GPABC,1"))
    assert (answer["type"], answer["detail"]) == ("other", "commands to an Airmar instrument and its replies: not used")
    assert unheard_of == {"line": 2, "type": "other", "sentence": "GPABC"}


def test_a_value_out_of_range_is_an_error_with_a_detail(nmea):
    (result,) = decode("nmea", nmea("HEHDT,400,T"))
    assert (result["error"], result["detail"]) == ("range", "HEHDT: heading_true_deg 400 out of range")
    assert format_text(result) == "line 1: error HEHDT range (HEHDT: heading_true_deg 400 out of range)"


def test_pni(pni, pni_heading):
    capture = (
        pni(2, b"TCM51208") + pni_heading(98.5) + b"junk" + pni_heading(math.nan) + pni(19) + pni_heading(1.0)[:-1]
    )
    results = list(decode("pni", capture))
    assert results == [
        {"line": 1, "offset": 0, "type": "module_info", "frame_id": 2, "module": "TCM51208"},
        {"line": 2, "offset": 13, "type": "heading", "frame_id": 5, "heading_magnetic_deg": 98.5, "pitch_deg": 1.5,
         "roll_deg": -2.5, "temperature_c": 18.0, "distortion": False, "magnetic_deg": 98.5},
        {"line": 3, "offset": 41, "type": "error", "error": "malformed", "bytes": 4},
        {"line": 4, "offset": 45, "type": "error", "error": "range", "detail": "heading nan out of range"},
        {"line": 5, "offset": 73, "type": "other", "frame_id": 19},
        {"line": 6, "offset": 78, "type": "error", "error": "checksum", "bytes": 27},
    ]  # fmt: skip


def test_ubx(ubx, solution):
    results = list(decode("ubx", solution() + ubx(0x0120, bytes(16)) + solution(fix_type=0)))
    assert [result["type"] for result in results] == ["position", "other", "position"]
    assert (results[0]["lat_deg"], results[0]["lon_deg"], results[0]["fix"]) == (-34.9062263, 138.6081197, "FIX_3D")
    assert results[1]["message"] == "01-20"
    assert (results[2]["lat_deg"], results[2]["fix"]) == (None, "NONE")


def test_a_ubx_recording_whole(recordings):
    data = (recordings / "ubx" / "gpsd_ublox-neo-m8n.log").read_bytes()
    results = list(decode("ubx", data))
    # The comment at its head is not UBX, its last packet is cut, and between them there is nothing but packets.
    errors = [(result["offset"], result["error"]) for result in results if result["type"] == "error"]
    assert errors == [(0, "malformed"), (data.rindex(b"\xb5\x62"), "checksum")]
    assert results[0]["bytes"] == data.index(b"\xb5\x62")


@pytest.mark.parametrize("kind", CAPTURE_FORMATS)
def test_every_result_is_one_line_of_json_and_of_text(recordings, kind):
    data = b"".join(path.read_bytes() for path in sorted((recordings / "nmea").glob("pynmeagps_*.log")))
    for result in decode(kind, data):
        assert json.loads(json.dumps(result, allow_nan=False)) == result
        assert "\n" not in format_text(result)


def test_text_for_people():
    texts = [format_text(result) for result in decode("nmea", b"$IIHDG,70.6,,,,W*2F\r\n$GNFOO,,*4F\r\n")]
    assert texts == [
        (
            "line 1: heading IIHDG sensor_deg 70.6, deviation_deg -, variation_deg -, heading_magnetic_deg 70.6, "
            "heading_true_deg -"
        ),
        "line 2: other GNFOO",
    ]


def test_an_unknown_kind_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="nmea, pni, mti, ubx"):
        decode("seatalk", b"")
