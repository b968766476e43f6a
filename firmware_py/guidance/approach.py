"""Closest point of approach to another vessel at constant velocities, in closed form on a plane."""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.vessels import VesselPosition

Velocity = tuple[float, float]  # north and east, m/s


class RelativeMotion(msgspec.Struct, frozen=True):
    """Position of a vessel relative to the boat, and its velocity over ground; north and east."""

    north_m: float
    east_m: float
    north_m_s: float
    east_m_s: float

    def closest_approach(self, own_m_s: Velocity, horizon_s: float) -> tuple[float, float]:
        """Return the smallest distance [m] within `horizon_s` and its time [s]; `own_m_s`: velocity of the boat."""
        north_m_s, east_m_s = self.north_m_s - own_m_s[0], self.east_m_s - own_m_s[1]
        speed_squared = north_m_s * north_m_s + east_m_s * east_m_s
        time_s = 0.0
        if speed_squared > 0.0:
            time_s = -(self.north_m * north_m_s + self.east_m * east_m_s) / speed_squared
            time_s = min(max(time_s, 0.0), horizon_s)
        return math.hypot(self.north_m + north_m_s * time_s, self.east_m + east_m_s * time_s), time_s


def relative_motion(own: Place, position: VesselPosition, now_s: float) -> RelativeMotion:
    """Return the present relative position and the velocity of a vessel, extrapolated from its last report."""
    north_m, east_m = own.nearby_offset_m(Place(position.latitude_rad, position.longitude_rad))
    north_m_s, east_m_s = velocity(position)
    age_s = now_s - position.t_s
    return RelativeMotion(north_m + north_m_s * age_s, east_m + east_m_s * age_s, north_m_s, east_m_s)


def velocity(position: VesselPosition) -> Velocity:
    """Return the velocity of a vessel over ground, north and east in m/s; zero if speed or course is unknown."""
    if position.speed_m_s is None or position.course_rad is None:
        return 0.0, 0.0
    return position.speed_m_s * math.cos(position.course_rad), position.speed_m_s * math.sin(position.course_rad)
