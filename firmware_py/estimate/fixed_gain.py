"""Fixed-gain observer of heading and yaw rate: a fading-memory filter with critical damping.

The gains 1 - theta^2 and (1 - theta)^2 with theta = exp(-dt / tau) put both poles at theta, at any sample interval
(Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.2.6). Between the samples the linear K-T model
predicts. Numeric core: compiled unchanged by the laboratory (hil/lab/numeric_core.py).
"""

from __future__ import annotations

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.model.kt import exact_step


def yaw_rate_limit(turning_ability_1_s: float, rudder_limit_rad: float) -> float:
    """Return the limit of the yaw rate: a rate far beyond that of full rudder is noise, at any speed of the boat."""
    return 10.0 * turning_ability_1_s * rudder_limit_rad + radians(5.0)


def predict(
    heading_rad: float,
    yaw_rate_rad_s: float,
    rudder_rad: float,
    step_s: float,
    decay: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
) -> tuple[float, float]:
    """Return heading and yaw rate after a step of the linear K-T model; `decay` is kt.decay_over(step_s, T)."""
    steady_rad_s = turning_ability_1_s * rudder_rad
    turned_rad, yaw_rate_rad_s = exact_step(yaw_rate_rad_s, steady_rad_s, decay, step_s, turning_lag_s)
    return wrap_two_pi(heading_rad + turned_rad), yaw_rate_rad_s


def correct(
    heading_rad: float,
    yaw_rate_rad_s: float,
    measured_rad: float,
    step_s: float,
    theta: float,
    yaw_rate_limit_rad_s: float,
) -> tuple[float, float]:
    """Return heading and yaw rate updated with a sample, step_s after the previous one; theta = exp(-step_s / tau)."""
    innovation_rad = wrap_pi(measured_rad - heading_rad)
    if step_s > 0.0:
        yaw_rate_rad_s += (1.0 - theta) * (1.0 - theta) * innovation_rad / step_s
    return (
        wrap_two_pi(heading_rad + (1.0 - theta * theta) * innovation_rad),
        clamp(yaw_rate_rad_s, -yaw_rate_limit_rad_s, yaw_rate_limit_rad_s),
    )
