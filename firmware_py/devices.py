"""The one registry of drivers: what a vehicle file may name in `driver`, and what stands behind the name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.interfaces import ByteLine, Calibrator, Compass, Position, Power, Rudder, Vessels
from firmware_py.sensors import mti_reading, nmea_reader, pni_reading, ubx_protocol, vedirect_blocks
from firmware_py.sensors.ais import AisOptions, AisReceiver
from firmware_py.sensors.decode import CaptureFormat, Result
from firmware_py.sensors.mti import MtiCompass, MtiOptions
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions
from firmware_py.sensors.pni_tcm import PniCompass, PniOptions
from firmware_py.sensors.ubx import UbxOptions, UbxPosition
from firmware_py.sensors.vedirect import VeDirectOptions, VeDirectPower

DeviceT = TypeVar("DeviceT")


@dataclass(frozen=True, slots=True)
class Driver(Generic[DeviceT]):
    """A driver: the record of its options (common.options), and what makes it from a line and such a record.

    `calibrator` gives what calibrates the device made, None when nothing does;
    `capture` is what `rambler decode` reads of it.
    """

    device: str
    options: type[Any]
    make: Callable[[ByteLine, Any], DeviceT]
    calibrator: Callable[[Any], Calibrator] | None = None
    capture: CaptureFormat | None = None


COMPASSES: Mapping[str, Driver[Compass]] = {
    "nmea": Driver(
        device="any that speaks NMEA 0183 (HDT, HDG, HDM, THS, PASHR, ROT)",
        options=NmeaCompassOptions,
        make=NmeaCompass,
        capture=nmea_reader.CAPTURE_FORMAT,
    ),
    "pni_tcm": Driver(
        device="PNI TCM, Prime and TRAX",
        options=PniOptions,
        make=PniCompass,
        calibrator=lambda compass: compass,
        capture=pni_reading.CAPTURE_FORMAT,
    ),
    "mti": Driver(
        device="Xsens (Movella) MTi",
        options=MtiOptions,
        make=MtiCompass,
        capture=mti_reading.CAPTURE_FORMAT,
    ),
}
POSITIONS: Mapping[str, Driver[Position]] = {
    "nmea": Driver(
        device="any that speaks NMEA 0183 (RMC, GGA, GNS, GLL, VTG)",
        options=NmeaPositionOptions,
        make=NmeaPosition,
        capture=nmea_reader.CAPTURE_FORMAT,
    ),
    "ubx": Driver(
        device="u-blox receivers that send NAV-PVT",
        options=UbxOptions,
        make=lambda line, _options: UbxPosition(line),
        capture=ubx_protocol.CAPTURE_FORMAT,
    ),
}
RUDDERS: Mapping[str, Driver[Rudder]] = {
    "dynamixel": Driver(
        device="Robotis Dynamixel X, protocol 2.0",
        options=DynamixelOptions,
        make=dynamixel_rudder,
    ),
    "volz": Driver(
        device="Volz DA",
        options=VolzOptions,
        make=volz_rudder,
    ),
}
POWERS: Mapping[str, Driver[Power]] = {
    "vedirect": Driver(
        device="Victron chargers and battery monitors that speak VE.Direct (MPPT, SmartShunt, BMV)",
        options=VeDirectOptions,
        make=lambda line, _options: VeDirectPower(line),
        capture=vedirect_blocks.CAPTURE_FORMAT,
    ),
}
AIS: Mapping[str, Driver[Vessels]] = {
    "nmea": Driver(
        device="receivers and transponders of AIS (VDM, VDO), also among the sentences of compass or receiver",
        options=AisOptions,
        make=AisReceiver,
    ),
}

# The drivers that each section of a vehicle file may name.
SECTIONS: Mapping[str, Mapping[str, Driver[Any]]] = {
    "compass": COMPASSES,
    "compass_b": COMPASSES,
    "position": POSITIONS,
    "rudder": RUDDERS,
    "power": POWERS,
    "power_b": POWERS,
    "ais": AIS,
}

# By the names of `rambler decode`.
CAPTURE_FORMATS: Mapping[str, CaptureFormat] = {
    driver.capture.name: driver.capture
    for table in SECTIONS.values()
    for driver in table.values()
    if driver.capture is not None
}


def calibrator_of(name: str, compass: Compass) -> Calibrator | None:
    """Return what calibrates a compass that the driver of this name has made, None when nothing does."""
    calibrator = COMPASSES[name].calibrator
    return None if calibrator is None else calibrator(compass)


def decode(name: str, data: bytes) -> Iterator[Result]:
    """Yield one result (sensors.decode) for each message of a capture; ValueError for a format that there is not."""
    if name not in CAPTURE_FORMATS:
        raise ValueError(f"no kind of capture: {name[:20]!r}; there are {', '.join(CAPTURE_FORMATS)}")
    return CAPTURE_FORMATS[name].decode(data)
