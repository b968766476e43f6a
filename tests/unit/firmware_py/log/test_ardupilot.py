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
    assert (values["Lat"], values["Lng"]) == (412500000, -705000000)
    assert (values["Status"], values["NSats"], values["HDop"]) == (3, 9, 80)
    assert values["GCrs"] == pytest.approx(350.0)
    assert (values["GWk"], values["GMS"]) == (0, 0)


@pytest.mark.parametrize(
    "sample", [PositionSample(1.0, FixType.NONE, 0.1, 0.1), PositionSample(1.0, FixType.FIX_2D, None, 0.1)]
)
def test_without_a_position_there_is_no_message(sample):
    assert ardupilot.encode_position(sample) == b""


def test_gps_time_is_the_published_one():
    # 2020-01-01 00:00:00 UTC is GPS week 2086, day 3, with 18 leap seconds.
    sample = PositionSample(1.0, FixType.FIX_2D, 0.1, 0.1, utc_s=1577836800.0)
    values = decode(ardupilot.GPS, ardupilot.encode_position(sample))
    assert (values["GWk"], values["GMS"]) == (2086, (3 * 86400 + 18) * 1000)


@pytest.mark.parametrize("value", [-1e300, -1.0, 0.0, 1e300])
def test_numbers_out_of_range_are_limited(value):
    sample = PositionSample(value, FixType.FIX_2D, value, value, value, value, value, 10**6, value, value)
    values = decode(ardupilot.GPS, ardupilot.encode_position(sample))
    assert values["NSats"] == 255
    assert values["HDop"] in (0, 65535)


def test_parameters_are_logged_with_their_defaults():
    values = decode(ardupilot.PARM, ardupilot.encode_parameter(1.0, "CTL_K1", 12.5))
    assert (values["Name"].rstrip(b"\0"), values["Value"], values["Default"]) == (b"CTL_K1", 12.5, 40.0)
    data = ardupilot.encode_parameters(1.0, ParameterSet())
    assert len(data) == ardupilot.PARM.size * len(ParameterSet().values())


def test_a_long_text_is_truncated_and_an_invalid_one_is_written():
    data = ardupilot.encode_texts(1.0, (Event(Severity.ERROR, "x" * 99), Event(Severity.ERROR, "\ud800")))
    assert len(data) == 2 * ardupilot.MSG.size
    assert decode(ardupilot.MSG, data)["Message"] == b"x" * 64


@pytest.mark.parametrize(("utc_s", "start"), [(1.7e9, "2023-11-14T22:13:20Z"), (-1, "unknown"), (math.nan, "unknown")])
def test_start_texts_contain_software_and_time(utc_s, start):
    texts = [event.text for event in ardupilot.start_texts("Rambler 1", utc_s)]
    assert texts[0] == "Rambler 1"
    assert start in texts[-1]
