"""The current over the ground: steady, running to and fro, or turning round with the tide."""

from __future__ import annotations

import math

from firmware_py.common.angles import TWO_PI

M2_S = 44_712.0  # the principal lunar tide: 12.42 h


class Tide:
    """A current of `speed_m_s` that sets toward an angle at time 0.

    With a period it follows an ellipse: `rotary` is its lesser half axis by the greater one,
    0 for a stream that runs to and fro, 1 for one that turns clockwise at full strength, negative for anticlockwise.
    """

    def __init__(self, speed_m_s: float, toward_rad: float, period_s: float = 0.0, rotary: float = 0.0) -> None:
        """Take the ellipse; a period of 0 is a steady current."""
        self._north_m_s = speed_m_s * math.cos(toward_rad)
        self._east_m_s = speed_m_s * math.sin(toward_rad)
        self._period_s = period_s
        self._rotary = rotary

    def velocity_m_s(self, t_s: float) -> tuple[float, float]:
        """Return where the water goes, north and east."""
        if self._period_s <= 0.0:
            return self._north_m_s, self._east_m_s
        phase_rad = TWO_PI * math.fmod(t_s, self._period_s) / self._period_s
        along, across = math.cos(phase_rad), self._rotary * math.sin(phase_rad)
        return (
            along * self._north_m_s - across * self._east_m_s,
            along * self._east_m_s + across * self._north_m_s,
        )
