"""Driver of a rudder angle sensor with NMEA 0183: sentence RSA."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.angles import radians
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine, RudderAngle
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceRole, RudderAngleSample
from firmware_py.sensors.nmea_reader import NmeaReader
from firmware_py.sensors.sensor_driver import SensorDriver

MAX_ANGLE_DEG = 90.0


@dataclass(frozen=True, slots=True)
class NmeaRudderOptions:
    """Options of the vehicle file for a rudder angle sensor; raises ValueError."""

    offset_deg: float = option(
        "reading of the sensor with the rudder amidships", default=0.0, minimum=-90.0, maximum=90.0
    )
    scale: float = option(
        "rudder angle per reading less offset; negative: the sensor turns against the rudder",
        default=1.0,
        minimum=-10.0,
        maximum=10.0,
    )
    require_checksum: bool = option("whether to reject sentences without a checksum", default=True)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)
        if self.scale == 0.0:
            raise ValueError("scale: 0 is not a scale; use 1 for a sensor that measures the rudder angle")


class NmeaRudder(SensorDriver[RudderAngleSample]):
    """Returns the angle of the starboard or only rudder of every RSA with status A.

    RSA counts positive angles for a rudder that turns the boat to starboard, as the autopilot does. Only valid angles
    count as accepted.
    """

    def __init__(self, line: ByteLine, options: NmeaRudderOptions) -> None:
        """Store line and options."""
        self._options = options
        super().__init__(line, DeviceRole.RUDDER_ANGLE)
        self._reader = NmeaReader(line, self._monitor, {"RSA"}, require_checksum=options.require_checksum)

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
        for sentence, decoded in self._reader.read(now_s):
            angle_deg = decoded.numbers["rudder_deg"]
            if angle_deg is None or decoded.letters["status"] != "A":
                self._monitor.note(f"{sentence.address}: no valid rudder angle")
                continue
            rudder_deg = self._options.scale * (angle_deg - self._options.offset_deg)
            if not abs(rudder_deg) <= MAX_ANGLE_DEG:
                self._monitor.reject(now_s, f"{sentence.address}: {rudder_deg:.0f} deg after offset and scale")
                continue
            self._monitor.accept(now_s)
            self._monitor.note("")
            self._samples.append(RudderAngleSample(now_s, radians(rudder_deg)))


DRIVER: Driver[RudderAngle] = Driver(
    interface=INTERFACE,
    device="rudder angle sensors with NMEA 0183 (RSA)",
    options=NmeaRudderOptions,
    make=NmeaRudder,
)
