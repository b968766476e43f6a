"""Distances, bearings, lines and offsets on a spherical earth.

Great circles are exact on the sphere; its error against the ellipsoid is at most 0.6 % of a distance. Three planes
serve for places near each other: the tangential plane (`offset_m`), the mid-latitude approximation (`nearby_offset_m`,
fast), and the local frame of MAVLink (`local_offset_m` and its inverse `at_local_offset`).
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp, wrap_two_pi

EARTH_RADIUS_M = 6371008.8  # mean radius, IUGG
Vector = tuple[float, float, float]
MIN_COS_LATITUDE = 1e-3  # 6 km from a pole
UNSET_RAD = 1e-6  # 6 m
HIGHEST_LATITUDE_RAD = math.radians(89.9)
SHORTEST_LINE = 1e-9  # earth radii; a line of 6 mm has no direction


class Place(msgspec.Struct, frozen=True):
    """A place on the sphere."""

    latitude_rad: float
    longitude_rad: float

    def offset_m(self, other: Place) -> tuple[float, float]:
        """Return the north and east offset [m] of another place on the tangential plane."""
        distance_m, bearing_rad = self.distance_and_bearing(other)
        return distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)

    def distance_and_bearing(self, other: Place) -> tuple[float, float]:
        """Return the great-circle distance [m] and the initial bearing [rad, from true north] of another place.

        Haversine formula (Sinnott, Sky and Telescope 68(2):159, 1984), accurate from metres to half the globe.
        """
        latitude_rad, other_rad = self.latitude_rad, other.latitude_rad
        half_latitude_rad = 0.5 * (other_rad - latitude_rad)
        longitude_change_rad = other.longitude_rad - self.longitude_rad
        haversine = (
            math.sin(half_latitude_rad) ** 2
            + math.cos(latitude_rad) * math.cos(other_rad) * math.sin(0.5 * longitude_change_rad) ** 2
        )
        distance_m = 2.0 * EARTH_RADIUS_M * math.asin(math.sqrt(min(1.0, haversine)))
        bearing_rad = math.atan2(
            math.sin(longitude_change_rad) * math.cos(other_rad),
            math.cos(latitude_rad) * math.sin(other_rad)
            - math.sin(latitude_rad) * math.cos(other_rad) * math.cos(longitude_change_rad),
        )
        return distance_m, wrap_two_pi(bearing_rad)

    def nearby_offset_m(self, other: Place) -> tuple[float, float]:
        """Return the north and east offset [m] of a place within some kilometres, by the mid-latitude."""
        east_rad = math.remainder(other.longitude_rad - self.longitude_rad, 2.0 * math.pi)
        return (
            EARTH_RADIUS_M * (other.latitude_rad - self.latitude_rad),
            EARTH_RADIUS_M * math.cos(0.5 * (self.latitude_rad + other.latitude_rad)) * east_rad,
        )

    def local_offset_m(self, other: Place) -> tuple[float, float]:
        """Return the north and east offset [m] of another place in the local frame of MAVLink."""
        east_rad = math.remainder(other.longitude_rad - self.longitude_rad, 2.0 * math.pi)
        return (
            (other.latitude_rad - self.latitude_rad) * EARTH_RADIUS_M,
            east_rad * EARTH_RADIUS_M * math.cos(self.latitude_rad),
        )

    def at_local_offset(self, north_m: float, east_m: float) -> Place | None:
        """Return the place at an offset in the local frame of MAVLink; None beyond a pole."""
        latitude_rad = self.latitude_rad + north_m / EARTH_RADIUS_M
        shrink = math.cos(self.latitude_rad)
        if not (abs(latitude_rad) < math.pi / 2.0 and shrink > MIN_COS_LATITUDE):
            return None
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * shrink)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))

    def at_offset(self, north_m: float, east_m: float) -> Place:
        """Return the place at an offset of up to some kilometres."""
        latitude_rad = clamp(self.latitude_rad + north_m / EARTH_RADIUS_M, -0.5 * math.pi, 0.5 * math.pi)
        shrink = max(math.cos(latitude_rad), 1e-6)
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * shrink)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))


def is_possible_position(latitude_rad: float, longitude_rad: float) -> bool:
    """Return whether a position is possible; False for NaN and for 0 N 0 E, which means unknown."""
    if abs(latitude_rad) < UNSET_RAD and abs(longitude_rad) < UNSET_RAD:
        return False
    return abs(latitude_rad) <= HIGHEST_LATITUDE_RAD and abs(longitude_rad) <= math.pi


class Track(msgspec.Struct, frozen=True):
    """Position relative to a line: cross-track error (positive to starboard), distance to go, course of the line."""

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
    """Return the position relative to the great circle from start to end; None if these coincide or are antipodal."""
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
    """Return the course of a tangent vector."""
    shrink = math.hypot(at[0], at[1])
    east = (-at[1] / shrink, at[0] / shrink, 0.0) if shrink > SHORTEST_LINE else (0.0, 1.0, 0.0)
    return wrap_two_pi(math.atan2(_dot(along, east), _dot(along, _cross(at, east))))
