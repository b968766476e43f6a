"""Decoding of NMEA sentences compared with examples of manufacturers and with pynmeagps."""

import pytest
from pynmeagps import NMEAReader

from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer
from firmware_py.sensors.nmea_sentences import TABLE, decode_sentence


def decode(raw):
    (sentence,) = NmeaFramer().feed(raw)
    assert sentence.fault == ""
    return decode_sentence(sentence)


@pytest.mark.parametrize(
    ("raw", "magnetic_deg", "true_deg"),
    [
        (b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n", 98.3, 85.7),
        (b"$INHDG,180,5,W,10,W*6D\r\n", 175.0, 165.0),
        (b"$IIHDG,70.6,,,,W*2F\r\n", 70.6, None),
        ("HCHDG,350,5,E,10,E", 355.0, 5.0),
        ("HCHDG,5,5,W,10,W", 0.0, 350.0),
        ("HCHDG,360.0,,,0.0,E", 0.0, 0.0),
    ],
)
def test_hdg_adds_east_subtracts_west_and_wraps_at_north(nmea, raw, magnetic_deg, true_deg):
    numbers = decode(raw if isinstance(raw, bytes) else nmea(raw)).numbers
    assert numbers["heading_magnetic_deg"] == pytest.approx(magnetic_deg)
    assert numbers["heading_true_deg"] == (None if true_deg is None else pytest.approx(true_deg))


@pytest.mark.parametrize(
    ("body", "numbers"),
    [
        ("HEHDT,341.8,T", {"heading_true_deg": 341.8}),
        ("GPHDT,,", {"heading_true_deg": None}),
        ("GPHDT,,T", {"heading_true_deg": None}),
        ("IIHDM,70.6,M", {"heading_magnetic_deg": 70.6}),
        ("GPTHS,77.5,A", {"heading_true_deg": 77.5}),
        ("GPROT,35.6,A", {"turn_rate_deg_min": 35.6}),
        ("TIROT,-9.9,V", {"turn_rate_deg_min": -9.9}),
        ("IIRSA,10.5,A,,V", {"rudder_deg": 10.5}),
        ("IIRSA,-3.2,A", {"rudder_deg": -3.2}),
        ("SDVHW,67.5,T,66.6,M,5.3,N,9.8,K", {"heading_true_deg": 67.5, "heading_magnetic_deg": 66.6,
                                             "water_speed_m_s": 5.3 * 1852 / 3600}),
        ("WIMWV,310.6,R,10.0,M,A", {"wind_angle_deg": 310.6, "wind_speed_m_s": 10.0}),
        ("GPVTG,77.9,T,76.9,M,5.0,N,9.3,K,A", {"cog_deg": 77.9, "sog_m_s": 5.0 * 1852 / 3600}),
        ("WIMDA,29.92,I,1.0132,B,20.1,C,18.5,C,55.0,,10.2,C,270.0,T,268.0,M,10.0,N,5.1,M",
         {"air_pressure_pa": 101320.0, "air_temperature_c": 20.1, "water_temperature_c": 18.5, "humidity_percent": 55.0,
          "dew_point_c": 10.2, "wind_from_true_deg": 270.0, "wind_from_magnetic_deg": 268.0, "wind_speed_m_s": 5.1}),
        ("IIXDR,C,C,,C,AIRTEMP,A,13.5,D,HEEL,A,2.8,D,TRIM,P,,B,BARO,A,A,0.-6,D,RUDDER",
         {"rudder_deg": -0.6, "heel_deg": 13.5, "trim_deg": 2.8, "air_temperature_c": None, "air_pressure_pa": None}),
        ("IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO,A,-3.9,D,RUDDER",
         {"rudder_deg": -3.9, "heel_deg": -1.0, "trim_deg": 2.9, "air_temperature_c": None, "air_pressure_pa": None}),
        ("WIMDA,29.92,I,,B,,C,,C,,,,C,,T,,M,,N,,M",
         {"air_pressure_pa": 101320.8, "air_temperature_c": None, "water_temperature_c": None, "humidity_percent": None,
          "dew_point_c": None, "wind_from_true_deg": None, "wind_from_magnetic_deg": None, "wind_speed_m_s": None}),
        ("IIVWR,133,L,07.03,N,03.62,M,,", {"wind_angle_deg": 227.0, "wind_speed_m_s": 7.03 * 1852 / 3600}),
        ("WIVWT,20.5,R,,N,3.2,M,,K", {"wind_angle_deg": 20.5, "wind_speed_m_s": 3.2}),
        ("WIVWR,,,,,,,,", {"wind_angle_deg": None, "wind_speed_m_s": None}),
        ("YXMTW,17.4,C", {"water_temperature_c": 17.4}),
        ("WIMTA,19.4,C", {"air_temperature_c": 19.4}),
        ("IIMMB,27.061,I,0.9164,B", {"air_pressure_pa": 91640.0}),
        ("WIMHU,55.0,,10.2,C", {"humidity_percent": 55.0, "dew_point_c": 10.2}),
        ("SDDPT,5.3,0.4,", {"depth_below_transducer_m": 5.3, "offset_m": 0.4, "depth_below_surface_m": 5.7,
                            "depth_below_keel_m": None}),
        ("SDDPT,5.3,-0.4", {"depth_below_transducer_m": 5.3, "offset_m": -0.4, "depth_below_surface_m": None,
                            "depth_below_keel_m": 4.9}),
        ("SDDPT,5.3,0.0", {"depth_below_transducer_m": 5.3, "offset_m": 0.0, "depth_below_surface_m": None,
                           "depth_below_keel_m": None}),
        ("SDDPT,5.3,", {"depth_below_transducer_m": 5.3, "offset_m": None, "depth_below_surface_m": None,
                        "depth_below_keel_m": None}),
        ("SDDBT,12.9,f,3.9,M,2.1,F", {"depth_below_transducer_m": 3.9}),
        ("SDDBT,10.0,f,,M,,F", {"depth_below_transducer_m": 3.048}),
        ("YDDBS,,f,,M,2.0,F", {"depth_below_surface_m": 3.6576}),
        ("IIDBK,29.2,f,8.90,M,4.9,F", {"depth_below_keel_m": 8.9}),
    ],
)  # fmt: skip
def test_values_of_sentences(nmea, body, numbers):
    decoded = decode(nmea(body)).numbers
    assert set(decoded) == set(numbers)
    for name, value in numbers.items():
        assert decoded[name] == (value if value is None else pytest.approx(value)), name


@pytest.mark.parametrize(
    "body",
    ["HEHDT,400,T", "HEHDT,-1,T", "HEHDT,341.8,M", "HEHDT,341.8", "HEHDT,nan,T", "HEHDT,1e2,T", "HCHDM,70.6,T",
     "HCHDG,98.3,0.0,E,12.6", "HCHDG,98.3,0.0,E,12.6,", "HCHDG,361,,,,", "GPROT,99999,A", "IIRSA,95,A", "GPRMC,,A",
     "GPRMC,115631,A,9129.6446,N,00518.6558,E,5.0,78.0,150816,1.0,E,A",
     "GPRMC,245631,A,5229.6446,N,00518.6558,E,5.0,78.0,150816,1.0,E,A",
     "GPRMC,115631,A,5229.6446,N,00518.6558,E,XXXXX,78.0,150816,1.0,E,A",
     "IIXDR,A,95,D,RUDDER", "IIXDR,A,9,P,RUDDER", "IIXDR,A,x,D,RUDDER"],
)  # fmt: skip
def test_invalid_sentences_are_rejected(nmea, body):
    with pytest.raises(MessageError) as rejected:
        decode(nmea(body))
    assert rejected.value.error in {"malformed", "range"}
    assert str(rejected.value).startswith(body[:5])
    assert str(rejected.value).isascii()


def test_sentences_that_are_not_in_the_table_are_none(nmea):
    assert decode(nmea("GPGSV,1,1,00")) is None
    assert decode(nmea("GPHDTX,1")) is None
    assert decode(nmea("PASHR,1,2")) is None
    assert decode(nmea("PASHR,ARR,1,3,12,160159.00,123.45,123.45,-123.45,12.34")) is None


MIN_FIELDS = {
    2: "HDT HDM THS ROT RSA MTW MTA DPT", 3: "XDR", 4: "ZDA MMB MHU", 5: "HDG XTE MWV",
    6: "GLL VHW DBT DBS DBK", 8: "VTG MWD VWR VWT", 9: "RMC GGA GNS", 14: "APB", 20: "MDA",
}  # fmt: skip


def test_sentence_has_a_minimum_number_of_fields(nmea):
    counts = {kind: count for count, kinds in MIN_FIELDS.items() for kind in kinds.split()}
    assert counts.keys() | {"PASHR"} == TABLE.keys()
    for kind, count in counts.items():
        assert all(value is None for value in decode(nmea("GP" + kind + "," * count)).numbers.values()), kind
        with pytest.raises(MessageError, match=f"{count - 1} fields"):
            decode(nmea("GP" + kind + "," * (count - 1)))
    assert decode(nmea("PASHR,,,T,,,")).numbers["heading_true_deg"] is None
    with pytest.raises(MessageError, match="5 fields"):
        decode(nmea("PASHR,,,T,,"))


DEGREES = (0, 360)


@pytest.mark.parametrize(
    ("body", "low", "high"),
    [
        ("HCHDG,{},,,,", *DEGREES), ("HCHDG,5,{},E,,", 0, 180), ("HCHDG,5,,,{},E", 0, 180), ("HEHDT,{},T", *DEGREES),
        ("IIHDM,{},M", *DEGREES), ("GPTHS,{},A", *DEGREES), ("PASHR,,{},T,0,0,0", *DEGREES),
        ("PASHR,,5,T,{},0,0", -180, 180), ("PASHR,,5,T,0,{},0", -90, 90), ("PASHR,,5,T,0,0,{}", -100, 100),
        ("TIROT,{},A", -3600, 3600), ("IIRSA,{},A", -90, 90), ("GPRMC,,A,,,,,,{},,,,A", *DEGREES),
        ("GPGGA,,,,,,{},,,,,,,", 0, 9), ("GPGGA,,,,,,1,{},,,,,,", 0, 255), ("GPGGA,,,,,,1,,{},,,,,", 0, 1e4),
        ("GPGGA,,,,,,1,,,{},,,,", -1e3, 1e5), ("GPGNS,,,,,,A,{},,", 0, 255), ("GPVTG,{},T,,,,,,,", *DEGREES),
        ("IIVHW,{},T,,,,,,", *DEGREES), ("IIVHW,,,{},M,,,,", *DEGREES), ("IIXTE,A,A,{},R,N", 0, 1e4),
        ("IIAPB,A,A,{},R,N,,,,,,,,,", 0, 1e4), ("IIAPB,A,A,,R,N,,,,,,,,{},M", *DEGREES),
        ("WIMWV,{},R,,,A", *DEGREES), ("WIMWD,{},T,,,,,,", *DEGREES), ("WIMWD,,,{},M,,,,", *DEGREES),
        ("WIVWR,{},L,,,,,,", 0, 180), ("IIMMB,{},I,,", 14, 45), ("IIMMB,,,{},B", 0.5, 1.5), ("YXMTW,{},C", -10, 100),
        ("WIMTA,{},C", -100, 100), ("WIMHU,{},,,", 0, 100), ("WIMHU,,,{},C", -100, 100),
        *((f"WIMDA,{fields}," + "," * (20 - fields.count(",") - 2), low, high) for fields, low, high in (
            ("{},I", 14, 45), (",,,,{},C", -100, 100), (",,,,,,{},C", -10, 100), (",,,,,,,,{},", 0, 100),
            (",,,,,,,,,,{},C", -100, 100), (",,,,,,,,,,,,{},T", *DEGREES), (",,,,,,,,,,,,,,{},M", *DEGREES))),
        ("SDDPT,{},", 0, 12e3), ("SDDPT,,{}", -100, 100), ("SDDBT,,f,{},M,,F", 0, 12e3), ("SDDBS,{},f,,M,,F", 0, 4e4),
        ("SDDBK,,f,,M,{},F", 0, 7e3),
    ],
)  # fmt: skip
def test_values_beyond_their_limits_are_rejected(nmea, body, low, high):
    margin = 0.004 * (high - low)
    for value in (low, high):
        assert decode(nmea(body.format(value))) is not None
    for value in (low - margin, high + margin):
        with pytest.raises(MessageError, match="out of range"):
            decode(nmea(body.format(f"{value:.6f}")))


PYNMEAGPS_NAMES = {
    "HDT": {"headingT": "heading_true_deg"},
    "HDM": {"headingM": "heading_magnetic_deg"},
    "HDG": {"headingM": "sensor_deg"},
    "ROT": {"rot": "turn_rate_deg_min"},
    "VHW": {"hdgT": "heading_true_deg", "hdgM": "heading_magnetic_deg"},
    "RMC": {"lat": "lat_deg", "lon": "lon_deg", "cog": "cog_deg"},
    "GGA": {"lat": "lat_deg", "lon": "lon_deg", "quality": "quality", "numSV": "satellites", "HDOP": "hdop",
            "alt": "altitude_m"},
    "GNS": {"lat": "lat_deg", "lon": "lon_deg", "numSV": "satellites", "HDOP": "hdop", "alt": "altitude_m"},
    "GLL": {"lat": "lat_deg", "lon": "lon_deg"},
    "VTG": {"cogt": "cog_deg"},
    "MWV": {"angle": "wind_angle_deg"},
    "RSA": {"stbdangle": "rudder_deg"},
}  # fmt: skip


@pytest.mark.parametrize(
    "file",
    ["gpsd_bundg_zeus_9.nmea", "avnav_20160815_excerpt.nmea", "gpsd_rst39.nmea", "gpsd_hemi.nmea",
     "pynmeagps_nmea4.log"],
)  # fmt: skip
def test_recordings_are_decoded_as_by_pynmeagps(recordings, nmea, file):
    counts = {}
    compared = 0
    for sentence in NmeaFramer().feed((recordings / "nmea" / file).read_bytes()):
        names = PYNMEAGPS_NAMES.get(sentence.kind)
        if names is None or sentence.fault or counts.get(sentence.kind, 0) > 60:  # the library is slow
            continue
        counts[sentence.kind] = counts.get(sentence.kind, 0) + 1
        message = NMEAReader.parse(nmea(",".join((sentence.address, *sentence.fields))))
        numbers = decode_sentence(sentence).numbers
        for library_name, name in names.items():
            value = getattr(message, library_name)
            if value == "":
                assert numbers[name] is None, (sentence, name)
            else:
                assert numbers[name] == pytest.approx(float(value), abs=1e-8), (sentence, name)
            compared += 1
    assert compared > 4
