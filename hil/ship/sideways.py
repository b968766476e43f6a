"""Velocity across the heading: leeway, and sway in a turn. Positive to starboard.

    v = U tan(beta + beta_wind sin(psi - psi_wind)) + v_slide      m22 dv_slide/dt = -m11 U r + Yv U v_slide

The wind comes from psi_wind; a wind from starboard sets the boat to port. v_slide is the sway of Wang et al.
2018, eq. 2 (hil/ship/manoeuvring.py), which is outward, so it is negative in a turn to starboard.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.ship.disturbances import Leeway, Slide
from hil.ship.manoeuvring import sway_ratios
from hil.ship.regressions import FLOAT, sway_model


class Sideways:
    """The velocity across the heading [m/s], one grid step at a time."""

    def __init__(self, leeway: Leeway | None, slide: Slide | None, step_s: float) -> None:
        """Start without sway."""
        leeway = leeway or Leeway(0.0)
        self._body_rad, self._wind_rad = radians(leeway.body_deg), radians(leeway.wind_deg)
        self._from_rad = radians(leeway.wind_from_deg)
        self._slide_share = 0.0 if slide is None else slide.share
        self._drive, self._damping_1_m = sway_ratios(sway_model(FLOAT), 1.0)
        self._step_s = step_s
        self._slide_m_s = 0.0

    def step(self, heading_rad: float, yaw_rate_rad_s: float, speed_m_s: float) -> float:
        """Advance one grid step, with values from its middle; return the velocity to starboard."""
        angle_rad = self._body_rad + self._wind_rad * math.sin(heading_rad - self._from_rad)
        if self._slide_share:
            # Exact for a steady turn; drive and damping are both proportional to the speed.
            steady_m_s = -self._drive / self._damping_1_m * yaw_rate_rad_s
            decay = math.exp(self._damping_1_m * speed_m_s * self._step_s)
            self._slide_m_s = steady_m_s + decay * (self._slide_m_s - steady_m_s)
        return speed_m_s * math.tan(angle_rad) + self._slide_share * self._slide_m_s
