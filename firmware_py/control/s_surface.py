"""The S-surface heading controller (Wang et al. 2018, eq. 8).

    u = 2 / (1 + exp(-(k1 * e + k2 * edot))) - 1 + du          rudder = delta_max * clamp(u, -1, 1)

Our normalisation, which the paper does not print: e = error / pi, edot = -r / r_max with
r_max the steady yaw rate at delta_max.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import clamp, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.control.controller import HeadingControllerInput, HeadingControllerState
from firmware_py.model.kt import steady_yaw_rate


@dataclass(frozen=True, slots=True)
class Gains:
    """k1, k2, the rudder limit, the yaw rate that normalises, and the trim du as an angle."""

    k1: float
    k2: float
    rudder_limit_rad: float
    yaw_rate_max_rad_s: float
    trim_rad: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> Gains:
        """Read the gains from the parameters."""
        limit_rad = radians(parameters["RUD_LIMIT_DEG"])
        return cls(
            k1=parameters["CTL_K1"],
            k2=parameters["CTL_K2"],
            rudder_limit_rad=limit_rad,
            yaw_rate_max_rad_s=steady_yaw_rate(limit_rad, parameters["MDL_K"], parameters["MDL_ALPHA_S2"]),
            trim_rad=radians(parameters["CTL_TRIM_DEG"]),
        )


def update(
    gains: Gains, _state: HeadingControllerState, given: HeadingControllerInput
) -> tuple[HeadingControllerState, float]:
    """Return the rudder demand [rad] of fixed gains, which remember nothing."""
    return HeadingControllerState(), rudder_demand(gains, given.error_rad, given.yaw_rate_rad_s)


def rudder_demand(gains: Gains, heading_error_rad: float, yaw_rate_rad_s: float) -> float:
    """Return the rudder angle [rad] for a heading error in [-pi, pi] and a yaw rate.

    The logistic form is written as the hyperbolic tangent that it equals, which does not
    overflow.
    """
    error = heading_error_rad / math.pi
    error_rate = -yaw_rate_rad_s / gains.yaw_rate_max_rad_s
    surface = math.tanh(0.5 * (gains.k1 * error + gains.k2 * error_rate))
    return clamp(
        gains.rudder_limit_rad * surface + gains.trim_rad,
        -gains.rudder_limit_rad,
        gains.rudder_limit_rad,
    )
