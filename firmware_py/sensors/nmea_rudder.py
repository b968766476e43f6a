"""Driver of a rudder angle sensor with NMEA 0183: sentence RSA."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import radians
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine, RudderAngle
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, DeviceRole, RudderAngleSample
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea_reader import NmeaReader

MAX_ANGLE_DEG = 90.0
MAX_SAMPLES = 64  # between two polls


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


class NmeaRudder:
    """Returns the angle of the starboard or only rudder of every RSA with status A.

    RSA counts positive angles for a rudder that turns the boat to starboard, as the autopilot does.
    """

    def __init__(self, line: ByteLine, options: NmeaRudderOptions) -> None:
        """Store line and options."""
        self._line = line
        self._options = options
        self._monitor = DeviceMonitor(line, DeviceRole.RUDDER_ANGLE)
        self._reader = NmeaReader(line, self._monitor, {"RSA"}, require_checksum=options.require_checksum)
        self._samples: deque[RudderAngleSample] = deque(maxlen=MAX_SAMPLES)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

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

    def poll(self) -> Sequence[RudderAngleSample]:
        """Return the samples since the last poll, oldest first."""
        samples = tuple(self._samples)
        self._samples.clear()
        return samples

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; only valid angles count as accepted."""
        return self._monitor.health(now_s)


DRIVER: Driver[RudderAngle] = Driver(
    interface=INTERFACE,
    device="rudder angle sensors with NMEA 0183 (RSA)",
    options=NmeaRudderOptions,
    make=NmeaRudder,
)
