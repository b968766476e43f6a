"""Limit, slew and deadband between a rudder demand and the rudder command, and the linkage to the servo.

Numeric core, as law.py beside it.
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


def limited_command(limits: RudderLimits, command_rad: float, demand_rad: float, step_s: float) -> float:
    """Return the next rudder command from the present one and the demand.

    A demand nearer to the command than the deadband changes nothing; a demand that is not
    a number changes nothing either.
    """
    if demand_rad != demand_rad:  # noqa: PLR0124 - the one value that differs from itself is NaN
        return command_rad
    target_rad = clamp(demand_rad, -limits.limit_rad, limits.limit_rad)
    change_rad = target_rad - command_rad
    if abs(change_rad) < limits.deadband_rad:
        return clamp(command_rad, -limits.limit_rad, limits.limit_rad)
    reach_rad = limits.slew_rad_s * step_s
    return command_rad + clamp(change_rad, -reach_rad, reach_rad)


class Linkage(NamedTuple):
    """Linkage of the servo's shaft to the rudder: the shaft angle amidships, and the sign of rotation."""

    centre_rad: float
    sign: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> Linkage:
        """Read the linkage from the parameters."""
        return cls(centre_rad=radians(parameters["RUD_CENTRE_DEG"]), sign=-1.0 if parameters["RUD_REVERSE"] else 1.0)

    def to_shaft(self, rudder_rad: float) -> float:
        """Convert a rudder angle to the angle of the shaft."""
        return self.centre_rad + self.sign * rudder_rad

    def to_rudder(self, shaft_rad: float) -> float:
        """Convert an angle of the shaft to the rudder angle."""
        return self.sign * (shaft_rad - self.centre_rad)
