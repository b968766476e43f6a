"""Heading and yaw rate of the hull by the K-T equation, on a fixed grid of time."""

from __future__ import annotations

import math

from firmware_py.model.kt import KtModel, rk4_step, steady_yaw_rate

MAX_STEP_S = 0.05
MAX_STEP_PER_TIME_CONSTANT = 0.2  # fourth-order Runge-Kutta is stable to 2.8 and accurate to 1e-5 here
MAX_RUDDER_RAD = 1.6  # larger than any rudder angle; bounds the yaw rate and so the fastest time constant
MAX_INNER_STEPS = 10_000


class KtPlant:
    """Heading and yaw rate of a hull, one grid step at a time.

    Raises ValueError for a model that is not physical or has a time constant too short for the grid.
    """

    def __init__(
        self,
        model: KtModel,
        step_s: float,
        heading_rad: float = 0.0,
        yaw_rate_rad_s: float = 0.0,
        disturbance_rad_s: float = 0.0,
    ) -> None:
        """Start from a heading and a yaw rate; disturbance_rad_s is the largest yaw rate that a disturbance adds."""
        self.heading_rad = heading_rad
        self.yaw_rate_rad_s = yaw_rate_rad_s
        self._model = model
        self._inner_steps = inner_steps(model, step_s, yaw_rate_rad_s, disturbance_rad_s)
        self._inner_s = step_s / self._inner_steps

    def set_model(self, model: KtModel) -> None:
        """Change the model, to one that is not faster than the initial one."""
        self._model = model

    def step(self, rudder_rad: float, drift_rad: float = 0.0) -> None:
        """Advance one grid step at a constant rudder; drift_rad is added to the model's rudder offset."""
        model = self._model
        heading_rad, yaw_rate_rad_s = self.heading_rad, self.yaw_rate_rad_s
        offset_rad = model.rudder_offset_rad + drift_rad
        for _ in range(self._inner_steps):
            heading_rad, yaw_rate_rad_s = rk4_step(
                heading_rad,
                yaw_rate_rad_s,
                rudder_rad,
                self._inner_s,
                model.turning_ability_1_s,
                model.turning_lag_s,
                model.norrbin_s2,
                offset_rad,
            )
        self.heading_rad, self.yaw_rate_rad_s = heading_rad, yaw_rate_rad_s


def inner_steps(model: KtModel, step_s: float, yaw_rate_rad_s: float = 0.0, disturbance_rad_s: float = 0.0) -> int:
    """Return the number of Runge-Kutta steps in a grid step.

    The yaw rate never exceeds the larger of its initial value and the steady turn at the largest rudder, plus
    disturbance_rad_s, the largest yaw rate of a disturbance. So the shortest time constant, T / (1 + 3 alpha r^2), is
    known in advance. Raises ValueError for a model that is not physical or needs more than MAX_INNER_STEPS.
    """
    numbers = (model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, model.rudder_offset_rad)
    if not all(math.isfinite(number) for number in numbers) or model.turning_lag_s <= 0.0 or model.norrbin_s2 < 0.0:
        raise ValueError(f"invalid ship model {model}: T must be positive, alpha not negative, and all numbers finite")
    max_rudder_rad = MAX_RUDDER_RAD + abs(model.rudder_offset_rad)
    steady_rad_s = steady_yaw_rate(max_rudder_rad, abs(model.turning_ability_1_s), model.norrbin_s2)
    rate_rad_s = max(abs(yaw_rate_rad_s), steady_rad_s) + disturbance_rad_s
    time_constant_s = model.turning_lag_s / (1.0 + 3.0 * model.norrbin_s2 * rate_rad_s * rate_rad_s)
    count = math.ceil(step_s / min(MAX_STEP_S, MAX_STEP_PER_TIME_CONSTANT * time_constant_s))
    if count > MAX_INNER_STEPS:
        raise ValueError(
            f"invalid ship model {model}: its shortest time constant, {time_constant_s:.2g} s, is too short"
        )
    return count
