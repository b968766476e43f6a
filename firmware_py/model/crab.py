"""The triangle of velocities: through the water, of the water, over the ground."""

from __future__ import annotations

import math

from firmware_py.common.angles import clamp, wrap_two_pi

# The boat never steers further off a course than this, so that it keeps making way against the rest of the current.
LARGEST_CRAB = 0.95  # sine of the angle
EDGE_RAD = 2.0  # of course, for a current that is stronger by the boat's own speed


def heading_for_course(
    course_rad: float, speed_m_s: float, north_m_s: float, east_m_s: float, leeway_rad: float = 0.0
) -> float:
    """Return the heading that makes a course over ground good in a current that sets north and east.

    The way through the water lies leeway_rad to starboard of the heading.

    Where the current across the course is as fast as the boat no heading does. In a weaker current the one that is
    returned then points mostly into it. A stronger one leaves her only the courses to either side of its own: she goes
    at its edge by the one that is nearest, and where that leads away, too, by the heading that loses least of the way.
    """
    across_m_s = east_m_s * math.cos(course_rad) - north_m_s * math.sin(course_rad)
    if speed_m_s <= 0.0:
        return wrap_two_pi(course_rad)
    crab_rad = math.asin(clamp(across_m_s / speed_m_s, -LARGEST_CRAB, LARGEST_CRAB))
    current_m_s = math.hypot(north_m_s, east_m_s)
    if current_m_s > speed_m_s:
        along_m_s = north_m_s * math.cos(course_rad) + east_m_s * math.sin(course_rad)
        off_rad = math.acos(clamp(along_m_s / current_m_s, -1.0, 1.0))
        most_rad = max(0.0, _edge_rad(current_m_s / speed_m_s) + 0.5 * math.pi - off_rad)
        crab_rad = clamp(crab_rad, -most_rad, most_rad)
    return wrap_two_pi(course_rad - crab_rad - leeway_rad)


def _edge_rad(ratio: float) -> float:
    """Return how far off a current that is so many times as fast as the boat her courses reach.

    Barely stronger it takes them away all at once, by no more than estimates of it scatter: there it is less abrupt.
    """
    return max(math.asin(1.0 / ratio), 0.5 * math.pi - EDGE_RAD * (ratio - 1.0))


def speed_made_good(course_rad: float, speed_m_s: float, north_m_s: float, east_m_s: float) -> float:
    """Return the speed over ground that the boat can make on a course; 0 or less when it cannot make it good."""
    along_m_s = north_m_s * math.cos(course_rad) + east_m_s * math.sin(course_rad)
    across_m_s = east_m_s * math.cos(course_rad) - north_m_s * math.sin(course_rad)
    spare = speed_m_s * speed_m_s - across_m_s * across_m_s
    return along_m_s + math.sqrt(spare) if spare > 0.0 else min(0.0, along_m_s)


def against_current(north_m_s: float, east_m_s: float) -> float:
    """Return the heading straight into a current that sets north and east."""
    return wrap_two_pi(math.atan2(-east_m_s, -north_m_s))
