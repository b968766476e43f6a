"""The track of the hull over the ground (the paper's eq. 1-2)."""

from __future__ import annotations

import math

from hil.ship.tide import Tide


class PlanarMotion:
    """Position north and east [m] of the start, from speed, heading and current.

    `speed_m_s` is the velocity through the water along the heading, `sideways_m_s` the one across it, to starboard:
    leeway and sway (hil/ship/sideways.py), otherwise 0.
    """

    def __init__(self, speed_m_s: float, tide: Tide) -> None:
        """Take the speed through the water and the current."""
        self.north_m = 0.0
        self.east_m = 0.0
        self.speed_m_s = speed_m_s
        self.sideways_m_s = 0.0
        self._tide = tide

    def velocity_m_s(self, heading_rad: float, t_s: float) -> tuple[float, float]:
        """Return the velocity over the ground, north and east, on a heading at a time."""
        north_m_s, east_m_s = self._tide.velocity_m_s(t_s)
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        return (
            self.speed_m_s * cosine - self.sideways_m_s * sine + north_m_s,
            self.speed_m_s * sine + self.sideways_m_s * cosine + east_m_s,
        )

    def step(self, mean_heading_rad: float, middle_s: float, step_s: float) -> None:
        """Advance by one step (second order in the step when heading and time are those of its middle)."""
        north_m_s, east_m_s = self.velocity_m_s(mean_heading_rad, middle_s)
        self.north_m += north_m_s * step_s
        self.east_m += east_m_s * step_s
