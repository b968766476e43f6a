"""How near another vessel comes if both go on as they do: closest point of approach, on a plane, in closed form."""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.vessels import VesselPosition

Velocity = tuple[float, float]  # north and east, m/s


class Relative(msgspec.Struct, frozen=True):
    """Where a vessel is seen from the boat, and its velocity over ground; metres and m/s north and east."""

    north_m: float
    east_m: float
    north_m_s: float
    east_m_s: float

    def nearest(self, own_m_s: Velocity, within_s: float) -> tuple[float, float]:
        """Return how near the two come within a time from now, and when, for a velocity of the boat."""
        north_m_s, east_m_s = self.north_m_s - own_m_s[0], self.east_m_s - own_m_s[1]
        square = north_m_s * north_m_s + east_m_s * east_m_s
        when_s = 0.0
        if square > 0.0:
            when_s = -(self.north_m * north_m_s + self.east_m * east_m_s) / square
            when_s = min(max(when_s, 0.0), within_s)
        return math.hypot(self.north_m + north_m_s * when_s, self.east_m + east_m_s * when_s), when_s


def relative(own: Place, position: VesselPosition, now_s: float) -> Relative:
    """Return where a vessel is by now if it has gone on since its position, seen from the boat."""
    north_m, east_m = own.nearby_offset_m(Place(position.latitude_rad, position.longitude_rad))
    north_m_s, east_m_s = velocity(position)
    age_s = now_s - position.t_s
    return Relative(north_m + north_m_s * age_s, east_m + east_m_s * age_s, north_m_s, east_m_s)


def velocity(position: VesselPosition) -> Velocity:
    """Return a vessel's velocity over ground, none where speed or course is not told."""
    if position.speed_m_s is None or position.course_rad is None:
        return 0.0, 0.0
    return position.speed_m_s * math.cos(position.course_rad), position.speed_m_s * math.sin(position.course_rad)
