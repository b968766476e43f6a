"""What a sick sensor senses: the truth with an error laid over it, which may be changed at any time."""

from __future__ import annotations

from hil.devices.emulator import METRES_PER_DEGREE, Attitude, Whereabouts


class SpoiledAttitude:
    """An Attitude whose heading is off by `error_rad`."""

    def __init__(self, attitude: Attitude) -> None:
        """Start without an error."""
        self.error_rad = 0.0
        self._attitude = attitude

    def heading_rad(self) -> float:
        """Heading with the error."""
        return self._attitude.heading_rad() + self.error_rad

    def yaw_rate_rad_s(self) -> float:
        """The true rate of turn."""
        return self._attitude.yaw_rate_rad_s()


class SpoiledWhereabouts:
    """A Whereabouts that is off by `north_m`; speed and course stay right, as with multipath or a forged signal."""

    def __init__(self, whereabouts: Whereabouts) -> None:
        """Start without an error."""
        self.north_m = 0.0
        self._whereabouts = whereabouts

    def latitude_deg(self) -> float:
        """Latitude with the error."""
        return self._whereabouts.latitude_deg() + self.north_m / METRES_PER_DEGREE

    def longitude_deg(self) -> float:
        """The true longitude."""
        return self._whereabouts.longitude_deg()

    def speed_over_ground_m_s(self) -> float:
        """The true speed over ground."""
        return self._whereabouts.speed_over_ground_m_s()

    def course_over_ground_rad(self) -> float:
        """The true course over ground."""
        return self._whereabouts.course_over_ground_rad()

    def utc_s(self) -> float:
        """The true time."""
        return self._whereabouts.utc_s()
