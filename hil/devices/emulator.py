"""Interfaces of the emulated devices and of the parts of the world that they measure or move.

Time is an argument, so the same emulator runs in real time and in lockstep. An emulator exchanges bytes only; sensors
and actuators are small Protocols that the world implements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from hil.devices.timing import Transmitter

# Version of the interface between the harness and an emulator: EmulatedDevice, DeviceContext and the protocols below.
INTERFACE: Final = 1

# Metres per degree of latitude on a sphere of 6371 km, the earth model of the harness. It is deliberately independent
# of the firmware's common/geodesy: an error in a shared model would not show.
METRES_PER_DEGREE: Final = 111_194.93


class Emulator(Protocol):
    """A device at the far end of a serial line."""

    def receive(self, now_s: float, data: bytes) -> None:
        """Process bytes that the autopilot wrote, complete at now_s."""

    def next_output_s(self) -> float:
        """Return when the device next has output or samples the world; infinity for never."""

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due; return and remove the bytes that are complete at now_s, in order."""


class Device(Emulator, Protocol):
    """An emulator of a device with a UART."""

    transmitter: Transmitter


class Attitude(Protocol):
    """The quantities that a compass measures."""

    def heading_rad(self) -> float:
        """Return the output of a perfect compass now, from true north, possibly unwrapped."""

    def yaw_rate_rad_s(self) -> float:
        """Return the yaw rate now, positive to starboard."""


class Whereabouts(Protocol):
    """The quantities that a GNSS receiver measures."""

    def latitude_deg(self) -> float:
        """Return the geodetic latitude."""

    def longitude_deg(self) -> float:
        """Return the geodetic longitude."""

    def speed_over_ground_m_s(self) -> float:
        """Return the speed over ground."""

    def course_over_ground_rad(self) -> float:
        """Return the course over ground from true north."""

    def utc_s(self) -> float:
        """Return the seconds since 1970-01-01 UTC."""


class Shaft(Protocol):
    """The mechanics of a servo: a shaft that follows its target with a limited slew."""

    def angle_rad(self) -> float:
        """Return the true angle of the shaft now, positive to starboard."""

    def set_target(self, target_rad: float) -> None:
        """Move toward this angle from now on (the mechanics clip it to their stops)."""

    def set_torque(self, *, on: bool) -> None:
        """Release or engage the motor; a released shaft keeps its angle."""


class Weather(Protocol):
    """The quantities that a wind sensor measures.

    `turbulence` is the standard deviation of the wind as a share of its speed; vectors are north and east.
    """

    turbulence: float

    def bow_rad(self) -> float:
        """Return the direction of the bow from true north, with wave yaw."""

    def velocity_m_s(self) -> tuple[float, float]:
        """Return the velocity of the boat over the ground."""

    def air_velocity_m_s(self) -> tuple[float, float]:
        """Return the mean velocity of the air over the ground."""


class Bottom(Protocol):
    """The bottom of the sea, which an echo sounder measures."""

    def water_depth_m(self) -> float:
        """Return the water depth below the surface at the boat."""


class Surroundings(Attitude, Whereabouts, Weather, Bottom, Protocol):
    """What the devices of a boat measure and move: the simulated world."""

    disturbances: Any  # hil.ship.disturbances.Disturbances

    @property
    def shaft(self) -> Shaft:
        """The shaft that the rudder servo moves."""

    def rudder_rad(self) -> float:
        """Return the true angle of the rudder now."""

    @property
    def now_s(self) -> float:
        """The present time of the world."""


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """Inputs of an emulator: its section of the vehicle file and the random values of this run.

    `phase_s` and `frequency_error_ppm` are the start and the clock error of its periodic output; `declination_deg` is
    that of the location, positive to the east; `gaps` are the random numbers for times without a GNSS fix.
    """

    world: Surroundings
    baud: int
    options: Any  # of the driver
    rng: np.random.Generator
    phase_s: float
    frequency_error_ppm: float
    declination_deg: float
    gaps: np.random.Generator


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedDevice:
    """The driver of an emulated device, its factory baud rate, and the function that creates it.

    `interface` is the version of the interface that it was written for. `shared_by` are further sections of the vehicle
    file that a compass serves, on the same port by the same driver.
    """

    interface: int
    driver: str
    baud: int
    make: Callable[[DeviceContext], Device]
    shared_by: tuple[str, ...] = ()
