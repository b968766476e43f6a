"""Driver of a rudder angle sensor on an NMEA 2000 bus."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.angles import degrees, radians
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceRole, RudderAngleSample
from firmware_py.sensors.message_error import check_range
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from firmware_py.sensors.nmea2000_source import AUTOMATIC

RUDDER = 127245
SOURCE_TIMEOUT_S = 3.0  # then another device may become the source; the standard interval is 0.1 s
MAX_ANGLE_DEG = 90.0
MAX_INSTANCE = 252


@dataclass(frozen=True, slots=True)
class Nmea2000RudderOptions(Nmea2000Options):
    """Options of the vehicle file for a rudder angle sensor on an NMEA 2000 bus; raises ValueError."""

    instance: int = option(
        "instance of the rudder; -1: the first one with an angle", default=AUTOMATIC, minimum=-1, maximum=MAX_INSTANCE
    )
    offset_deg: float = option(
        "reading of the sensor with the rudder amidships", default=0.0, minimum=-90.0, maximum=90.0
    )
    scale: float = option(
        "rudder angle per reading less offset; negative: the sensor turns against the rudder",
        default=1.0,
        minimum=-10.0,
        maximum=10.0,
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)
        if self.scale == 0.0:
            raise ValueError("scale: 0 is not a scale; use 1 for a sensor that measures the rudder angle")


class Nmea2000Rudder(Nmea2000Device[RudderAngleSample]):
    """Returns the angles of PGN 127245 of one rudder of one device; only valid angles count as accepted.

    A positive angle turns the boat to starboard. An autopilot on the bus sends its ordered angle with the same PGN, but
    without a position, and perhaps with another instance; messages without a position are not used.
    """

    def __init__(self, line: ByteLine, options: Nmea2000RudderOptions) -> None:
        """Store line and options."""
        super().__init__(line, options, DeviceRole.RUDDER_ANGLE, "rudder angle", (RUDDER,), SOURCE_TIMEOUT_S)
        self._options = options
        self._instance: tuple[float | int | None] | None = None  # of the first angle; its field may be None

    def _forget(self, _now_s: float) -> None:
        """Discard the values of the previous device."""
        self._instance = None

    def _handle_message(self, message: Message, now_s: float) -> None:
        values = numbers_of(message)
        position_rad, instance = values["position_rad"], values["instance"]
        if position_rad is None or self._options.instance not in (AUTOMATIC, instance):
            if message.source == self._selection.address:
                self._monitor.note_unused("no rudder angle from the device")
            return
        if not self._is_used(message, now_s):
            return
        if self._instance is None:
            self._instance = (instance,)
        if self._instance != (instance,):
            return
        rudder_deg = self._options.scale * (degrees(position_rad) - self._options.offset_deg)
        check_range(rudder_deg, -MAX_ANGLE_DEG, MAX_ANGLE_DEG, "rudder_deg after offset and scale")
        self._monitor.accept(now_s)
        self._samples.append(RudderAngleSample(now_s, radians(rudder_deg)))


DRIVER = Driver(
    interface=INTERFACE,
    device="rudder angle sensors on an NMEA 2000 bus (PGN 127245), by a gateway or SocketCAN",
    options=Nmea2000RudderOptions,
    make=Nmea2000Rudder,
    reads_can=True,
)
