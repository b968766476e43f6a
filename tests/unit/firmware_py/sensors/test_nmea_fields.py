"""Single fields: what is taken, what is empty, what is refused."""

import datetime as dt

import pytest

from firmware_py.sensors import nmea_fields
from firmware_py.sensors.message_error import MessageError

SIGNS = {"E": 1.0, "W": -1.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [("", None), ("0", 0.0), ("98.3", 98.3), ("+00.39", 0.39), ("-00.79", -0.79), ("5.", 5.0), (".5", 0.5),
     ("-.5", -0.5), ("0.-6", -0.6), ("-1.-2", -1.2), ("-0.-6", -0.6), ("0.-05", -0.05)],
)  # fmt: skip
def test_numbers_that_are_taken(text, value):
    assert nmea_fields.to_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["nan", "inf", "-inf", "Infinity", "1e5", "1e999", "0x1F", "1_0", " 7", "7 ", "\u0667", "1.2.3", "--1", "+-1", "-",
     ".", "+", "3.-6", "0.--6", "0.-", "A", "1" * 10, "1." + "1" * 13, "\xff"],
)  # fmt: skip
def test_what_float_might_take_but_no_sensor_writes_is_refused(text):
    with pytest.raises(MessageError) as refusal:
        nmea_fields.to_number(text)
    assert refusal.value.error == "malformed"
    assert str(refusal.value).isprintable()


@pytest.mark.parametrize(("text", "ok"), [("0", 1), ("360.0", 1), ("360.01", 0), ("-0.1", 0), ("400", 0)])
def test_the_range_is_closed(text, ok):
    read = nmea_fields.number(0, 0.0, 360.0)
    if ok:
        assert read((text,)) == float(text)
    else:
        with pytest.raises(MessageError) as refusal:
            read((text,))
        assert refusal.value.error == "range"
        assert text.rstrip("0").rstrip(".") in str(refusal.value)


def test_a_wrong_unit_is_refused_unless_there_is_no_value():
    read = nmea_fields.number(0, 0.0, 360.0, unit="T")
    assert read(("341.8", "T")) == 341.8
    assert read(("", "")) is None
    for unit in ("M", "", "t"):
        with pytest.raises(MessageError):
            read(("341.8", unit))


@pytest.mark.parametrize(("unit", "value"), [("N", 1852 / 3600), ("K", 1 / 3.6), ("M", 1.0), ("S", 0.44704)])
def test_speeds_come_in_four_units(unit, value):
    assert nmea_fields.speed(0)(("1.0", unit)) == pytest.approx(value)


@pytest.mark.parametrize("fields", [("1.0", ""), ("1.0", "X"), ("-1.0", "N"), ("999999", "N")])
def test_speeds_that_are_refused(fields):
    with pytest.raises(MessageError):
        nmea_fields.speed(0)(fields)


def test_east_is_added_and_west_subtracted():
    read = nmea_fields.signed(0, 180.0, SIGNS)
    assert (read(("5", "E")), read(("5", "W")), read(("", "W")), read(("0.0", ""))) == (5.0, -5.0, None, 0.0)
    for fields in (("5", ""), ("5", "N"), ("-5", "E"), ("180.1", "E")):
        with pytest.raises(MessageError):
            read(fields)


@pytest.mark.parametrize(
    ("fields", "value"),
    [(("5327.03942", "N"), 53.450657), (("5327.03942", "S"), -53.450657), (("9000.000", "N"), 90.0), (("", "N"), None),
     (("", ""), None), (("0000", "S"), 0.0)],
)  # fmt: skip
def test_latitudes(fields, value):
    assert nmea_fields.latitude(0)(fields) == (value if value is None else pytest.approx(value, abs=1e-9))


@pytest.mark.parametrize(
    "fields",
    [("5327.03942", ""), ("5327.03942", "E"), ("9000.001", "N"), ("5360.0", "N"), ("-5327.0", "N"), ("527.0", "N"),
     ("05327.0", "N"), ("53 27.0", "N"), ("nan", "N"), ("5327.0e1", "N")],
)  # fmt: skip
def test_latitudes_that_are_refused(fields):
    with pytest.raises(MessageError):
        nmea_fields.latitude(0)(fields)


def test_longitudes_have_three_digits_of_degrees_or_two():
    read = nmea_fields.longitude(0)
    assert read(("00214.42462", "W")) == pytest.approx(-2.240410333, abs=1e-9)
    assert read(("18000.0", "E")) == 180.0
    assert read(("0214.42462", "W")) == read(("00214.42462", "W"))
    assert read(("9959.9", "E")) == pytest.approx(99.998333333, abs=1e-9)
    for fields in (("18000.1", "E"), ("214.4", "W"), ("9960.0", "E"), ("000214.4", "W"), ("00214.4", "N")):
        with pytest.raises(MessageError):
            read(fields)


def test_times_of_day():
    read = nmea_fields.time_of_day(0)
    assert (read(("115630",)), read(("235959.99",)), read(("235960",)), read(("",))) == (42990, 86399.99, 86400, None)
    for text in ("240000", "116000", "115661", "11563", "1156300", "-15630", "11:56:30"):
        with pytest.raises(MessageError):
            read((text,))


def test_dates_become_utc():
    read = nmea_fields.utc_of_short_date(0, 1)
    expected = dt.datetime(2016, 8, 15, 11, 56, 30, tzinfo=dt.UTC).timestamp()
    assert read(("115630", "150816")) == expected
    assert nmea_fields.utc_of_long_date(0, 1)(("115630", "15", "08", "2016")) == expected
    assert read(("115630", "")) is None
    assert read(("", "150816")) is None
    assert read(("000000", "290224")) is not None  # a leap year


@pytest.mark.parametrize("zeros", [("", "", "", ""), ("000000", "00", "00", "0000")])
def test_no_date_yet_is_no_error(zeros):
    assert nmea_fields.utc_of_short_date(0, 1)(("115630", zeros[0])) is None
    assert nmea_fields.utc_of_long_date(0, 1)(("115630", *zeros[1:])) is None


@pytest.mark.parametrize(
    "date",
    ["310216", "000116", "011316", "290223", "1508161", "15O816", "999999", "-10816", "2208-1", "320126", "000126"],
)
def test_a_date_that_cannot_be_is_none(date):
    assert nmea_fields.utc_of_short_date(0, 1)(("115630", date)) is None


@pytest.mark.parametrize(
    "parts",
    [("31", "02", "2016"), ("15", "08", "1916"), ("15", "08", "2116"), ("15", "08", "16"), ("-1", "08", "2016")],
)
def test_long_dates_that_are_refused(parts):
    with pytest.raises(MessageError):
        nmea_fields.utc_of_long_date(0, 1)(("115630", *parts))
