"""What every emulated device offers to the board of ports.

Time is an argument, so the same emulator runs in real time and in lockstep. An
emulator speaks bytes only; what it measures and moves it reaches through small
Protocols that the world fulfils.
"""

from __future__ import annotations

from typing import Final, Protocol

from hil.devices.timing import Transmitter

# Of latitude, on a sphere of 6371 km: the earth of the harness. It is not the firmware's
# common/geodesy on purpose, for an earth that both shared could be wrong without showing.
METRES_PER_DEGREE: Final = 111_194.93


class Emulator(Protocol):
    """A device at the far end of a serial line."""

    def receive(self, now_s: float, data: bytes) -> None:
        """Take the bytes that the autopilot wrote, complete at now_s."""

    def next_output_s(self) -> float:
        """When the device next wants to be asked: bytes are due, or it samples the world; infinity when neither."""

    def take_output(self, now_s: float) -> bytes:
        """Sample what is due, return all bytes complete at or before now_s (often none), in order, and forget them."""


class Device(Emulator, Protocol):
    """An emulator of a device with a UART."""

    transmitter: Transmitter


class Attitude(Protocol):
    """What a compass senses."""

    def heading_rad(self) -> float:
        """Heading from true north that a perfect compass would show now, unwrapped or not."""

    def yaw_rate_rad_s(self) -> float:
        """Rate of turn now, positive to starboard."""


class Whereabouts(Protocol):
    """What a satellite receiver senses."""

    def latitude_deg(self) -> float:
        """Geodetic latitude."""

    def longitude_deg(self) -> float:
        """Geodetic longitude."""

    def speed_over_ground_m_s(self) -> float:
        """Speed over ground."""

    def course_over_ground_rad(self) -> float:
        """Course over ground from true north."""

    def utc_s(self) -> float:
        """Seconds since 1970-01-01 UTC."""


class Shaft(Protocol):
    """The mechanics of a servo: a shaft that follows its target with a limited slew."""

    def angle_rad(self) -> float:
        """The true angle of the shaft now, positive to starboard."""

    def set_target(self, target_rad: float) -> None:
        """Move toward this angle from now on (the mechanics clip it to their stops)."""

    def set_torque(self, *, on: bool) -> None:
        """Release or engage the motor; a released shaft stays where it is."""
