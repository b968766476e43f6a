import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, FixType, PositionSample, Severity
from firmware_py.log import ardupilot
from firmware_py.log.dataflash import Format

FIX = PositionSample(
    1.0, FixType.FIX_3D, math.radians(41.25), math.radians(-70.5), 2.0, 0.5, math.radians(350.0), 9, 0.8
)


def unpacked(kind, data):
    found = Format(kind.number, kind.size, kind.name, kind.values, kind.labels)
    return dict(zip(found.labels, found.unpack(data, 0), strict=True))


def test_a_fix_is_logged_as_ardupilot_does():
    values = unpacked(ardupilot.GPS, ardupilot.position_bytes(FIX))
    assert (values["Lat"], values["Lng"]) == (412500000, -705000000)
    assert (values["Status"], values["NSats"], values["HDop"]) == (3, 9, 80)
    assert values["GCrs"] == pytest.approx(350.0)
    assert (values["GWk"], values["GMS"]) == (0, 0)


def test_no_fix_is_no_message():
    assert ardupilot.position_bytes(PositionSample(1.0, FixType.NONE, 0.1, 0.1)) == b""
    assert ardupilot.position_bytes(PositionSample(1.0, FixType.FIX_2D, None, 0.1)) == b""


def test_gps_time_is_the_published_one():
    # 2020-01-01 00:00:00 UTC is GPS week 2086, day 3, with 18 leap seconds.
    utc = PositionSample(1.0, FixType.FIX_2D, 0.1, 0.1, utc_s=1577836800.0)
    values = unpacked(ardupilot.GPS, ardupilot.position_bytes(utc))
    assert (values["GWk"], values["GMS"]) == (2086, (3 * 86400 + 18) * 1000)


@pytest.mark.parametrize("wild", [-1e300, -1.0, 0.0, 1e300])
def test_numbers_out_of_range_are_limited(wild):
    sample = PositionSample(wild, FixType.FIX_2D, wild, wild, wild, wild, wild, 10**6, wild, wild)
    values = unpacked(ardupilot.GPS, ardupilot.position_bytes(sample))
    assert values["NSats"] == 255
    assert values["HDop"] in (0, 65535)


def test_a_parameter_stands_beside_its_default():
    values = unpacked(ardupilot.PARM, ardupilot.parameter_bytes(1.0, "CTL_K1", 12.5))
    assert values["Name"].rstrip(b"\0") == b"CTL_K1"
    assert (values["Value"], values["Default"]) == (12.5, 40.0)
    all_bytes = ardupilot.parameters_bytes(1.0, ParameterSet())
    assert len(all_bytes) == ardupilot.PARM.size * len(ParameterSet().values())


def test_a_long_text_is_cut_and_a_bad_one_is_written():
    data = ardupilot.message_bytes(1.0, (Event(Severity.ERROR, "x" * 99), Event(Severity.ERROR, "\ud800")))
    assert len(data) == 2 * ardupilot.MSG.size
    assert unpacked(ardupilot.MSG, data)["Message"] == b"x" * 64


@pytest.mark.parametrize(("utc_s", "says"), [(1.7e9, "2023-11-14T22:13:20Z"), (-1.0, "unknown"), (math.nan, "unknown")])
def test_the_opening_says_software_and_start(utc_s, says):
    texts = [event.text for event in ardupilot.opening("Rambler 1", utc_s)]
    assert texts[0] == "Rambler 1"
    assert says in texts[-1]
