"""Errors of an uncorrected magnetic compass: deviation, heel error, lag.

    output = heading - (A + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi) - h cos psi,   then a first-order lag

Deviation is positive to the east, so the compass reads less (Handbook of Magnetic Compass Adjustment, NGA 2004). The
handbook gives it as a function of the compass heading; here it is one of the true heading. The difference is of second
order in the coefficients.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.ship.disturbances import Compass
from hil.ship.waves import WaveYaw


class CompassErrors:
    """The heading output of the compass, unwrapped, one grid step at a time."""

    def __init__(self, errors: Compass, step_s: float, roll: WaveYaw) -> None:
        """Start without lag; `roll` is the heel error on a northerly heading, which varies with the waves."""
        coefficients_deg = (errors.a_deg, errors.b_deg, errors.c_deg, errors.d_deg, errors.e_deg)
        self._coefficients = tuple(radians(angle_deg) for angle_deg in coefficients_deg)
        self._lag_s = errors.lag_s
        self._lag_gain = 1.0 if errors.lag_s <= 0.0 else -math.expm1(-step_s / errors.lag_s)
        self._step_s = step_s
        self._roll = roll
        self.roll_ratio = 1.0  # wave amplitude relative to its mean
        self._output_rad: float | None = None

    def step(self, heading_rad: float) -> None:
        """Advance one grid step that ends on this heading."""
        self._roll.step()
        sensed_rad = self._sensed_rad(heading_rad, 0.0)
        if self._output_rad is None:
            self._output_rad = sensed_rad
        self._output_rad += self._lag_gain * (sensed_rad - self._output_rad)

    def output_rad(self, heading_rad: float, offset_s: float) -> float:
        """Return the output offset_s into the present step, for a true heading at that time."""
        sensed_rad = self._sensed_rad(heading_rad, offset_s)
        if self._lag_s <= 0.0 or self._output_rad is None:
            return sensed_rad
        return self._output_rad - math.expm1(-offset_s / self._lag_s) * (sensed_rad - self._output_rad)

    def _sensed_rad(self, heading_rad: float, offset_s: float) -> float:
        a, b, c, d, e = self._coefficients
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        deviation_rad = a + b * sine + c * cosine + d * 2.0 * sine * cosine + e * (cosine * cosine - sine * sine)
        return heading_rad - deviation_rad - self.roll_ratio * self._roll.angle_rad(offset_s) * cosine
