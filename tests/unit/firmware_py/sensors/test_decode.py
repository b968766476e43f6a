"""`decode`: every value of the recordings, the keys of the results, and invalid messages."""

import json
import re

import pytest

from firmware_py.devices import CAPTURE_FORMATS, decode
from firmware_py.sensors.decode import format_text
from support.paths import DATA

NMEA_FILES = sorted(path.name for path in (DATA / "nmea").glob("*.*")) or ["tests/data/nmea is missing"]
METRES_PER_SECOND = {"N": 1852 / 3600, "K": 1 / 3.6, "M": 1.0}

# Names in the expected files: name in the results, and factor to its unit.
RESULT_NAMES = {
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
    """Return the values of an expected file with the names and units of the results."""
    values = dict(values)
    converted = {}
    if "wind_speed" in values:
        converted["wind_speed_m_s"] = values.pop("wind_speed") * METRES_PER_SECOND[values["unit"]]
    values.pop("unit", None)
    if isinstance(values.get("status"), list):
        values["status"] = values["status"][0]
    for name, value in values.items():
        result_name, factor = RESULT_NAMES[name]
        converted[result_name] = value if value is None or factor is None else value * factor
    return converted


@pytest.mark.parametrize("name", NMEA_FILES)
def test_recordings_give_the_expected_values(recordings, name):
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
    # Headings and errors occur only in the expected lines.
    keys = {"heading_true_deg", "heading_magnetic_deg", "heading_mag_deg"}
    headings = [result["line"] for result in results if keys & result.keys()]
    assert headings == [row[0] for row in expected["values"] if len(row) > 3 and keys & row[3].keys()]
    errors = [result["line"] for result in results if result["type"] == "error"]
    assert errors == sorted(expected["bad_checksum_lines"] + expected["no_checksum_lines"])


@pytest.mark.parametrize("name", ["avnav_20160815_excerpt.nmea", "gpsd_bundg_zeus_9.nmea"])
def test_rudder_angles_of_plotters_have_the_right_sign(recordings, name):
    data = (recordings / "nmea" / name).read_bytes()
    texts = re.findall(rb",(-?[0-9]+\.)(-?)([0-9]+),D,RUDDER\*", data)
    expected = [
        float(whole + digits) * (-1 if minus and not whole.startswith(b"-") else 1) for whole, minus, digits in texts
    ]
    angles_deg = [result["rudder_deg"] for result in decode("nmea", data) if "rudder_deg" in result]
    assert angles_deg == pytest.approx(expected)
    assert len(angles_deg) > 100
    assert min(angles_deg) < 0.0 < max(angles_deg)


def test_ubx_results(ubx, solution):
    valid, other, no_fix = decode("ubx", solution() + ubx(0x0120, bytes(16)) + solution(fix_type=0))
    assert (valid["type"], valid["lat_deg"], valid["lon_deg"]) == ("position", -34.9062263, 138.6081197)
    assert (valid["fix"], no_fix["fix"], no_fix["lat_deg"]) == ("FIX_3D", "NONE", None)
    assert (other["type"], other["message"]) == ("other", "01-20")


def test_ubx_recording_has_errors_only_at_its_ends(recordings):
    data = (recordings / "ubx" / "gpsd_ublox-neo-m8n.log").read_bytes()
    results = list(decode("ubx", data))
    # The file begins with a comment, and its last packet is truncated.
    errors = [(result["offset"], result["error"]) for result in results if result["type"] == "error"]
    assert errors == [(0, "malformed"), (data.rindex(b"\xb5\x62"), "checksum")]
    assert results[0]["bytes"] == data.index(b"\xb5\x62")


@pytest.mark.parametrize("kind", CAPTURE_FORMATS)
def test_results_can_be_written_as_json_and_as_one_line(recordings, kind):
    data = b"".join(path.read_bytes() for path in sorted((recordings / "nmea").glob("pynmeagps_*.log")))
    for result in decode(kind, data):
        assert json.loads(json.dumps(result, allow_nan=False)) == result
        assert "\n" not in format_text(result)


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"$GNFOO,,*4F\r\n", "line 1: other GNFOO"),
        (b"$GPHDT,,*4F\r\n", "line 1: heading GPHDT heading_true_deg -"),
        (b"$GPROT,35.6,A*01\r\n", "line 1: turn_rate GPROT turn_rate_deg_min 35.6, status A"),
        (b"$HEHDT,400,T*35\r\n", "line 1: error HEHDT range (HEHDT: heading_true_deg 400 out of range)"),
    ],
)  # fmt: skip
def test_text_of_results(raw, text):
    assert [format_text(result) for result in decode("nmea", raw)] == [text]


def test_unknown_format_is_rejected_with_the_known_ones():
    with pytest.raises(ValueError, match=r"nmea, pni, mti, .*ubx"):
        decode("seatalk", b"")
