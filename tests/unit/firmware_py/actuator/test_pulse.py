"""Options and conversion of pulse widths."""

import math

import pytest

from firmware_py.actuator.maestro import MaestroOptions
from firmware_py.actuator.pulse import PulseOptions, PulseScale
from firmware_py.common.options import record_from

DEG = math.pi / 180.0


@pytest.fixture(params=[PulseOptions, MaestroOptions])
def make(request):
    """Function that reads options as from a vehicle file."""
    return lambda **values: record_from(request.param, values)


@pytest.mark.parametrize(
    ("values", "pulses_us"),
    [
        ({}, {0.0: 1500.0, 30.0: 1833.3, -30.0: 1166.7}),
        ({"centre_us": 1520.0, "us_per_rad": 400.0}, {0.0: 1520.0, 30.0: 1729.4, -30.0: 1310.6}),
        ({"reversed": True}, {0.0: 1500.0, 30.0: 1166.7, -30.0: 1833.3}),
        ({"minus_us": 1100.0, "plus_us": 1800.0, "end_deg": 40.0}, {20.0: 1650.0, -20.0: 1300.0, 40.0: 1800.0}),
        ({"minus_us": 1800.0, "plus_us": 1100.0, "end_deg": 40.0}, {20.0: 1300.0, -20.0: 1650.0}),
        (
            {"minus_us": 1100.0, "plus_us": 1800.0, "end_deg": 40.0, "reversed": True},
            {20.0: 1300.0, -20.0: 1650.0, -40.0: 1800.0},
        ),
        ({"minus_us": 1100.0, "plus_us": 1950.0}, {45.0: 1950.0, -45.0: 1100.0}),
        ({"centre_us": 1000.0}, {0.0: 1000.0, 30.0: 1333.3, -30.0: 1000.0}),
        ({"centre_us": 2000.0}, {0.0: 2000.0, 30.0: 2000.0, -30.0: 1666.7}),
        ({"max_us": 1700.0}, {30.0: 1700.0, -30.0: 1166.7}),
        ({"min_us": 1300.0}, {30.0: 1833.3, -30.0: 1300.0}),
    ],
)
def test_pulse_of_an_angle(make, values, pulses_us):
    scale = PulseScale.of(make(**values))
    assert {deg: round(scale.pulse_us(deg * DEG), 1) for deg in pulses_us} == pytest.approx(pulses_us, abs=0.11)


def test_angle_that_is_not_finite_has_the_pulse_of_the_centre(make):
    scale = PulseScale.of(make(centre_us=1480.0))
    assert {scale.pulse_us(angle_rad) for angle_rad in (math.nan, math.inf, -math.inf)} == {1480.0}


def test_limited_pulse_is_noticed_on_both_sides(make):
    scale = PulseScale.of(make(us_per_rad=1000.0, min_us=1100.0, max_us=1900.0))
    angles_rad = (0.4, 0.401, 0.40105, -0.4, -0.4005, -0.40105)  # more than 1 us
    assert [scale.is_limited(angle) for angle in angles_rad] == [False, False, True] * 2
    scale = PulseScale.of(make(minus_us=1100.0, plus_us=1800.0, end_deg=40.0, min_us=1200.0, max_us=1700.0))
    assert [scale.is_limited(deg * DEG) for deg in (26.0, 27.0, -29.0, -31.0)] == [False, True] * 2


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"centre_us": 900.0}, "centre_us: 900 is outside min_us 1000 to max_us 2000"),
        ({"centre_us": 2100.0}, "centre_us: 2100 is outside min_us 1000 to max_us 2000"),
        ({"min_us": 1600.0}, "centre_us: 1500 is outside min_us 1600 to max_us 2000"),
        ({"plus_us": 1800.0}, "minus_us: give minus_us and plus_us, or neither"),
        ({"minus_us": 1200.0}, "minus_us: give minus_us and plus_us, or neither"),
        ({"minus_us": 1600.0, "plus_us": 1800.0}, "centre_us 1500 is not between"),
        ({"minus_us": 1500.0, "plus_us": 1800.0}, "centre_us 1500 is not between"),
        ({"reversed": 1}, "reversed: expected true or false"),
    ],
)
def test_contradictory_options_are_refused(make, values, text):
    with pytest.raises(ValueError, match=text):
        make(**values)
