"""Distances, bearings, lines and offsets on a spherical earth.

Great circles are exact on the sphere; its error against the ellipsoid is at most 0.6 % of a distance. Nearby places
have three plane approximations: the tangential plane (`offset_m`), the mid-latitude approximation (`nearby_offset_m`,
fast), and the local frame of MAVLink (`local_offset_m` and its inverse `at_local_offset`).
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp, wrap_two_pi

EARTH_RADIUS_M = 6371008.8  # mean radius, IUGG
Vector = tuple[float, float, float]
MIN_COS_LATITUDE = 1e-3  # 6 km from a pole
UNSET_RAD = 1e-6  # 6 m; a receiver without a fix may send 0 N 0 E
MAX_LATITUDE_RAD = math.radians(89.9)
MIN_LINE_RADII = 1e-9  # minimum length of a line, 6 mm, in earth radii; a shorter one has no defined course


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
        """Return the place at an offset in the local frame of MAVLink; None beyond a pole, or near one."""
        latitude_rad = self.latitude_rad + north_m / EARTH_RADIUS_M
        cos_latitude = math.cos(self.latitude_rad)
        if not (abs(latitude_rad) < math.pi / 2.0 and cos_latitude > MIN_COS_LATITUDE):
            return None
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * cos_latitude)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))

    def at_offset(self, north_m: float, east_m: float) -> Place:
        """Return the place at an offset of up to some kilometres."""
        latitude_rad = clamp(self.latitude_rad + north_m / EARTH_RADIUS_M, -0.5 * math.pi, 0.5 * math.pi)
        cos_latitude = max(math.cos(latitude_rad), 1e-6)
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * cos_latitude)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))


def is_possible_position(latitude_rad: float, longitude_rad: float) -> bool:
    """Return whether a position is possible; False for NaN and for 0 N 0 E, which means unknown."""
    if abs(latitude_rad) < UNSET_RAD and abs(longitude_rad) < UNSET_RAD:
        return False
    return abs(latitude_rad) <= MAX_LATITUDE_RAD and abs(longitude_rad) <= math.pi


class Track(msgspec.Struct, frozen=True):
    """Position relative to a line: cross-track error (positive to starboard), distance to go, course of the line."""

    cross_track_m: float
    remaining_m: float  # negative beyond the end
    course_rad: float


def _unit_vector(place: Place) -> Vector:
    cos_latitude = math.cos(place.latitude_rad)
    return (
        cos_latitude * math.cos(place.longitude_rad),
        cos_latitude * math.sin(place.longitude_rad),
        math.sin(place.latitude_rad),
    )


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def track(start: Place, end: Place, position: Place) -> Track | None:
    """Return the position relative to the great circle from start to end.

    None if these coincide or are antipodal, or if the position is 90 degrees from the whole great circle.
    """
    a, b, p = _unit_vector(start), _unit_vector(end), _unit_vector(position)
    normal = _cross(a, b)
    length = math.sqrt(_dot(normal, normal))
    if length < MIN_LINE_RADII:
        return None
    n = (normal[0] / length, normal[1] / length, normal[2] / length)
    normal_part = _dot(p, n)
    projection = (p[0] - normal_part * n[0], p[1] - normal_part * n[1], p[2] - normal_part * n[2])
    projection_length = math.sqrt(_dot(projection, projection))
    if projection_length < MIN_LINE_RADII:
        return None
    f = (projection[0] / projection_length, projection[1] / projection_length, projection[2] / projection_length)
    remaining_rad = math.atan2(_dot(_cross(f, b), n), _dot(f, b))
    return Track(
        -EARTH_RADIUS_M * math.asin(clamp(normal_part, -1.0, 1.0)),
        EARTH_RADIUS_M * remaining_rad,
        _tangent_course_rad(f, _cross(n, f)),
    )


def _tangent_course_rad(point: Vector, tangent: Vector) -> float:
    """Return the course of a tangent vector at a point."""
    cos_latitude = math.hypot(point[0], point[1])
    east = (
        (-point[1] / cos_latitude, point[0] / cos_latitude, 0.0) if cos_latitude > MIN_LINE_RADII else (0.0, 1.0, 0.0)
    )
    return wrap_two_pi(math.atan2(_dot(tangent, east), _dot(tangent, _cross(point, east))))
