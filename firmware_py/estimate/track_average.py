"""Velocity over the ground from positions alone, for a receiver that states none: the mean over a stretch of track."""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import PositionSample

STRETCH_S = 20.0  # in which the noise of two fixes comes to little, and a turn to no more than it must
LONGEST_S = 60.0
FASTEST_M_S = 6.0  # over the ground: more is a receiver's mistake


class Stretch(msgspec.Struct, frozen=True):
    """A stretch of track since a fix: the sums of the headings in it, as directions."""

    first: PositionSample
    cosine: float = 0.0
    sine: float = 0.0
    ticks: int = 0

    def with_heading(self, heading_rad: float) -> Stretch:
        """Return the stretch with the heading of one more tick."""
        return replace(
            self,
            cosine=self.cosine + math.cos(heading_rad),
            sine=self.sine + math.sin(heading_rad),
            ticks=self.ticks + 1,
        )


class MeanVelocity(msgspec.Struct, frozen=True):
    """Mean velocity over the ground, and meanwhile the mean direction of the heading, shorter than 1 in a turn."""

    t_s: float
    speed_m_s: float
    course_rad: float
    cosine: float
    sine: float


def take_fix(stretch: Stretch | None, fix: PositionSample) -> tuple[Stretch, MeanVelocity | None]:
    """Return the stretch under way after a fix, and the mean velocity of the one that it ends, if it does."""
    if stretch is None or not stretch.ticks or not 0.0 <= fix.t_s - stretch.first.t_s <= LONGEST_S:
        return Stretch(fix), None
    length_s = fix.t_s - stretch.first.t_s
    if length_s < STRETCH_S:
        return stretch, None
    first = stretch.first
    if None in (first.latitude_rad, first.longitude_rad, fix.latitude_rad, fix.longitude_rad):
        return Stretch(fix), None
    latitude_rad = fix.latitude_rad or 0.0
    north_rad = latitude_rad - (first.latitude_rad or 0.0)
    turned_rad = math.remainder((fix.longitude_rad or 0.0) - (first.longitude_rad or 0.0), 2.0 * math.pi)
    east_rad = math.cos(latitude_rad) * turned_rad
    speed_m_s = EARTH_RADIUS_M * math.hypot(north_rad, east_rad) / length_s
    if not speed_m_s <= FASTEST_M_S:
        return Stretch(fix), None
    cosine, sine = stretch.cosine / stretch.ticks, stretch.sine / stretch.ticks
    return Stretch(fix), MeanVelocity(fix.t_s, speed_m_s, math.atan2(east_rad, north_rad), cosine, sine)
