"""Which devices hang on the board, each with its own noise, phase and clock error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.emulator import Emulator
from hil.devices.nmea_compass import Kind, NmeaCompassEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.volz import VolzEmulator
from hil.errors import UsageError
from hil.ship.noise import Stream, generator
from hil.sim.vehicle_file import POSITION_DRIVER, VehicleFile
from hil.sim.world import World

FREQUENCY_ERROR_PPM = 20.0  # spread of ordinary crystal oscillators
COMPASS_RATE_HZ = 10.0
POSITION_RATE_HZ = 1.0


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """What an emulator is built from: its section of the vehicle file and the chances of this run."""

    world: World
    section: Mapping[str, Any]
    numbers: np.random.Generator
    phase_s: float
    frequency_error_ppm: float
    declination_deg: float


def _nmea(fitting: DeviceContext) -> Emulator:
    section = fitting.section
    known = [kind for kind in section.get("sentences", ()) if kind in get_args(Kind)]
    return NmeaCompassEmulator(
        fitting.world,
        fitting.numbers,
        rate_hz=float(section.get("rate_hz", COMPASS_RATE_HZ)),
        sentence=known[0] if known else "HDT",
        phase_s=fitting.phase_s,
        frequency_error_ppm=fitting.frequency_error_ppm,
        declination_deg=fitting.declination_deg,
        baud=int(section["baud"]),
    )


def _pni(fitting: DeviceContext) -> Emulator:
    return PniTcmEmulator(
        fitting.world,
        fitting.numbers,
        declination_deg=fitting.declination_deg,
        frequency_error_ppm=fitting.frequency_error_ppm,
        baud=int(fitting.section["baud"]),
    )


def _dynamixel(fitting: DeviceContext) -> Emulator:
    section = fitting.section
    return DynamixelEmulator(
        fitting.world.shaft, fitting.numbers, device_id=int(section.get("id", 1)), baud=int(section["baud"])
    )


def _volz(fitting: DeviceContext) -> Emulator:
    section = fitting.section
    return VolzEmulator(
        fitting.world.shaft, fitting.numbers, device_id=int(section.get("id", 1)), baud=int(section["baud"])
    )


def _gps(fitting: DeviceContext) -> Emulator:
    return NmeaGpsEmulator(
        fitting.world,
        fitting.numbers,
        rate_hz=POSITION_RATE_HZ,
        phase_s=fitting.phase_s,
        frequency_error_ppm=fitting.frequency_error_ppm,
        baud=int(fitting.section["baud"]),
    )


MAKERS: Mapping[str, Callable[[DeviceContext], Emulator]] = {
    "nmea": _nmea,
    "pni_tcm": _pni,
    "dynamixel": _dynamixel,
    "volz": _volz,
}


def emulators(world: World, vehicle: VehicleFile, seed: int) -> dict[str, Emulator]:
    """Build compass, position and rudder as the vehicle file names them, or raise UsageError."""
    chances = generator(seed, Stream.PHASES)

    def fitting(section: Mapping[str, Any], stream: Stream, period_s: float) -> DeviceContext:
        return DeviceContext(
            world,
            section,
            generator(seed, stream),
            phase_s=float(chances.uniform(0.0, period_s)),
            frequency_error_ppm=float(chances.normal(0.0, FREQUENCY_ERROR_PPM)),
            declination_deg=vehicle.declination_deg(),
        )

    try:
        return {
            "compass": MAKERS[vehicle.compass["driver"]](fitting(vehicle.compass, Stream.COMPASS, 0.1)),
            "position": _gps(fitting(POSITION_DRIVER, Stream.POSITION, 1.0)),
            "rudder": MAKERS[vehicle.rudder["driver"]](fitting(vehicle.rudder, Stream.RUDDER, 1.0)),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"the vehicle file describes a device that cannot be emulated: {error}") from None
