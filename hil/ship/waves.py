"""Wave-frequency motion of the hull, in yaw or along the waves: a narrow-band second-order process.

    d2psi/dt2 + 2 zeta omega dpsi/dt + omega^2 psi = white noise

It is added to the heading of the compass; the rudder has no effect on it. Its discretisation is exact, so spread and
spectrum do not depend on the grid step. The period is that of the peak of the spectrum, which damping moves below
omega.
"""

from __future__ import annotations

import math

from hil.ship.noise import NormalNumbers

DAMPING = 0.1


class WaveYaw:
    """Wave-frequency yaw on a fixed grid, readable at any time within the present grid step.

    Between the two ends of a step the angle is the cubic through both angles and rates.
    """

    def __init__(
        self, spread_rad: float, peak_period_s: float, step_s: float, numbers: NormalNumbers, damping: float = DAMPING
    ) -> None:
        """Start in the stationary state; spread_rad is the standard deviation, 0 for a calm sea."""
        self._step_s = step_s
        self._numbers = numbers
        self._is_calm = spread_rad <= 0.0
        self._start = self._end = (0.0, 0.0)
        if self._is_calm:
            return
        omega_rad_s = natural_frequency(peak_period_s, damping)
        spreads = (spread_rad, spread_rad * omega_rad_s)
        self._transition, self._noise = discretise(spreads, omega_rad_s, step_s, damping)
        self._start = (spreads[0] * numbers.draw(), spreads[1] * numbers.draw())
        self._end = self._advance(self._start)

    def step(self) -> None:
        """Advance one grid step."""
        if not self._is_calm:
            self._start, self._end = self._end, self._advance(self._end)

    def angle_rad(self, offset_s: float) -> float:
        """Return the angle offset_s into the present step."""
        if self._is_calm:
            return 0.0
        (y0, v0), (y1, v1) = self._start, self._end
        h = self._step_s
        x = offset_s / h
        return y0 + x * (h * v0 + x * (3.0 * (y1 - y0) - h * (2.0 * v0 + v1) + x * (2.0 * (y0 - y1) + h * (v0 + v1))))

    def rate_rad_s(self, offset_s: float) -> float:
        """Return the rate of the angle offset_s into the present step."""
        if self._is_calm:
            return 0.0
        (y0, v0), (y1, v1) = self._start, self._end
        h = self._step_s
        x = offset_s / h
        return v0 + x * (6.0 * (y1 - y0) / h - 2.0 * (2.0 * v0 + v1) + x * (6.0 * (y0 - y1) / h + 3.0 * (v0 + v1)))

    def _advance(self, state: tuple[float, float]) -> tuple[float, float]:
        (a00, a01), (a10, a11) = self._transition
        n00, n10, n11 = self._noise
        angle_rad, rate_rad_s = state
        noise_0, noise_1 = self._numbers.draw(), self._numbers.draw()
        return (
            a00 * angle_rad + a01 * rate_rad_s + n00 * noise_0,
            a10 * angle_rad + a11 * rate_rad_s + n10 * noise_0 + n11 * noise_1,
        )


Matrix = tuple[tuple[float, float], tuple[float, float]]


def natural_frequency(peak_period_s: float, damping: float) -> float:
    """Return omega [rad/s] for the period of the spectral peak, which is at omega sqrt(1 - 2 zeta^2)."""
    return 2.0 * math.pi / peak_period_s / math.sqrt(1.0 - 2.0 * damping**2)


def discretise(
    spreads: tuple[float, float], omega_rad_s: float, step_s: float, damping: float = DAMPING
) -> tuple[Matrix, tuple[float, float, float]]:
    """Return the transition matrix A of a step and the lower Cholesky factor (n00, n10, n11) of its noise.

    `spreads` are the standard deviations of angle and rate. The stationary covariance is P = diag(spreads^2); the noise
    that keeps it is P - A P A'.
    """
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping**2)
    decay = math.exp(-damping * omega_rad_s * step_s)
    cosine, sine = math.cos(damped_rad_s * step_s) * decay, math.sin(damped_rad_s * step_s) * decay
    lead = damping * omega_rad_s / damped_rad_s * sine
    a00, a01 = cosine + lead, sine / damped_rad_s
    a10, a11 = -omega_rad_s * omega_rad_s / damped_rad_s * sine, cosine - lead
    p0, p1 = spreads[0] ** 2, spreads[1] ** 2
    q00 = p0 - a00 * a00 * p0 - a01 * a01 * p1
    q01 = -a00 * a10 * p0 - a01 * a11 * p1
    q11 = p1 - a10 * a10 * p0 - a11 * a11 * p1
    n00 = math.sqrt(max(q00, 0.0))
    n10 = q01 / n00 if n00 > 0.0 else 0.0
    return ((a00, a01), (a10, a11)), (n00, n10, math.sqrt(max(q11 - n10 * n10, 0.0)))
