"""Great circles by unit vectors: how far along and how far off a line from one place to another.

Exact on the sphere from metres to half the globe; the sphere's error against the ellipsoid
is at most 0.6 % of a distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.common.angles import clamp, wrap_two_pi
from firmware_py.guidance.bearing import EARTH_RADIUS_M, distance_and_bearing

Vector = tuple[float, float, float]
SHORTEST_LINE = 1e-9  # in radii of the earth: a line of 6 mm has no direction


@dataclass(frozen=True, slots=True)
class Place:
    """A place on the sphere."""

    latitude_rad: float
    longitude_rad: float

    def offset_m(self, other: Place) -> tuple[float, float]:
        """Return how far north and east another place lies, on the plane that touches here."""
        distance_m, bearing_rad = self.distance_and_bearing(other)
        return distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)

    def distance_and_bearing(self, other: Place) -> tuple[float, float]:
        """Return distance and initial bearing of another place."""
        return distance_and_bearing(self.latitude_rad, self.longitude_rad, other.latitude_rad, other.longitude_rad)

    def moved(self, north_m: float, east_m: float) -> Place:
        """Return the place that lies north and east of here; good for some kilometres."""
        latitude_rad = clamp(self.latitude_rad + north_m / EARTH_RADIUS_M, -0.5 * math.pi, 0.5 * math.pi)
        shrink = max(math.cos(latitude_rad), 1e-6)
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * shrink)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))


@dataclass(frozen=True, slots=True)
class Track:
    """Where she is on a line: off it (positive to starboard), how far still to go, and the line's course here."""

    cross_track_m: float
    remaining_m: float  # negative beyond the end
    course_rad: float


def _vector(place: Place) -> Vector:
    shrink = math.cos(place.latitude_rad)
    return (
        shrink * math.cos(place.longitude_rad),
        shrink * math.sin(place.longitude_rad),
        math.sin(place.latitude_rad),
    )


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def track(start: Place, end: Place, here: Place) -> Track | None:
    """Return where she is on the line from start to end; None when the two are one place or opposite ones."""
    a, b, p = _vector(start), _vector(end), _vector(here)
    normal = _cross(a, b)
    length = math.sqrt(_dot(normal, normal))
    if length < SHORTEST_LINE:
        return None
    n = (normal[0] / length, normal[1] / length, normal[2] / length)
    off = _dot(p, n)
    foot = (p[0] - off * n[0], p[1] - off * n[1], p[2] - off * n[2])
    size = math.sqrt(_dot(foot, foot))
    if size < SHORTEST_LINE:
        return None
    f = (foot[0] / size, foot[1] / size, foot[2] / size)
    remaining_rad = math.atan2(_dot(_cross(f, b), n), _dot(f, b))
    return Track(
        -EARTH_RADIUS_M * math.asin(clamp(off, -1.0, 1.0)),
        EARTH_RADIUS_M * remaining_rad,
        _course(f, _cross(n, f)),
    )


def _course(at: Vector, along: Vector) -> float:
    """Return the course of a tangent vector at a place."""
    shrink = math.hypot(at[0], at[1])
    east = (-at[1] / shrink, at[0] / shrink, 0.0) if shrink > SHORTEST_LINE else (0.0, 1.0, 0.0)
    return wrap_two_pi(math.atan2(_dot(along, east), _dot(along, _cross(at, east))))
