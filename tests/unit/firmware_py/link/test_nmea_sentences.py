"""Sentences of the NMEA 0183 output, read by pynmea2 and pynmeagps."""

import math

import msgspec
import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Activity, MissionReport, MissionState, Navigation, Water
from firmware_py.link.nmea import TABLE, NmeaData, sentences
from support.link import SNAPSHOT

MAX_SENTENCE_BYTES = 82

UTC_S = 1_793_491_201.25  # 2026-11-01 00:00:01.25
FIX = PositionSample(
    0.0, FixType.FIX_3D, math.radians(-33.5), math.radians(151.25), 12.5, 0.5, math.radians(270.0), 8, 1.2, UTC_S
)
LINE = {
    "navigation": Navigation(Activity.LINE, 0.1, 0.2, None, cross_track_m=185.2),
    "bearing_rad": math.radians(80.0),
    "distance_m": 370.4,
    "mission": MissionReport(MissionState.ACTIVE, 6, 9),
}


def make_data(declination_deg=-12.3, utc_s=UTC_S, **changes):
    changes = {"position": FIX, "position_ok": True, "heading_rad": math.radians(350.0), **changes}
    return NmeaData(msgspec.structs.replace(SNAPSHOT, **changes), utc_s, math.radians(declination_deg))


def parsed(name, **changes):
    """Return a sentence as parsed by pynmea2; pynmeagps must parse it too. None without a sentence."""
    found = sentences(make_data(**changes), [name])
    if not found:
        return None
    NMEAReader.parse(found[0], validate=1)
    return pynmea2.parse(found[0].decode("ascii"), check=True)


def test_heading_sentences_are_true_and_magnetic():
    assert parsed("HDT").data == ["350.0", "T"]
    assert parsed("HDG").data == ["2.3", "", "", "12.3", "W"]
    assert parsed("HDG", declination_deg=5.0).data == ["345.0", "", "", "5.0", "E"]
    assert parsed("HDG", declination_deg=0.0).data == ["350.0", "", "", "0.0", "E"]
    assert parsed("ROT", yaw_rate_rad_s=math.radians(-0.5)).data == ["-30.0", "A"]
    assert parsed("ROT", yaw_rate_rad_s=-1e-6).data == ["0.0", "A"]


def test_north_is_0_degrees():
    assert parsed("HDT", heading_rad=math.radians(359.97)).heading == 0
    assert parsed("HDT", heading_rad=math.radians(-0.01)).heading == 0


def test_position_sentences_contain_time_and_velocity():
    rmc = parsed("RMC")
    assert (rmc.latitude, rmc.longitude, rmc.status) == (-33.5, 151.25, "A")
    assert (str(rmc.datestamp), rmc.timestamp.isoformat()) == ("2026-11-01", "00:00:01.250000+00:00")
    assert (rmc.spd_over_grnd, rmc.true_course) == (0.97, 270.0)
    gga = parsed("GGA")
    assert (gga.latitude, gga.longitude, gga.gps_qual, gga.num_sats) == (-33.5, 151.25, 1, "08")
    assert (float(gga.horizontal_dil), gga.altitude, gga.data[0]) == (1.2, 12.5, "000001.25")
    assert parsed("GGA", position_ok=False).data[0] == "000001.25"
    for fix, quality in ((FixType.DGPS, 2), (FixType.RTK_FIXED, 4), (FixType.RTK_FLOAT, 5)):
        assert parsed("GGA", position=msgspec.structs.replace(FIX, fix=fix)).gps_qual == quality
    for satellites, text in ((None, ""), (-1, "00"), (99, "99"), (120, "99")):
        assert parsed("GGA", position=msgspec.structs.replace(FIX, satellites=satellites)).num_sats == text
    east = msgspec.structs.replace(FIX, latitude_rad=math.radians(0.0), longitude_rad=math.radians(-181.0))
    assert parsed("RMC", position=east).data[2:6] == ["0000.0000", "N", "17900.0000", "E"]
    unknown = msgspec.structs.replace(FIX, longitude_rad=None)
    assert parsed("RMC", position=unknown).data[1:6] == ["V", "", "", "", ""]


def test_minutes_are_below_60():
    position = msgspec.structs.replace(
        FIX, latitude_rad=math.radians(47.99999999), longitude_rad=math.radians(-8.99999999)
    )
    assert (parsed("RMC", position=position).lat, parsed("RMC", position=position).lon) == ("4800.0000", "00900.0000")


def test_old_position_is_not_sent():
    assert (parsed("RMC", position_ok=False).status, parsed("RMC", position_ok=False).lat) == ("V", "")
    assert (parsed("GGA", position_ok=False).gps_qual, parsed("GGA", position_ok=False).lat) == (0, "")
    assert parsed("XTE", position_ok=False, **LINE) is None
    assert (parsed("RMC", position_ok=False, utc_s=5.0).timestamp, parsed("RMC", position_ok=False).status) == (
        None,
        "V",
    )


