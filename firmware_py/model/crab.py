"""Velocity triangle: speed through the water, current, and velocity over ground."""

from __future__ import annotations

import math

from firmware_py.common.angles import clamp, wrap_two_pi

# Limits the crab angle, so that the boat always has speed along the course.
MAX_CRAB_SINE = 0.95  # sine of the angle
TRANSITION_RAD = 2.0  # decrease of the edge angle per excess of the speed ratio over 1


def heading_for_course(
    course_rad: float, speed_m_s: float, north_m_s: float, east_m_s: float, leeway_rad: float = 0.0
) -> float:
    """Return the heading for a course over ground in a current with the components north and east.

    The course through the water is leeway_rad to starboard of the heading.

    If the cross current is nearly as fast as the boat or faster, no heading gives the course. In a current slower than
    the boat, the heading is then that of the maximum crab angle. In a faster one, only courses near its direction are
    possible: the heading is that for the nearest possible course or, if the boat cannot approach, of the smallest loss.
    """
    across_m_s = east_m_s * math.cos(course_rad) - north_m_s * math.sin(course_rad)
    if speed_m_s <= 0.0:
        return wrap_two_pi(course_rad)
    crab_rad = math.asin(clamp(across_m_s / speed_m_s, -MAX_CRAB_SINE, MAX_CRAB_SINE))
    current_m_s = math.hypot(north_m_s, east_m_s)
    if current_m_s > speed_m_s:
        along_m_s = north_m_s * math.cos(course_rad) + east_m_s * math.sin(course_rad)
        current_angle_rad = math.acos(clamp(along_m_s / current_m_s, -1.0, 1.0))
        max_crab_rad = max(0.0, _edge_rad(current_m_s / speed_m_s) + 0.5 * math.pi - current_angle_rad)
        crab_rad = clamp(crab_rad, -max_crab_rad, max_crab_rad)
    return wrap_two_pi(course_rad - crab_rad - leeway_rad)


def _edge_rad(ratio: float) -> float:
    """Return the largest angle between a course over ground and a current that is `ratio` times as fast as the boat.

    The exact angle drops abruptly at a ratio of 1, within the accuracy of the estimates, so the transition is smoothed.
    """
    return max(math.asin(1.0 / ratio), 0.5 * math.pi - TRANSITION_RAD * (ratio - 1.0))


def speed_made_good(course_rad: float, speed_m_s: float, north_m_s: float, east_m_s: float) -> float:
    """Return the speed over ground along a course; 0 or less if the boat cannot follow the course."""
    along_m_s = north_m_s * math.cos(course_rad) + east_m_s * math.sin(course_rad)
    across_m_s = east_m_s * math.cos(course_rad) - north_m_s * math.sin(course_rad)
    along_square = speed_m_s * speed_m_s - across_m_s * across_m_s
    return along_m_s + math.sqrt(along_square) if along_square > 0.0 else min(0.0, along_m_s)


def against_current(north_m_s: float, east_m_s: float) -> float:
    """Return the heading against a current with the components north and east."""
    return wrap_two_pi(math.atan2(-east_m_s, -north_m_s))
