"""K-T equation of the heading (first-order Nomoto model with Norrbin's cubic term).

    T * dr/dt + r + alpha * r^3 = K * (delta - delta0)        dpsi/dt = r

Source: Wang et al., J. Cent. South Univ. 25(9):2131-2142 (2018), eq. 2 and 7. Numeric core: functions over floats,
which the laboratory compiles unchanged (hil/lab/numeric_core.py).

There are two ways to advance the state by a step. The autopilot uses `exact_step`, the exact solution with the cubic
term constant during the step (`held_cubic`), which is stable for any step. The plant uses `rk4_step`, so that both have
no common error.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from firmware_py.common.parameters import ParameterSet


class KtModel(NamedTuple):
    """K [1/s], T [s], alpha [s^2], delta0 [rad] at the speed through the water [m/s]."""

    turning_ability_1_s: float
    turning_lag_s: float
    norrbin_s2: float
    rudder_offset_rad: float
    speed_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> KtModel:
        """Read the model from the parameters; the rudder offset is 0, because it is estimated."""
        return cls(
            turning_ability_1_s=parameters["MDL_K"],
            turning_lag_s=parameters["MDL_T_S"],
            norrbin_s2=parameters["MDL_ALPHA_S2"],
            rudder_offset_rad=0.0,
            speed_m_s=parameters["MDL_SPEED"],
        )

    def at_speed(self, speed_m_s: float) -> KtModel:
        """Scale to another speed by similarity (paper eq. 7): K ~ U, T ~ 1/U, alpha ~ 1/U^2."""
        ability_1_s, lag_s, norrbin_s2 = scaled(self, speed_m_s / self.speed_m_s)
        return KtModel(ability_1_s, lag_s, norrbin_s2, self.rudder_offset_rad, speed_m_s)


MAX_CUBIC = 1e9  # limit of alpha r^2 for extreme yaw rates

# Identified by the authors of the paper in a tank at 0.4 m/s.
OCEAN_RAMBLER = KtModel(
    turning_ability_1_s=0.049, turning_lag_s=4.0, norrbin_s2=17.0, rudder_offset_rad=0.0, speed_m_s=0.4
)


def scaled(model: KtModel, ratio: float) -> tuple[float, float, float]:
    """Return K, T and alpha at `ratio` times the model's speed, by similarity (paper eq. 7)."""
    return model.turning_ability_1_s * ratio, model.turning_lag_s / ratio, model.norrbin_s2 / (ratio * ratio)


def yaw_drive(
    yaw_rate_rad_s: float, rudder_rad: float, turning_ability_1_s: float, norrbin_s2: float, rudder_offset_rad: float
) -> float:
    """Return T dr/dt [rad/s] of the K-T equation."""
    return (
        turning_ability_1_s * (rudder_rad - rudder_offset_rad)
        - yaw_rate_rad_s
        - norrbin_s2 * yaw_rate_rad_s * yaw_rate_rad_s * yaw_rate_rad_s
    )


def yaw_acceleration(
    yaw_rate_rad_s: float,
    rudder_rad: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    norrbin_s2: float,
    rudder_offset_rad: float,
) -> float:
    """Return dr/dt [rad/s^2] of the K-T equation."""
    return yaw_drive(yaw_rate_rad_s, rudder_rad, turning_ability_1_s, norrbin_s2, rudder_offset_rad) / turning_lag_s


def steady_yaw_rate(rudder_rad: float, turning_ability_1_s: float, norrbin_s2: float) -> float:
    """Solve r + alpha r^3 = K delta for r [rad/s] by Newton's method, starting from the linear solution.

    The left side is monotonic and odd for alpha >= 0, and the linear solution is larger than the root in size, so the
    method converges without overshoot.
    """
    drive_rad_s = turning_ability_1_s * rudder_rad
    rate_rad_s = drive_rad_s
    if norrbin_s2 <= 0.0:
        return rate_rad_s
    for _ in range(100):
        residual = rate_rad_s + norrbin_s2 * rate_rad_s * rate_rad_s * rate_rad_s - drive_rad_s
        step = residual / (1.0 + 3.0 * norrbin_s2 * rate_rad_s * rate_rad_s)
        rate_rad_s -= step
        if abs(step) <= 1e-15 * (abs(rate_rad_s) + 1e-12):
            break
    return rate_rad_s


