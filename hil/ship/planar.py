"""Track of the hull over the ground (Wang et al. 2018, eq. 1-2), and current: steady, or an ellipse with the tide."""

from __future__ import annotations

import math

from firmware_py.common.angles import TWO_PI

M2_S = 44_712.0  # the principal lunar tide: 12.42 h


class Tide:
    """A current of `speed_m_s` that flows toward an angle at time 0.

    With a period it follows an ellipse: `rotary` is the ratio of its minor to its major axis, 0 for a current that
    reverses, 1 for one that turns clockwise at constant speed, negative for anticlockwise.
    """

    def __init__(self, speed_m_s: float, toward_rad: float, period_s: float = 0.0, rotary: float = 0.0) -> None:
        """Set the ellipse; a period of 0 is a steady current."""
        self._north_m_s = speed_m_s * math.cos(toward_rad)
        self._east_m_s = speed_m_s * math.sin(toward_rad)
        self._period_s = period_s
        self._rotary = rotary

    def velocity_m_s(self, t_s: float) -> tuple[float, float]:
        """Return the velocity of the water, north and east."""
        if self._period_s <= 0.0:
            return self._north_m_s, self._east_m_s
        phase_rad = TWO_PI * math.fmod(t_s, self._period_s) / self._period_s
        along, across = math.cos(phase_rad), self._rotary * math.sin(phase_rad)
        return (along * self._north_m_s - across * self._east_m_s, along * self._east_m_s + across * self._north_m_s)


class PlanarMotion:
    """Position north and east [m] of the start, from speed, heading and current.

    `speed_m_s` is the velocity through the water along the heading, `sideways_m_s` the one across it, to starboard:
    leeway and sway (hil/ship/sideways.py), otherwise 0.
    """

    def __init__(self, speed_m_s: float, tide: Tide) -> None:
        """Start at the origin."""
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
