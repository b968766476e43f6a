"""Averages of heading and velocity over ground: of a block of ten seconds, and of several while the boat goes straight.

Waves swing the bow to and fro within one, and a receiver's noise averages out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import PositionSample

BLOCK_S = 10.0
STRAIGHT_COSINE = math.cos(math.radians(15.0))
LEAST_VELOCITIES = 3
FASTEST_M_S = 6.0  # over the ground: more is a receiver's mistake


@dataclass(frozen=True, slots=True)
class Block:
    """Sums since start_s: headings as directions, velocities over ground, and the first position."""

    start_s: float
    cosine: float = 0.0
    sine: float = 0.0
    headings: int = 0
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    velocities: int = 0
    first: PositionSample | None = None
    last: PositionSample | None = None


@dataclass(frozen=True, slots=True)
class Average:
    """The mean of `blocks` blocks: sums of their directions of heading and velocities over ground."""

    cosine: float
    sine: float
    north_m_s: float
    east_m_s: float
    blocks: float = 1.0

    def has_heading_of(self, other: Average) -> bool:
        """Whether another average has the same heading, near enough."""
        dot = self.cosine * other.cosine + self.sine * other.sine
        return dot >= STRAIGHT_COSINE * math.hypot(self.cosine, self.sine) * math.hypot(other.cosine, other.sine)

    def weighted(self, part: float) -> Average:
        """Return the average with less weight."""
        return Average(
            part * self.cosine, part * self.sine, part * self.north_m_s, part * self.east_m_s, part * self.blocks
        )

    def plus(self, other: Average) -> Average:
        """Return the average of both."""
        return Average(
            self.cosine + other.cosine,
            self.sine + other.sine,
            self.north_m_s + other.north_m_s,
            self.east_m_s + other.east_m_s,
            self.blocks + other.blocks,
        )


def add_tick(block: Block, heading_rad: float, fixes: Sequence[PositionSample]) -> Block:
    """Return the block with the heading of one more tick and the fixes that came with it."""
    north, east, count, last = block.north_m_s, block.east_m_s, block.velocities, block.last
    for sample in fixes:
        last = sample
        speed_m_s, course_rad = sample.speed_over_ground_m_s, sample.course_over_ground_rad
        # Written so that NaN fails the comparisons; at rest a receiver gives no course.
        if speed_m_s is None or not 0.0 <= speed_m_s <= FASTEST_M_S:
            continue
        if course_rad is None or not math.isfinite(course_rad):
            if speed_m_s > 0.05:
                continue
            course_rad = 0.0
        north += speed_m_s * math.cos(course_rad)
        east += speed_m_s * math.sin(course_rad)
        count += 1
    return Block(
        block.start_s,
        block.cosine + math.cos(heading_rad),
        block.sine + math.sin(heading_rad),
        block.headings + 1,
        north,
        east,
        count,
        block.first,
        last,
    )


def mean_velocity(block: Block) -> tuple[float, float] | None:
    """Return the mean velocity over ground, north and east: the receiver's, or that of its positions."""
    if block.velocities >= LEAST_VELOCITIES:
        return block.north_m_s / block.velocities, block.east_m_s / block.velocities
    first, last = block.first, block.last
    if first is None or last is None or last.t_s - first.t_s < 2.0 * BLOCK_S:
        return None
    if None in (first.latitude_rad, first.longitude_rad, last.latitude_rad, last.longitude_rad):
        return None
    latitude_rad = last.latitude_rad or 0.0
    north_rad = latitude_rad - (first.latitude_rad or 0.0)
    east_rad = math.remainder((last.longitude_rad or 0.0) - (first.longitude_rad or 0.0), 2.0 * math.pi)
    per_rad = EARTH_RADIUS_M / (last.t_s - first.t_s)
    north_m_s, east_m_s = per_rad * north_rad, per_rad * math.cos(latitude_rad) * east_rad
    return (north_m_s, east_m_s) if math.hypot(north_m_s, east_m_s) <= FASTEST_M_S else None
