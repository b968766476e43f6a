"""Angle wrapping and conversion of units."""

from __future__ import annotations

import math

DEGREES_PER_RADIAN = 180.0 / math.pi
RADIANS_PER_DEGREE = math.pi / 180.0
KNOTS_PER_METRE_PER_SECOND = 3600.0 / 1852.0
METRES_PER_SECOND_PER_KNOT = 1852.0 / 3600.0
PI = math.pi
TWO_PI = 2.0 * math.pi


def wrap_pi(angle_rad: float) -> float:
    """Return the angle in [-pi, pi); NaN for an angle that is not finite."""
    result_rad = (angle_rad + PI) % TWO_PI - PI
    if result_rad < PI:
        return result_rad
    # Rounding in the sum must not produce +pi.
    return -PI if result_rad >= PI else math.nan


def wrap_two_pi(angle_rad: float) -> float:
    """Return the angle in [0, 2 pi); NaN for an angle that is not finite."""
    wrapped_rad = angle_rad % TWO_PI
    if wrapped_rad < TWO_PI:
        return wrapped_rad
    return 0.0 if wrapped_rad >= TWO_PI else math.nan


def radians(angle_deg: float) -> float:
    """Convert degrees to radians."""
    return angle_deg * RADIANS_PER_DEGREE


def degrees(angle_rad: float) -> float:
    """Convert radians to degrees."""
    return angle_rad * DEGREES_PER_RADIAN


def compass_degrees(angle_rad: float) -> float:
    """Convert a heading in radians to degrees in [0, 360)."""
    return wrap_two_pi(angle_rad) * DEGREES_PER_RADIAN  # the largest angle below 2 pi gives less than 360


def clamp(value: float, low: float, high: float) -> float:
    """Limit a value to [low, high]; NaN stays NaN, unlike with min and max."""
    if value < low:
        return low
    return high if value > high else value
