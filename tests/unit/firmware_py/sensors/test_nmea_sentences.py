"""Whole sentences against vectors of the makers and against pynmeagps as the oracle."""

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
    ],
)
def test_hdg_adds_east_and_subtracts_west(raw, magnetic_deg, true_deg):
    numbers = decode(raw).numbers
    assert numbers["heading_magnetic_deg"] == pytest.approx(magnetic_deg)
    assert numbers["heading_true_deg"] == (true_deg if true_deg is None else pytest.approx(true_deg))


@pytest.mark.parametrize(
    ("body", "true_deg"), [("HCHDG,350,5,E,10,E", 5.0), ("HCHDG,5,5,W,10,W", 350.0), ("HCHDG,360.0,,,0.0,E", 0.0)]
)
def test_hdg_wraps_at_north(nmea, body, true_deg):
    assert decode(nmea(body)).numbers["heading_true_deg"] == true_deg


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
         {"rudder_deg": -0.6, "heel_deg": 13.5, "trim_deg": 2.8, "air_temperature_c": None}),
        ("IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO,A,-3.9,D,RUDDER",
         {"rudder_deg": -3.9, "heel_deg": -1.0, "trim_deg": 2.9, "air_temperature_c": None}),
    ],
)  # fmt: skip
def test_values(nmea, body, numbers):
    found = decode(nmea(body)).numbers
    assert set(found) == set(numbers)
    for name, value in numbers.items():
        assert found[name] == (value if value is None else pytest.approx(value)), name


@pytest.mark.parametrize(
    "body",
    ["HEHDT,400,T", "HEHDT,-1,T", "HEHDT,341.8,M", "HEHDT,341.8", "HEHDT,nan,T", "HEHDT,1e2,T", "HCHDM,70.6,T",
     "HCHDG,98.3,0.0,E,12.6", "HCHDG,98.3,0.0,E,12.6,", "HCHDG,361,,,,", "GPROT,99999,A", "IIRSA,95,A", "GPRMC,,A",
     "GPRMC,115631,A,9129.6446,N,00518.6558,E,5.0,78.0,150816,1.0,E,A",
     "GPRMC,115631,A,5229.6446,N,00518.6558,E,5.0,78.0,320816,1.0,E,A",
     "GPRMC,115631,A,5229.6446,N,00518.6558,E,XXXXX,78.0,150816,1.0,E,A",
     "IIXDR,A,95,D,RUDDER", "IIXDR,A,9,P,RUDDER", "IIXDR,A,x,D,RUDDER"],
)  # fmt: skip
def test_sentences_that_are_refused(nmea, body):
    with pytest.raises(MessageError) as refusal:
        decode(nmea(body))
    assert refusal.value.error in {"malformed", "range"}
    assert str(refusal.value).startswith(body[:5])
    assert str(refusal.value).isascii()


def test_unknown_sentences_and_namesakes_are_no_error(nmea):
    assert decode(nmea("GPGSV,1,1,00")) is None
    assert decode(nmea("GPHDTX,1")) is None
    assert decode(nmea("PASHR,ARR,1,3,12,160159.00,123.45,123.45,-123.45,12.34")) is None


def test_no_row_reads_past_its_fewest_fields(nmea):
    for kind, layout in TABLE.items():
        address = kind if kind[0] == "P" else "GP" + kind
        empty = decode(nmea(address + "," * layout.fewest))
        if empty is not None:  # PASHR without a T is another sentence
            assert all(value is None for value in empty.numbers.values()), kind


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
    "name",
    [
        "gpsd_bundg_zeus_9.nmea",
        "avnav_20160815_excerpt.nmea",
        "gpsd_rst39.nmea",
        "gpsd_hemi.nmea",
        "pynmeagps_nmea4.log",
    ],
)
def test_pynmeagps_reads_the_same(recordings, nmea, name):
    seen = {}
    compared = 0
    for sentence in NmeaFramer().feed((recordings / "nmea" / name).read_bytes()):
        names = PYNMEAGPS_NAMES.get(sentence.kind)
        if names is None or sentence.fault or seen.get(sentence.kind, 0) > 60:  # the library is slow
            continue
        seen[sentence.kind] = seen.get(sentence.kind, 0) + 1
        message = NMEAReader.parse(nmea(",".join((sentence.address, *sentence.fields))))
        numbers = decode_sentence(sentence).numbers
        for theirs, ours in names.items():
            value = getattr(message, theirs)
            if value == "":
                assert numbers[ours] is None, (sentence, ours)
            else:
                assert numbers[ours] == pytest.approx(float(value), abs=1e-8), (sentence, ours)
            compared += 1
    assert compared > 4
