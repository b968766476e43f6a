"""The one earth of the firmware: a sphere, and on it distances, bearings, lines and offsets.

Great circles are exact on the sphere from metres to half the globe; the sphere's error against the
ellipsoid is at most 0.6 % of a distance. Offsets on a plane are for places near each other, and each
has its own: on the plane that touches here (`offset_m`), with the meridians of half way
(`nearby_offset_m`, cheap, for every fix), and the local frame of MAVLink (`local_offset_m` and
`at_local_offset`, which undo each other).
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp, wrap_two_pi

EARTH_RADIUS_M = 6371008.8  # mean radius, IUGG
Vector = tuple[float, float, float]
LEAST_SHRINK = 1e-3  # of a circle of latitude against the equator: 6 km from a pole
UNSET_RAD = 1e-6  # 6 m
HIGHEST_LATITUDE_RAD = math.radians(89.9)
SHORTEST_LINE = 1e-9  # in radii of the earth: a line of 6 mm has no direction


class Place(msgspec.Struct, frozen=True):
    """A place on the sphere."""

    latitude_rad: float
    longitude_rad: float

    def offset_m(self, other: Place) -> tuple[float, float]:
        """Return how far north and east another place lies, on the plane that touches here."""
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
        """Return how far north and east another place lies, the meridians taken half way; good for some kilometres."""
        east_rad = math.remainder(other.longitude_rad - self.longitude_rad, 2.0 * math.pi)
        return (
            EARTH_RADIUS_M * (other.latitude_rad - self.latitude_rad),
            EARTH_RADIUS_M * math.cos(0.5 * (self.latitude_rad + other.latitude_rad)) * east_rad,
        )

    def local_offset_m(self, other: Place) -> tuple[float, float]:
        """Return how far north and east another place lies in the local frame of here, as `at_local_offset` counts."""
        east_rad = math.remainder(other.longitude_rad - self.longitude_rad, 2.0 * math.pi)
        return (
            (other.latitude_rad - self.latitude_rad) * EARTH_RADIUS_M,
            east_rad * EARTH_RADIUS_M * math.cos(self.latitude_rad),
        )

    def at_local_offset(self, north_m: float, east_m: float) -> Place | None:
        """Return the place north and east of here in the local frame of here; None where that ends, at the poles."""
        latitude_rad = self.latitude_rad + north_m / EARTH_RADIUS_M
        shrink = math.cos(self.latitude_rad)
        if not (abs(latitude_rad) < math.pi / 2.0 and shrink > LEAST_SHRINK):
            return None
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * shrink)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))

    def at_offset(self, north_m: float, east_m: float) -> Place:
        """Return the place that lies north and east of here; good for some kilometres."""
        latitude_rad = clamp(self.latitude_rad + north_m / EARTH_RADIUS_M, -0.5 * math.pi, 0.5 * math.pi)
        shrink = max(math.cos(latitude_rad), 1e-6)
        longitude_rad = self.longitude_rad + east_m / (EARTH_RADIUS_M * shrink)
        return Place(latitude_rad, math.remainder(longitude_rad, 2.0 * math.pi))


def can_be(latitude_rad: float, longitude_rad: float) -> bool:
    """Return whether a boat can be there; 0 N 0 E is what a receiver gives that does not know. False for NaN."""
    if abs(latitude_rad) < UNSET_RAD and abs(longitude_rad) < UNSET_RAD:
        return False
    return abs(latitude_rad) <= HIGHEST_LATITUDE_RAD and abs(longitude_rad) <= math.pi


class Track(msgspec.Struct, frozen=True):
    """Where the boat is on a line: off it (positive to starboard), how far still to go, and the line's course here."""

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
    """Return where the boat is on the great circle from start to end; None when the two are one place or opposite."""
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
