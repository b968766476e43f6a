"""What a compass as bought makes of the heading: deviation, heel error, lag.

    shown = heading - (A + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi) - h cos psi,   then a first-order lag

Deviation is positive to the east, so the compass shows less (Handbook of Magnetic Compass Adjustment, NGA 2004).
It is a function of the compass's own heading there; here of the true one, which differs by products of
coefficients. h is the heel error on north: it rolls with the waves.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.ship.extras import Compass
from hil.ship.waves import WaveYaw


class BoughtCompass:
    """What is shown, unwrapped, one grid step at a time."""

    def __init__(self, how: Compass, step_s: float, roll: WaveYaw) -> None:
        """Take the coefficients; `roll` is the heel error on north as it rolls with the waves."""
        self._coefficients = tuple(radians(one) for one in (how.a_deg, how.b_deg, how.c_deg, how.d_deg, how.e_deg))
        self._lag_s = how.lag_s
        self._follow = 1.0 if how.lag_s <= 0.0 else -math.expm1(-step_s / how.lag_s)
        self._step_s = step_s
        self._roll = roll
        self.roll_share = 1.0  # of the roll, when the waves die
        self._shown_rad: float | None = None

    def step(self, heading_rad: float) -> None:
        """Move on to the next grid step, that ends on a heading."""
        self._roll.step()
        sensed_rad = self._sensed_rad(heading_rad, 0.0)
        if self._shown_rad is None:
            self._shown_rad = sensed_rad
        self._shown_rad += self._follow * (sensed_rad - self._shown_rad)

    def shown_rad(self, heading_rad: float, offset_s: float) -> float:
        """Return what it shows offset_s into the present step, with the boat on a heading then."""
        sensed_rad = self._sensed_rad(heading_rad, offset_s)
        if self._lag_s <= 0.0 or self._shown_rad is None:
            return sensed_rad
        return self._shown_rad - math.expm1(-offset_s / self._lag_s) * (sensed_rad - self._shown_rad)

    def _sensed_rad(self, heading_rad: float, offset_s: float) -> float:
        a, b, c, d, e = self._coefficients
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        deviation_rad = a + b * sine + c * cosine + d * 2.0 * sine * cosine + e * (cosine * cosine - sine * sine)
        return heading_rad - deviation_rad - self.roll_share * self._roll.angle_rad(offset_s) * cosine
