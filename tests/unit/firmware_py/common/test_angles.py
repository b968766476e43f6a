"""Wrapping and limiting of angles."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common import angles
from firmware_py.common.angles import clamp, compass_degrees, degrees, radians, wrap_pi, wrap_two_pi

ANGLES = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("angle_rad", "expected_rad"),
    [(0.0, 0.0), (math.pi, -math.pi), (-math.pi, -math.pi), (3.5, 3.5 - 2 * math.pi), (-3.5, 2 * math.pi - 3.5)],
)
def test_wrap_pi_at_its_limits(angle_rad, expected_rad):
    assert wrap_pi(angle_rad) == pytest.approx(expected_rad, abs=1e-12)


@given(ANGLES)
def test_wrap_pi_is_half_open_and_keeps_the_direction(angle_rad):
    wrapped_rad = wrap_pi(angle_rad)
    assert -math.pi <= wrapped_rad < math.pi
    assert math.cos(wrapped_rad) == pytest.approx(math.cos(angle_rad), abs=1e-8)
    assert math.sin(wrapped_rad) == pytest.approx(math.sin(angle_rad), abs=1e-8)


@given(st.floats())
def test_wrap_two_pi_is_half_open_or_nan(angle_rad):
    wrapped_rad = wrap_two_pi(angle_rad)
    if math.isfinite(angle_rad):
        assert 0.0 <= wrapped_rad < 2.0 * math.pi
    else:
        assert math.isnan(wrapped_rad)
        assert math.isnan(wrap_pi(angle_rad))


@given(ANGLES)
def test_wrapping_equals_fmod_bit_for_bit(angle_rad):
    """The lab computes with the same bits, and earlier logs must be replayed."""

    def remainder(number):
        rest = math.fmod(number, 2.0 * math.pi)
        return rest + 2.0 * math.pi if rest < 0.0 else rest

    minus_pi_to_pi, zero_to_two_pi = remainder(angle_rad + math.pi) - math.pi, remainder(angle_rad)
    assert wrap_pi(angle_rad) == (-math.pi if minus_pi_to_pi >= math.pi else minus_pi_to_pi)
    assert wrap_two_pi(angle_rad) == (0.0 if zero_to_two_pi >= 2.0 * math.pi else zero_to_two_pi)


def test_rounding_does_not_give_a_full_turn():
    for angle_rad in (-1e-17, 2 * math.pi, math.nextafter(2 * math.pi, 0.0), -5e-324):
        assert 0.0 <= wrap_two_pi(angle_rad) < 2 * math.pi
        assert 0.0 <= compass_degrees(angle_rad) < 360.0
    # The sum in wrap_pi is rounded up to a full turn.
    assert wrap_pi(math.nextafter(-math.pi, -math.inf)) == -math.pi


def test_units_are_converted():
    assert pytest.approx(1852.0) == angles.METRES_PER_SECOND_PER_KNOT * 3600.0
    assert pytest.approx(3600.0) == angles.KNOTS_PER_METRE_PER_SECOND * 1852.0
    assert (radians(180.0), degrees(math.pi)) == pytest.approx((math.pi, 180.0))


def test_compass_degrees_are_0_to_360():
    angles_rad = (0.0, 0.5 * math.pi, -0.5 * math.pi, 2.5 * math.pi)
    assert [compass_degrees(angle_rad) for angle_rad in angles_rad] == pytest.approx([0.0, 90.0, 270.0, 90.0])


def test_clamp_limits_and_keeps_nan():
    assert [clamp(value, -1.0, 2.0) for value in (-5.0, 0.5, 7.0)] == [-1.0, 0.5, 2.0]
    assert math.isnan(clamp(math.nan, -1.0, 2.0))