def decay_over(step_s: float, turning_lag_s: float) -> float:
    """Return exp(-step / T), the ratio of a difference from the steady yaw rate that remains after a step."""
    return math.exp(-step_s / turning_lag_s)


def held_cubic(
    turning_lag_s: float, norrbin_s2: float, yaw_rate_rad_s: float, step_s: float
) -> tuple[float, float, float]:
    """Return the cubic term for a step: divisor of K, T and drive; term divided by the yaw rate; its derivative.

    The term alpha r^3 is constant during the step, unless that would be unstable because its derivative 3 alpha r^2 is
    large and the step long. Then it is linearised: (1 + 3 alpha r0^2) r - 2 alpha r0^3. The exact solution of this is
    stable for any step, and converges to the steady yaw rate like Newton's method.
    """
    cubic, decay = norrbin_s2 * yaw_rate_rad_s * yaw_rate_rad_s, decay_over(step_s, turning_lag_s)
    if 3.0 * cubic * (1.0 - decay) <= 1.0 + decay:
        return 1.0, cubic, 3.0 * cubic
    cubic = min(cubic, MAX_CUBIC)
    return 1.0 + 3.0 * cubic, -2.0 * cubic, 0.0


def settled_yaw_rate(yaw_rate_rad_s: float, steady_rad_s: float, decay: float) -> float:
    """Return the yaw rate after a step in which it approaches the steady one; `decay` is `decay_over` of the step."""
    return steady_rad_s + (yaw_rate_rad_s - steady_rad_s) * decay


def exact_step(
    yaw_rate_rad_s: float, steady_rad_s: float, decay: float, step_s: float, turning_lag_s: float
) -> tuple[float, float]:
    """Return the angle turned in a step and the yaw rate after it, by the exact solution of the linear equation.

    `steady_rad_s` is the steady yaw rate: K (delta - delta0), minus alpha r^3 if the cubic term is used.
    """
    turned_rad = steady_rad_s * step_s + (yaw_rate_rad_s - steady_rad_s) * turning_lag_s * (1.0 - decay)
    return turned_rad, settled_yaw_rate(yaw_rate_rad_s, steady_rad_s, decay)


def rk4_step(
    heading_rad: float,
    yaw_rate_rad_s: float,
    rudder_rad: float,
    step_s: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    norrbin_s2: float,
    rudder_offset_rad: float,
) -> tuple[float, float]:
    """Advance heading and yaw rate by one fourth-order Runge-Kutta step at a constant rudder angle.

    `step_s` must be much smaller than the turning lag divided by 1 + 3 alpha r^2.
    """
    ratio = step_s / turning_lag_s
    r1 = yaw_rate_rad_s
    d1 = yaw_drive(r1, rudder_rad, turning_ability_1_s, norrbin_s2, rudder_offset_rad)
    r2 = yaw_rate_rad_s + 0.5 * ratio * d1
    d2 = yaw_drive(r2, rudder_rad, turning_ability_1_s, norrbin_s2, rudder_offset_rad)
    r3 = yaw_rate_rad_s + 0.5 * ratio * d2
    d3 = yaw_drive(r3, rudder_rad, turning_ability_1_s, norrbin_s2, rudder_offset_rad)
    r4 = yaw_rate_rad_s + ratio * d3
    d4 = yaw_drive(r4, rudder_rad, turning_ability_1_s, norrbin_s2, rudder_offset_rad)
    return (
        heading_rad + step_s / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4),
        yaw_rate_rad_s + ratio / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4),
    )
