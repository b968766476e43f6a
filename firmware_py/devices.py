"""Registry of drivers by their names in vehicle files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from firmware_py.common.interfaces import ByteLine, Calibrator, Compass, Position, Power, Rudder, Vessels
from firmware_py.sensors.decode import CaptureFormat, Result

DeviceT = TypeVar("DeviceT")


@dataclass(frozen=True, slots=True)
class Code(Generic[DeviceT]):
    """Code of a driver: its option record (common.options), and a factory that creates it from a line and that record.

    `calibrator` returns the calibrator of a device, None if it has none; `capture` is the format for `rambler decode`.
    """

    options: type[Any]
    make: Callable[[ByteLine, Any], DeviceT]
    calibrator: Callable[[Any], Calibrator] | None = None
    capture: CaptureFormat | None = None


@dataclass(frozen=True, slots=True)
class Driver(Generic[DeviceT]):
    """A driver, whose code is imported on first use, because a boat has only some of the devices.

    A driver that `writes` to its device needs a serial port; the others can also read from the network.
    """

    device: str
    code: Callable[[], Code[DeviceT]]
    writes: bool = False

    @property
    def options(self) -> type[Any]:
        """The option record."""
        return self.code().options

    @property
    def make(self) -> Callable[[ByteLine, Any], DeviceT]:
        """The factory: creates the driver from a line and an option record."""
        return self.code().make


def _load_nmea_compass() -> Code[Compass]:
    from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
    from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT

    return Code(NmeaCompassOptions, NmeaCompass, capture=CAPTURE_FORMAT)


def _load_pni() -> Code[Compass]:
    from firmware_py.sensors.pni_reading import CAPTURE_FORMAT
    from firmware_py.sensors.pni_tcm import PniCompass, PniOptions

    return Code(PniOptions, PniCompass, calibrator=lambda compass: compass, capture=CAPTURE_FORMAT)


def _load_mti() -> Code[Compass]:
    from firmware_py.sensors.mti import MtiCompass, MtiOptions
    from firmware_py.sensors.mti_reading import CAPTURE_FORMAT

    return Code(MtiOptions, MtiCompass, capture=CAPTURE_FORMAT)


def _load_nmea_position() -> Code[Position]:
    from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions
    from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT

    return Code(NmeaPositionOptions, NmeaPosition, capture=CAPTURE_FORMAT)


def _load_ubx() -> Code[Position]:
    from firmware_py.sensors.ubx import UbxOptions, UbxPosition
    from firmware_py.sensors.ubx_protocol import CAPTURE_FORMAT

    return Code(UbxOptions, lambda line, _options: UbxPosition(line), capture=CAPTURE_FORMAT)


def _load_dynamixel() -> Code[Rudder]:
    from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder

    return Code(DynamixelOptions, dynamixel_rudder)


def _load_volz() -> Code[Rudder]:
    from firmware_py.actuator.volz import VolzOptions, volz_rudder

    return Code(VolzOptions, volz_rudder)


def _load_vedirect() -> Code[Power]:
    from firmware_py.sensors.vedirect import VeDirectOptions, VeDirectPower
    from firmware_py.sensors.vedirect_blocks import CAPTURE_FORMAT

    return Code(VeDirectOptions, lambda line, _options: VeDirectPower(line), capture=CAPTURE_FORMAT)


def _load_ais() -> Code[Vessels]:
    from firmware_py.sensors.ais import AisOptions, AisReceiver

    return Code(AisOptions, AisReceiver)


COMPASSES: Mapping[str, Driver[Compass]] = {
    "nmea": Driver("NMEA 0183 compasses (HDT, HDG, HDM, THS, PASHR, ROT, XDR)", _load_nmea_compass),
    "pni_tcm": Driver("PNI TCM, Prime and TRAX", _load_pni, writes=True),
    "mti": Driver("Xsens (Movella) MTi", _load_mti, writes=True),
}
POSITIONS: Mapping[str, Driver[Position]] = {
    "nmea": Driver("NMEA 0183 receivers (RMC, GGA, GNS, GLL, VTG, ZDA)", _load_nmea_position),
    "ubx": Driver("u-blox receivers that send NAV-PVT", _load_ubx),
}
RUDDERS: Mapping[str, Driver[Rudder]] = {
    "dynamixel": Driver("Robotis Dynamixel X, protocol 2.0", _load_dynamixel, writes=True),
    "volz": Driver("Volz DA", _load_volz, writes=True),
}
POWERS: Mapping[str, Driver[Power]] = {
    "vedirect": Driver("Victron chargers and battery monitors with VE.Direct (MPPT, SmartShunt, BMV)", _load_vedirect),
}
AIS: Mapping[str, Driver[Vessels]] = {
    "nmea": Driver("AIS receivers and transponders (VDM, VDO), also mixed with sentences of other devices", _load_ais),
}

# Drivers of each section of a vehicle file.
SECTIONS: Mapping[str, Mapping[str, Driver[Any]]] = {
    "compass": COMPASSES,
    "compass_b": COMPASSES,
    "position": POSITIONS,
    "rudder": RUDDERS,
    "power": POWERS,
    "power_b": POWERS,
    "ais": AIS,
}

# Drivers by capture formats of `rambler decode`.
CAPTURE_FORMATS: Mapping[str, Driver[Any]] = {
    "nmea": COMPASSES["nmea"],
    "pni": COMPASSES["pni_tcm"],
    "mti": COMPASSES["mti"],
    "ubx": POSITIONS["ubx"],
    "vedirect": POWERS["vedirect"],
}


def calibrator_of(name: str, compass: Compass) -> Calibrator | None:
    """Return the calibrator of a compass of this driver, None if it has none."""
    calibrator = COMPASSES[name].code().calibrator
    return None if calibrator is None else calibrator(compass)


def decode(name: str, data: bytes) -> Iterator[Result]:
    """Yield a result (sensors.decode) for each message of a capture; ValueError for an unknown format."""
    if name not in CAPTURE_FORMATS:
        raise ValueError(f"unknown capture format {name[:20]!r}; use one of {', '.join(CAPTURE_FORMATS)}")
    capture = CAPTURE_FORMATS[name].code().capture
    return iter(()) if capture is None else capture.decode(data)
