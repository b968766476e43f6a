"""Driver of an echo sounder on an NMEA 2000 bus."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DepthSample, DeviceRole
from firmware_py.sensors.message_error import check_range
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_reader import Nmea2000Options

WATER_DEPTH = 128267
SOURCE_TIMEOUT_S = 5.0  # then another device may become the source; the standard interval is 1 s
SILENT_AFTER_S = 5.0
MAX_DEPTH_M = 12_000.0


@dataclass(frozen=True, slots=True)
class Nmea2000DepthOptions(Nmea2000Options):
    """Options of the vehicle file for an echo sounder on an NMEA 2000 bus; raises ValueError."""

    transducer_depth_m: float = option(
        "depth of the transducer below the surface, added to a depth without an offset to the surface",
        default=0.0,
        minimum=0.0,
        maximum=100.0,
    )


class Nmea2000Depth(Nmea2000Device[DepthSample]):
    """Returns the water depth below the surface of PGN 128267 of one device.

    A positive offset is the depth of the transducer; a negative one is the distance to the keel and is not used. A
    depth of 0 below the transducer means that the sounder has lost the bottom, and gives no sample. Every depth message
    of the device with a depth in range, or without one, counts as accepted.
    """

    def __init__(self, line: ByteLine, options: Nmea2000DepthOptions) -> None:
        """Store line and options."""
        super().__init__(line, options, DeviceRole.DEPTH, "depth", (WATER_DEPTH,), SOURCE_TIMEOUT_S, SILENT_AFTER_S)
        self._transducer_depth_m = options.transducer_depth_m

    def _handle_message(self, message: Message, now_s: float) -> None:
        values = numbers_of(message)
        depth_m, offset_m = values["depth_m"], values["offset_m"]
        if depth_m is not None:
            check_range(depth_m, 0.0, MAX_DEPTH_M, "depth_m")
        if not (self._is_used(message, now_s) if depth_m else self._is_reported(message)):
            return
        self._monitor.accept(now_s)
        if not depth_m:
            self._monitor.note("no bottom")
            return
        self._monitor.note("")
        transducer_m = offset_m if offset_m is not None and offset_m > 0.0 else self._transducer_depth_m
        self._samples.append(DepthSample(now_s, depth_m + transducer_m, transducer_m))


DRIVER = Driver(
    interface=INTERFACE,
    device="echo sounders on an NMEA 2000 bus (PGN 128267), by a gateway or SocketCAN",
    options=Nmea2000DepthOptions,
    make=Nmea2000Depth,
    reads_can=True,
)
