"""Angle limit, rate limit and deadband from the rudder demand to the rudder command; linkage to the servo.

Numeric core, like law.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from firmware_py.common.angles import clamp, radians

if TYPE_CHECKING:
    from firmware_py.common.parameters import ParameterSet


class RudderLimits(NamedTuple):
    """Maximum angle, maximum rate and deadband of the rudder command."""

    limit_rad: float
    slew_rad_s: float
    deadband_rad: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> RudderLimits:
        """Read the limits from the parameters."""
        return cls(
            limit_rad=radians(parameters["RUD_LIMIT_DEG"]),
            slew_rad_s=radians(parameters["RUD_SLEW_DEG_S"]),
            deadband_rad=radians(parameters["RUD_DBAND_DEG"]),
        )


def limit_command(limits: RudderLimits, command_rad: float, demand_rad: float, step_s: float) -> float:
    """Return the next rudder command from the present one and the demand.

    The command stays the same if the demand is within the deadband, or NaN.
    """
    if demand_rad != demand_rad:  # noqa: PLR0124 - only NaN differs from itself
        return command_rad
    target_rad = clamp(demand_rad, -limits.limit_rad, limits.limit_rad)
    change_rad = target_rad - command_rad
    if abs(change_rad) < limits.deadband_rad:
        return clamp(command_rad, -limits.limit_rad, limits.limit_rad)
    max_step_rad = limits.slew_rad_s * step_s
    return command_rad + clamp(change_rad, -max_step_rad, max_step_rad)


class Linkage(NamedTuple):
    """Linkage of servo shaft and rudder: shaft angle at rudder angle 0, and sign of rotation."""

    centre_rad: float
    sign: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> Linkage:
        """Read the linkage from the parameters."""
        return cls(centre_rad=radians(parameters["RUD_CENTRE_DEG"]), sign=-1.0 if parameters["RUD_REVERSE"] else 1.0)

    def to_shaft(self, rudder_rad: float) -> float:
        """Convert a rudder angle to the shaft angle."""
        return self.centre_rad + self.sign * rudder_rad

    def to_rudder(self, shaft_rad: float) -> float:
        """Convert a shaft angle to the rudder angle."""
        return self.sign * (shaft_rad - self.centre_rad)
