"""True quantities with an error that may be changed at any time, for faulty sensors."""

from __future__ import annotations

from hil.devices.emulator import METRES_PER_DEGREE, Attitude, Whereabouts


class AttitudeWithError:
    """An Attitude with the heading error `error_rad`."""

    def __init__(self, attitude: Attitude) -> None:
        """Start without an error."""
        self.error_rad = 0.0
        self._attitude = attitude

    def heading_rad(self) -> float:
        """Return the heading with the error."""
        return self._attitude.heading_rad() + self.error_rad

    def yaw_rate_rad_s(self) -> float:
        """Return the true yaw rate."""
        return self._attitude.yaw_rate_rad_s()


class WhereaboutsWithError:
    """A Whereabouts with the position error `north_m`; speed and course are true, as with multipath."""

    def __init__(self, whereabouts: Whereabouts) -> None:
        """Start without an error."""
        self.north_m = 0.0
        self._whereabouts = whereabouts

    def latitude_deg(self) -> float:
        """Return the latitude with the error."""
        return self._whereabouts.latitude_deg() + self.north_m / METRES_PER_DEGREE

    def longitude_deg(self) -> float:
        """Return the true longitude."""
        return self._whereabouts.longitude_deg()

    def speed_over_ground_m_s(self) -> float:
        """Return the true speed over ground."""
        return self._whereabouts.speed_over_ground_m_s()

    def course_over_ground_rad(self) -> float:
        """Return the true course over ground."""
        return self._whereabouts.course_over_ground_rad()

    def utc_s(self) -> float:
        """Return the true time."""
        return self._whereabouts.utc_s()
