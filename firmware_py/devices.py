"""Registry of drivers by their names in vehicle files.

The drivers of this program are listed here. Packages of other authors add drivers by entry points of the group
`rambler.drivers`, such as `compass.acme` (docs/how-to/compass-driver.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeVar

from firmware_py.common.driver import INTERFACE, CaptureFormat, Driver
from firmware_py.common.interfaces import (
    Calibrator,
    Compass,
    Depth,
    Position,
    Power,
    Rudder,
    RudderAngle,
    Vessels,
    Wind,
)
from firmware_py.common.options import record_from
from firmware_py.common.records import (
    DepthSample,
    DeviceRole,
    HeadingSample,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderFeedback,
    WindSample,
)
from firmware_py.common.vessels import VesselIdentity, VesselPosition
from firmware_py.guarded_device import GuardedDevice
from firmware_py.registry import PackageError, Registry

DeviceT = TypeVar("DeviceT")

GROUP: Final = "rambler.drivers"


@dataclass(frozen=True, slots=True)
class NoOptions:
    """Option record of a driver without options."""


class DriverRegistry(Registry[Driver[DeviceT]]):
    """The drivers of one kind of device; those of packages are guarded (guarded_device.py)."""

    def __init__(self, kind: str, role: DeviceRole, samples: tuple[type[Any], ...], own: Mapping[str, str]) -> None:
        """Define the kind: the role of its health records and the classes of its samples."""
        super().__init__(GROUP, kind, own, Driver, INTERFACE)
        self._role = role
        self._samples = samples

    def __getitem__(self, name: str) -> Driver[DeviceT]:
        """Import and return a driver; raise KeyError for an unknown name.

        The driver of an unusable package has a `problem`; the device that it creates is faulty and names it.
        """
        if name in self.own:
            return super().__getitem__(name)
        try:
            driver = super().__getitem__(name)
            _check_options_record(driver.options, self.package_of(name))
        except PackageError as error:
            driver = Driver(interface=INTERFACE, device="", options=NoOptions, make=_fail, problem=str(error))
        make: Any = partial(GuardedDevice, driver, self._role, self._samples, self.package_of(name))
        return replace(driver, make=make, calibrator=None)


def _fail(*_arguments: Any) -> Any:
    """Stand in for the factory of an unusable driver, which is never called."""
    raise NotImplementedError


def _check_options_record(kind: type[Any], package: str) -> None:
    """Raise PackageError unless the option record of a package can be read from a vehicle file without any option."""
    try:
        record_from(kind, {})
    except Exception as error:  # noqa: BLE001 - code of another author
        text = "; ".join(str(error).splitlines())
        raise PackageError(f"package {package}: option without a default or of another type: {text}"[:160]) from None


COMPASSES: DriverRegistry[Compass] = DriverRegistry(
    "compass",
    DeviceRole.COMPASS,
    (HeadingSample,),
    {
        "nmea": "firmware_py.sensors.nmea_compass:DRIVER",
        "pni_tcm": "firmware_py.sensors.pni_tcm:DRIVER",
        "mti": "firmware_py.sensors.mti:DRIVER",
        "rion": "firmware_py.sensors.rion:DRIVER",
        "witmotion": "firmware_py.sensors.witmotion:DRIVER",
        "bno08x_rvc": "firmware_py.sensors.bno08x_rvc:DRIVER",
        "mavlink": "firmware_py.sensors.mavlink_compass:DRIVER",
        "nmea2000": "firmware_py.sensors.nmea2000_compass:DRIVER",
    },
)
POSITIONS: DriverRegistry[Position] = DriverRegistry(
    "position",
    DeviceRole.POSITION,
    (PositionSample,),
    {
        "nmea": "firmware_py.sensors.nmea_position:DRIVER",
        "ubx": "firmware_py.sensors.ubx:DRIVER",
        "mavlink": "firmware_py.sensors.mavlink_position:DRIVER",
        "nmea2000": "firmware_py.sensors.nmea2000_position:DRIVER",
    },
)
RUDDERS: DriverRegistry[Rudder] = DriverRegistry(
    "rudder",
    DeviceRole.RUDDER,
    (RudderFeedback,),
    {
        "dynamixel": "firmware_py.actuator.dynamixel:DRIVER",
        "volz": "firmware_py.actuator.volz:DRIVER",
        "feetech": "firmware_py.actuator.feetech:DRIVER",
        "maestro": "firmware_py.actuator.maestro:DRIVER",
        "pwm": "firmware_py.actuator.pwm:DRIVER",
    },
)
RUDDER_ANGLES: DriverRegistry[RudderAngle] = DriverRegistry(
    "rudder_angle",
    DeviceRole.RUDDER_ANGLE,
    (RudderAngleSample,),
    {"nmea": "firmware_py.sensors.nmea_rudder:DRIVER", "nmea2000": "firmware_py.sensors.nmea2000_rudder:DRIVER"},
)
POWERS: DriverRegistry[Power] = DriverRegistry(
    "power",
    DeviceRole.POWER,
    (PowerSample,),
    {"vedirect": "firmware_py.sensors.vedirect:DRIVER", "mavlink": "firmware_py.sensors.mavlink_power:DRIVER"},
)
AIS: DriverRegistry[Vessels] = DriverRegistry(
    "ais",
    DeviceRole.AIS,
    (VesselPosition, VesselIdentity),
    {"nmea": "firmware_py.sensors.ais:DRIVER", "nmea2000": "firmware_py.sensors.nmea2000_ais:DRIVER"},
)
WINDS: DriverRegistry[Wind] = DriverRegistry(
    "wind",
    DeviceRole.WIND,
    (WindSample,),
    {"nmea": "firmware_py.sensors.nmea_wind:DRIVER", "nmea2000": "firmware_py.sensors.nmea2000_wind:DRIVER"},
)
DEPTHS: DriverRegistry[Depth] = DriverRegistry(
    "depth",
    DeviceRole.DEPTH,
    (DepthSample,),
    {"nmea": "firmware_py.sensors.nmea_depth:DRIVER", "nmea2000": "firmware_py.sensors.nmea2000_depth:DRIVER"},
)

# Drivers of each section of a vehicle file.
SECTIONS: Mapping[str, DriverRegistry[Any]] = {
    "compass": COMPASSES,
    "compass_b": COMPASSES,
    "position": POSITIONS,
    "rudder": RUDDERS,
    "rudder_angle": RUDDER_ANGLES,
    "power": POWERS,
    "power_b": POWERS,
    "ais": AIS,
    "wind": WINDS,
    "depth": DEPTHS,
}

# Drivers by capture formats of `rambler decode`: registry and name.
CAPTURE_FORMATS: Mapping[str, tuple[DriverRegistry[Any], str]] = {
    "nmea": (COMPASSES, "nmea"),
    "pni": (COMPASSES, "pni_tcm"),
    "mti": (COMPASSES, "mti"),
    "rion": (COMPASSES, "rion"),
    "witmotion": (COMPASSES, "witmotion"),
    "bno08x_rvc": (COMPASSES, "bno08x_rvc"),
    "ubx": (POSITIONS, "ubx"),
    "vedirect": (POWERS, "vedirect"),
    "nmea2000": (COMPASSES, "nmea2000"),
}


def calibrator_of(name: str, compass: Compass) -> Calibrator | None:
    """Return the calibrator of a compass of this driver, None if it has none."""
    calibrator = COMPASSES[name].calibrator
    return None if calibrator is None else calibrator(compass)


def find_capture(name: str) -> CaptureFormat:
    """Return a capture format: one of this program, or that of a driver of a package by the name of the driver.

    Raises ValueError for an unknown name.
    """
    if name in CAPTURE_FORMATS:
        registry, driver = CAPTURE_FORMATS[name]
        captures = [registry[driver].capture]
    else:
        captures = [rows[name].capture for rows in SECTIONS.values() if name not in rows.own and name in rows]
    for capture in captures:
        if capture is not None:
            return capture
    problem = "the package of this driver defines no capture format" if captures else "unknown capture format"
    raise ValueError(f"{problem}: {name[:20]!r}; use one of {', '.join(CAPTURE_FORMATS)}")


def decode(name: str, data: bytes) -> Iterator[dict[str, Any]]:
    """Yield a result (sensors.decode) for each message of a capture; ValueError for an unknown format."""
    return find_capture(name).decode(data)