def test_sentences_without_a_value_are_omitted():
    for name in ("HDT", "HDG", "ROT"):
        assert parsed(name, heading_ok=False) is None
    assert parsed("ROT", yaw_rate_rad_s=None) is None
    no_line = Navigation(Activity.LINE, cross_track_m=None), Navigation(Activity.STATION, cross_track_m=5.0)
    for name in ("XTE", "APB"):
        assert parsed(name) is None
        assert parsed(name, **LINE, position_ok=False) is None
        for navigation in no_line:
            assert parsed(name, **{**LINE, "navigation": navigation}) is None
    assert parsed("VHW", heading_ok=False) is None
    assert parsed("VHW").data == ["350.0", "T", "2.3", "M", "", "N", "", "K"]
    only_speed = parsed("VHW", heading_ok=False, water=Water(0.4, 0.1, 0.0, 0.0, 0.1))
    assert only_speed.data == ["", "T", "", "M", "0.78", "N", "1.44", "K"]


def test_rudder_to_starboard_is_positive_and_missing_rudder_is_invalid():
    assert parsed("RSA", rudder_rad=math.radians(-11.6)).data == ["-11.6", "A", "", "V"]
    assert parsed("RSA", rudder_ok=False).data == parsed("RSA", rudder_rad=None).data == ["", "V", "", "V"]


def test_boat_to_starboard_of_the_line_steers_left():
    xte = parsed("XTE", **LINE)
    assert (float(xte.cross_track_err_dist), xte.correction_dir, xte.dist_units) == (0.1, "L", "N")
    on_the_line = LINE | {"navigation": Navigation(Activity.LINE, cross_track_m=0.0)}
    assert parsed("XTE", **on_the_line).data == ["A", "A", "0.000", "R", "N", "A"]
    port = LINE | {"navigation": msgspec.structs.replace(LINE["navigation"], cross_track_m=-185.2)}
    assert parsed("XTE", **port).correction_dir == "R"
    apb = parsed("APB", **LINE).data
    # The cross-track distance is half the distance to the waypoint: the line is 30 degrees to the right of the bearing.
    assert apb[:7] == ["A", "A", "0.100", "L", "N", "V", "V"]
    assert apb[7:] == ["110.0", "T", "007", "80.0", "T", "114.6", "T", "A"]
    far = {"navigation": Navigation(Activity.LINE, arrived=True, cross_track_m=18_600.0)}
    for changes in (far, {**far, "distance_m": 18_600.0}, {**far, "distance_m": None}):
        apb = parsed("APB", **{**LINE, **changes, "mission": MissionReport()}).data
        assert apb[2:] == ["9.990", "L", "N", "A", "V", "", "T", "GOAL", "80.0", "T", "114.6", "T", "A"]
    assert parsed("APB", **{**LINE, "bearing_rad": None}).data[7:11] == ["", "T", "007", ""]


def test_water_speed_is_in_knots_and_kilometres_per_hour():
    vhw = parsed("VHW", water=Water(0.4, 0.1, 0.0, 0.0, 0.1))
    assert vhw.data == ["350.0", "T", "2.3", "M", "0.78", "N", "1.44", "K"]


ANGLES = st.floats(-7.0, 7.0)
MAYBE = st.none() | st.just(math.nan) | st.just(math.inf)


@given(
    st.tuples(
        st.floats(-math.pi / 2, math.pi / 2), ANGLES, MAYBE | st.floats(-500.0, 9000.0), MAYBE | st.floats(0, 90)
    ),
    st.tuples(ANGLES, MAYBE | ANGLES, MAYBE | ANGLES, st.floats(-1e7, 1e7), st.floats(0.0, 1e7), ANGLES),
    st.floats(0.0, 5e9),
)
def test_sentences_of_any_snapshot_are_parsed_by_both_libraries(fix, motion, utc_s):
    latitude_rad, longitude_rad, altitude_m, speed_m_s = fix
    heading_rad, rate_rad_s, course_rad, off_m, distance_m, bearing_rad = motion
    position = PositionSample(0.0, FixType.FIX_3D, latitude_rad, longitude_rad, altitude_m, speed_m_s, course_rad)
    here = make_data(
        utc_s=utc_s, position=position, heading_rad=heading_rad, yaw_rate_rad_s=rate_rad_s, goal_heading_rad=course_rad,
        bearing_rad=bearing_rad, distance_m=distance_m, navigation=Navigation(Activity.LINE, cross_track_m=off_m),
    )  # fmt: skip
    for data in sentences(here, list(TABLE)):
        assert len(data) <= MAX_SENTENCE_BYTES
        assert pynmea2.parse(data.decode("ascii"), check=True).render(checksum=False).encode() in data
        assert NMEAReader.parse(data, validate=1) is not None


@pytest.mark.parametrize("name", list(TABLE))
def test_sentences_end_with_checksum_and_line_end(name):
    for data in sentences(make_data(**LINE), [name]):
        assert data.startswith(b"$")
        assert data.endswith(b"\r\n")
