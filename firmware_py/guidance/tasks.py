"""Tasks of the boat, their settings, the motion of the boat and the heading target."""

from __future__ import annotations

import msgspec

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet


class HoldHeading(msgspec.Struct, frozen=True, tag=True):
    """Steer a heading."""

    heading_rad: float


class GoTo(msgspec.Struct, frozen=True, tag=True):
    """Go to a place on the line from `start` (None: from the present position), and keep station there."""

    place: Place
    start: Place | None
    acceptance_radius_m: float
    station_radius_m: float


class HoldStation(msgspec.Struct, frozen=True, tag=True):
    """Keep station within a loiter circle."""

    centre: Place
    radius_m: float


class Orbit(msgspec.Struct, frozen=True, tag=True):
    """Circle a place; `number` distinguishes identical tasks in sequence, because each counts its own turns."""

    centre: Place
    radius_m: float
    clockwise: bool
    number: int = 0


Task = HoldHeading | GoTo | HoldStation | Orbit


class VesselMotion(msgspec.Struct, frozen=True):
    """Estimated position and motion of the boat.

    `speed_m_s` is through the water; `leeway_rad` is positive to starboard of the heading. `too_strong`: the current
    exceeds the speed. `spread_m` is the position error under dead reckoning, 0 with a fix.
    """

    place: Place
    heading_rad: float
    speed_m_s: float
    current_north_m_s: float
    current_east_m_s: float
    too_strong: bool = False
    leeway_rad: float = 0.0
    spread_m: float = 0.0

    @property
    def water_course_rad(self) -> float:
        """The course through the water."""
        return wrap_two_pi(self.heading_rad + self.leeway_rad)


class HeadingTarget(msgspec.Struct, frozen=True):
    """Target of the controller: a heading, or a course over ground."""

    angle_rad: float
    over_ground: bool


class TaskSettings(msgspec.Struct, frozen=True):
    """Radii, look-ahead, turning radius, and the maximum position error under dead reckoning."""

    acceptance_radius_m: float
    station_radius_m: float
    look_ahead_s: float
    turning_radius_m: float  # at full rudder; independent of speed
    dead_reckoning_limit_m: float = 0.0  # 0: no dead reckoning

    @classmethod
    def of(cls, parameters: ParameterSet) -> TaskSettings:
        """Read the settings from the parameters."""
        yaw_rate_rad_s = parameters["MDL_K"] * radians(parameters["RUD_LIMIT_DEG"])
        radius_m = parameters["MDL_SPEED"] / yaw_rate_rad_s
        return cls(
            acceptance_radius_m=parameters["WP_RADIUS"],
            station_radius_m=parameters["LOIT_RADIUS"],
            look_ahead_s=parameters["NAV_LOOK_S"],
            turning_radius_m=min(max(radius_m, 1.0), 1000.0),
            dead_reckoning_limit_m=parameters["POS_RECKON_M"],
        )
