"""White noise of the yaw acceleration, which makes the heading diffuse.

    T dr/dt + r + alpha r^3 = K (delta - delta_0) + sqrt(D) dB/dt

B is a Wiener process and D the diffusion of the heading [deg^2/s]: over a time t much longer than T, the heading of a
boat with a fixed rudder has the variance D t. On the grid it is a jump of the yaw rate at the end of each step,
sqrt(D h) / T times a standard normal number.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.ship.noise import NormalNumbers

MAX_RATE_SIGMAS = 6.0  # practical bound of the yaw rate, for which the steps of the plant are chosen


class YawNoise:
    """Jumps of the yaw rate, one for each grid step."""

    def __init__(self, diffusion_deg2_s: float, step_s: float, numbers: NormalNumbers) -> None:
        """Set the diffusion of the heading; `numbers` are the standard normal numbers."""
        self._jump_rad = jump_rad(diffusion_deg2_s, step_s)
        self._numbers = numbers

    def jump_rad_s(self, turning_lag_s: float) -> float:
        """Return the next jump for a boat with a turning lag."""
        return self._jump_rad * self._numbers.draw() / turning_lag_s


def jump_rad(diffusion_deg2_s: float, step_s: float) -> float:
    """Return the standard deviation of a jump of the yaw rate, times the turning lag."""
    return radians(math.sqrt(diffusion_deg2_s * step_s))


def largest_rate_rad_s(diffusion_deg2_s: float, turning_lag_s: float) -> float:
    """Return a practical bound of the yaw rate that the noise alone causes."""
    return MAX_RATE_SIGMAS * radians(math.sqrt(diffusion_deg2_s / (2.0 * turning_lag_s)))
