"""Readers of single NMEA fields: values, empty fields, and rejected texts."""

import datetime as dt
from functools import partial

import pytest

from firmware_py.sensors import nmea_fields as readers
from firmware_py.sensors.message_error import MessageError

EAST_WEST = partial(readers.signed_field, 0, 180.0, {"E": 1.0, "W": -1.0})
HEADING = partial(readers.number_field, 0, 0.0, 360.0)
TRUE_HEADING = partial(HEADING, unit="T")
SPEED, LATITUDE, LONGITUDE = (
    partial(field, 0) for field in (readers.speed_field, readers.latitude_field, readers.longitude_field)
)
TIME, SHORT_DATE = partial(readers.time_of_day_field, 0), partial(readers.short_date_field, 0, 1)
LONG_DATE = partial(readers.long_date_field, 0, 1)
MOMENT_S = dt.datetime(2016, 8, 15, 11, 56, 30, tzinfo=dt.UTC).timestamp()


@pytest.mark.parametrize(
    ("text", "value"),
    [("", None), ("0", 0.0), ("98.3", 98.3), ("+00.39", 0.39), ("-00.79", -0.79), ("5.", 5.0), (".5", 0.5),
     ("-.5", -0.5), ("0.-6", -0.6), ("-1.-2", -1.2), ("-0.-6", -0.6), ("0.-05", -0.05)],
)  # fmt: skip
def test_numbers(text, value):
    assert readers.to_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["nan", "inf", "-inf", "Infinity", "1e5", "1e999", "0x1F", "1_0", " 7", "7 ", "\u0667", "1.2.3", "--1", "+-1", "-",
     ".", "+", "3.-6", "0.--6", "0.-", "A", "1" * 10, "1." + "1" * 13, "\xff"],
)  # fmt: skip
def test_other_texts_are_no_numbers(text):
    with pytest.raises(MessageError) as rejected:
        readers.to_number(text)
    assert rejected.value.error == "malformed"
    assert str(rejected.value).isprintable()


@pytest.mark.parametrize(
    ("reader", "fields", "value"),
    [(HEADING, ("0",), 0.0), (HEADING, ("360.0",), 360.0), (TRUE_HEADING, ("341.8", "T"), 341.8),
     (TRUE_HEADING, ("", ""), None), (SPEED, ("1.0", "N"), 1852 / 3600), (SPEED, ("1.0", "K"), 1 / 3.6),
     (SPEED, ("200.0", "M"), 200.0), (SPEED, ("1.0", "S"), 0.44704), (EAST_WEST, ("5", "E"), 5.0),
     (EAST_WEST, ("5", "W"), -5.0), (EAST_WEST, ("", "W"), None), (EAST_WEST, ("0.0", "", "x"), 0.0),
     (LATITUDE, ("5327.03942", "N"), 53.450657), (LATITUDE, ("5327.03942", "S"), -53.450657),
     (LATITUDE, ("9000.000", "N"), 90.0), (LATITUDE, ("", "N"), None), (LATITUDE, ("", ""), None),
     (LATITUDE, ("0000", "S"), 0.0), (LONGITUDE, ("00214.42462", "W"), -2.240410333333),
     (LONGITUDE, ("18000.0", "E"), 180.0), (LONGITUDE, ("0214.42462", "W"), -2.240410333333),
     (LONGITUDE, ("9959.9", "E"), 99.998333333333), (TIME, ("115630",), 42990), (TIME, ("235959.99",), 86399.99),
     (TIME, ("235960",), 86400), (TIME, ("",), None), (SHORT_DATE, ("115630", "150816"), MOMENT_S),
     (SHORT_DATE, ("115630", ""), None), (SHORT_DATE, ("", "150816"), None),
     (SHORT_DATE, ("000000", "290224"), dt.datetime(2024, 2, 29, tzinfo=dt.UTC).timestamp()),
     (LONG_DATE, ("115630", "15", "08", "2016"), MOMENT_S), (LONG_DATE, ("115630", "", "", ""), None),
     (LONG_DATE, ("115630", "00", "00", "0000"), None)],
)  # fmt: skip
def test_values(reader, fields, value):
    assert reader()(fields) == (None if value is None else pytest.approx(value, rel=0.0, abs=1e-9))


@pytest.mark.parametrize(
    ("reader", "error", "rows"),
    [
        (HEADING, "range", [("360.01",), ("-0.1",), ("400",)]),
        (TRUE_HEADING, "malformed", [("341.8", "M"), ("341.8", ""), ("341.8", "t")]),
        (SPEED, "malformed", [("1.0", ""), ("1.0", "X")]),
        (SPEED, "range", [("-1.0", "N"), ("200.1", "M")]),
        (EAST_WEST, "malformed", [("5", ""), ("5", "N")]),
        (EAST_WEST, "range", [("-5", "E"), ("180.1", "E")]),
        (LATITUDE, "malformed", [("5327.03942", ""), ("5327.03942", "E"), ("-5327.0", "N"), ("527.0", "N"),
                                 ("05327.0", "N"), ("53 27.0", "N"), ("nan", "N"), ("5327.0e1", "N")]),
        (LATITUDE, "range", [("9000.001", "N"), ("5360.0", "N")]),
        (LONGITUDE, "malformed", [("214.4", "W"), ("000214.4", "W"), ("00214.4", "N")]),
        (LONGITUDE, "range", [("18000.1", "E"), ("9960.0", "E")]),
        (TIME, "malformed", [("11563",), ("1156300",), ("-15630",), ("11:56:30",)]),
        (TIME, "range", [("240000",), ("116000",), ("115661",)]),
        (LONG_DATE, "range", [("115630", *date.split()) for date in
                              ("31 02 2016", "00 08 2016", "15 08 1916", "15 08 2116", "15 08 16", "-1 08 2016")]),
    ],
)  # fmt: skip
def test_invalid_values_are_rejected(reader, error, rows):
    for fields in rows:
        with pytest.raises(MessageError) as rejected:
            reader()(fields)
        assert rejected.value.error == error, fields


@pytest.mark.parametrize(
    "date",
    ["310216", "000116", "011316", "290223", "1508161", "15O816", "999999", "-10816", "2208-1", "320126", "000126",
     "000000"],
)  # fmt: skip
def test_invalid_short_date_is_none(date):
    assert SHORT_DATE()(("115630", date)) is None


@pytest.mark.parametrize(
    ("day", "month", "year", "is_valid"),
    [("31", "12", "1979", False), ("01", "01", "1980", True), ("31", "12", "2099", True), ("01", "01", "2100", False)],
)
def test_year_of_a_date_is_1980_to_2099(day, month, year, is_valid):
    fields = ("000000.00", day, month, year)
    if is_valid:
        moment = dt.datetime(int(year), int(month), int(day), tzinfo=dt.UTC)
        assert LONG_DATE()(fields) == moment.timestamp()
    else:
        with pytest.raises(MessageError):
            LONG_DATE()(fields)
