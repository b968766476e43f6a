import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, FixType, PositionSample, Severity
from firmware_py.log import ardupilot
from firmware_py.log.dataflash import Format

FIX = PositionSample(
    1.0, FixType.FIX_3D, math.radians(41.25), math.radians(-70.5), 2.0, 0.5, math.radians(350.0), 9, 0.8
)


def decode(kind, data):
    layout = Format(kind.number, kind.size, kind.name, kind.values, kind.labels)
    return dict(zip(layout.labels, layout.unpack(data, 0), strict=True))


def test_a_fix_is_logged_in_the_units_of_ardupilot():
    values = decode(ardupilot.GPS, ardupilot.encode_position(FIX))
    expected = {"TimeUS": 1_000_000, "I": 0, "Status": 3, "GMS": 0, "GWk": 0, "NSats": 9, "HDop": 80}
    expected |= {"Lat": 412500000, "Lng": -705000000, "Alt": 2.0, "Spd": 0.5, "GCrs": 350.0}
    assert values == pytest.approx(expected)


@pytest.mark.parametrize(
    "sample",
    [
        PositionSample(1.0, FixType.NONE, 0.1, 0.1),
        PositionSample(1.0, FixType.FIX_2D, None, 0.1),
        PositionSample(1.0, FixType.FIX_2D, 0.1, None),
    ],
)
def test_without_a_position_there_is_no_message(sample):
    assert ardupilot.encode_position(sample) == b""


@pytest.mark.parametrize(
    ("utc_s", "week", "week_ms"),
    [
        (315964799.0, 0, 0),
        (315964800.0, 0, 18_000),  # 1980-01-06
        (1577836800.0, 2086, (3 * 86400 + 18) * 1000),  # 2020-01-01: day 3 of week 2086, with 18 leap seconds
        (4102444799.0, 6260, (5 * 86400 + 17) * 1000),
        (4102444800.0, 0, 0),  # 2100-01-01
    ],
)
def test_gps_time_is_the_published_one_from_1980_to_2099(utc_s, week, week_ms):
    sample = PositionSample(1.0, FixType.FIX_2D, 0.1, 0.1, utc_s=utc_s)
    values = decode(ardupilot.GPS, ardupilot.encode_position(sample))
    assert (values["GWk"], values["GMS"]) == (week, week_ms)


@pytest.mark.parametrize(
    ("satellites", "hdop", "expected"),
    [(None, None, (0, 0)), (0, math.nan, (0, 0)), (-1, -1e300, (0, 0)), (254, 655.34, (254, 65534)),
     (255, 655.35, (255, 65535)), (256, 655.36, (255, 65535)), (10**6, 1e300, (255, 65535)), (1, 0.01, (1, 1))],
)  # fmt: skip
def test_satellites_and_dilution_are_limited(satellites, hdop, expected):
    sample = PositionSample(-1.0, FixType.FIX_2D, 1e300, -1e300, None, None, None, satellites, hdop)
    values = decode(ardupilot.GPS, ardupilot.encode_position(sample))
    assert (values["NSats"], values["HDop"]) == expected
    assert [values[name] for name in ("TimeUS", "Alt", "Spd", "GCrs")] == pytest.approx(
        [0] + 3 * [math.nan], nan_ok=True
    )


def test_parameters_are_logged_with_their_defaults():
    values = decode(ardupilot.PARM, ardupilot.encode_parameter(1.0, "CTL_K1", 12.5))
    assert (values["Name"].rstrip(b"\0"), values["Value"], values["Default"]) == (b"CTL_K1", 12.5, 40.0)
    data = ardupilot.encode_parameters(1.0, ParameterSet())
    assert len(data) == ardupilot.PARM.size * len(ParameterSet().values())


def test_a_long_text_is_truncated_and_an_invalid_one_is_written():
    data = ardupilot.encode_texts(1.0, (Event(Severity.ERROR, "x" * 99), Event(Severity.ERROR, "\ud800")))
    assert len(data) == 2 * ardupilot.MSG.size
    assert decode(ardupilot.MSG, data) == {"TimeUS": 1_000_000, "Message": b"x" * 64, "Sev": Severity.ERROR}


def test_a_mode_is_logged_as_its_number():
    values = decode(ardupilot.MODE, ardupilot.encode_mode(1.0, 15))
    assert values == {"TimeUS": 1_000_000, "Mode": 15, "ModeNum": 15, "Rsn": 0}


@pytest.mark.parametrize(
    ("utc_s", "start"),
    [(0.0, "1970-01-01T00:00:00Z"), (1.7e9, "2023-11-14T22:13:20Z"), (4102444799.0, "2099-12-31T23:59:59Z"),
     (4102444800.0, "unknown"), (-1, "unknown"), (math.nan, "unknown")],
)  # fmt: skip
def test_start_texts_contain_software_and_time(utc_s, start):
    events = ardupilot.start_texts("Rambler 1", utc_s)
    assert (events[0].text, events[2].text) == ("Rambler 1", f"Process started {start}")
    assert "ArduRover" in events[1].text  # pymavlink finds the names of the modes by it
    assert {event.severity for event in events} == {Severity.INFO}
