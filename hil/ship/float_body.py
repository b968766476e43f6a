"""Float dynamics: the float on its umbilical follows the heading of the glider below it.

    d2psi_f/dt2 = w^2 (psi_g - psi_f) - 2 z w dpsi_f/dt

psi_f and psi_g are the headings of float and glider, w the natural frequency, z the damping ratio.

This is the reduction to headings of the two bodies of Li, Pan, Liao et al. (Applied Mathematical Modelling, 2020).
The umbilical tension F with a lever l ahead of the float's centre gives the moment F l sin(psi_g - psi_f); the water
damps the turn; w^2 = F l / I with the moment of inertia I of float and entrained water. The reaction on the glider
is part of the identified K and T. Assumed, because no publication gives them: a tension of 10 to 60 N, 0.5 to 1 m
of lever, 80 to 200 kg m^2, so w = 0.2 to 0.9 rad/s; and an angle small enough to replace its sine.
"""

from __future__ import annotations

import math

Matrix = tuple[tuple[float, float], tuple[float, float]]


class FollowingFloat:
    """Heading and yaw rate of the float for each grid step; exact if the glider's heading is constant in a step."""

    def __init__(self, natural_frequency_rad_s: float, damping: float, step_s: float, heading_rad: float = 0.0) -> None:
        """Start at rest on the heading of the glider."""
        self._w2, self._damping_1_s = natural_frequency_rad_s**2, 2.0 * damping * natural_frequency_rad_s
        self._transition = transition(natural_frequency_rad_s, damping, step_s)
        self.heading_rad = heading_rad
        self.yaw_rate_rad_s = 0.0

    def step(self, glider_rad: float) -> None:
        """Advance one grid step; glider_rad is the glider's heading in the middle of the step."""
        (a00, a01), (a10, a11) = self._transition
        offset_rad, rate_rad_s = self.heading_rad - glider_rad, self.yaw_rate_rad_s
        self.heading_rad = glider_rad + a00 * offset_rad + a01 * rate_rad_s
        self.yaw_rate_rad_s = a10 * offset_rad + a11 * rate_rad_s

    def yaw_acceleration(self, glider_rad: float) -> float:
        """Return d2psi_f/dt2 [rad/s^2] with the glider on a heading."""
        return self._w2 * (glider_rad - self.heading_rad) - self._damping_1_s * self.yaw_rate_rad_s


def transition(natural_frequency_rad_s: float, damping: float, step_s: float) -> Matrix:
    """Return the matrix exponential of a step for (float heading minus glider heading, float yaw rate)."""
    decay_1_s = damping * natural_frequency_rad_s
    square = natural_frequency_rad_s**2 * (1.0 - damping * damping)
    if square > 0.0:
        damped_frequency_rad_s = math.sqrt(square)
        cosine = math.cos(damped_frequency_rad_s * step_s)
        sine = math.sin(damped_frequency_rad_s * step_s) / damped_frequency_rad_s
    elif square < 0.0:
        root_1_s = math.sqrt(-square)
        cosine, sine = math.cosh(root_1_s * step_s), math.sinh(root_1_s * step_s) / root_1_s
    else:
        cosine, sine = 1.0, step_s
    decay = math.exp(-decay_1_s * step_s)
    return (
        (decay * (cosine + decay_1_s * sine), decay * sine),
        (-decay * natural_frequency_rad_s**2 * sine, decay * (cosine - decay_1_s * sine)),
    )
