"""Driver of a wind sensor on an NMEA 2000 bus."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceRole, WindReference, WindSample
from firmware_py.sensors.message_error import check_range
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from firmware_py.sensors.nmea_preference import MAX_WIND_M_S, WIND_RANKS, Preference

WIND = 130306
SOURCE_TIMEOUT_S = 5.0  # then another device may become the source
SILENT_AFTER_S = 5.0
_REFERENCES = {int(reference): reference for reference in WindReference}


@dataclass(frozen=True, slots=True)
class Nmea2000WindOptions(Nmea2000Options):
    """Options of the vehicle file for a wind sensor on an NMEA 2000 bus; raises ValueError."""

    offset_deg: float = option(
        "mounting angle of the sensor, clockwise from the bow, added to wind angles from the bow",
        default=0.0,
        minimum=-180.0,
        maximum=180.0,
    )


class Nmea2000Wind(Nmea2000Device[WindSample]):
    """Returns the wind of PGN 130306 of one device.

    The apparent wind is preferred, as with NMEA 0183: instruments that compute a true wind send it beside the sensor.
    Messages that give a sample count as accepted, and messages without a wind unless another device is selected.
    """

    def __init__(self, line: ByteLine, options: Nmea2000WindOptions) -> None:
        """Store line and options."""
        super().__init__(line, options, DeviceRole.WIND, "wind", (WIND,), SOURCE_TIMEOUT_S, SILENT_AFTER_S)
        self._offset_deg = options.offset_deg
        self._preference = Preference(WIND_RANKS)

    def _handle_message(self, message: Message, now_s: float) -> None:
        values = numbers_of(message)
        wind_m_s, angle_rad = values["wind_speed_m_s"], values["wind_angle_rad"]
        number = values["reference"]
        reference = None if number is None else _REFERENCES.get(int(number))
        if reference is None or wind_m_s is None or angle_rad is None:
            if self._is_reported(message):
                self._monitor.accept(now_s)
                self._monitor.note("no wind from the device")
            return
        check_range(wind_m_s, 0.0, MAX_WIND_M_S, "wind_speed_m_s")
        if not self._selection.is_candidate(message.source):
            self._selection.accepts(message.source, now_s)  # only reports the other source, once
            return
        if not self._preference.accepts(reference, now_s) or not self._is_used(message, now_s):
            return
        self._monitor.accept(now_s)
        self._monitor.note("")
        is_from_bow = reference not in (WindReference.NORTH, WindReference.MAGNETIC)
        offset_rad = radians(self._offset_deg) if is_from_bow else 0.0
        self._samples.append(WindSample(now_s, wind_m_s, wrap_two_pi(angle_rad + offset_rad), reference))


DRIVER = Driver(
    interface=INTERFACE,
    device="wind sensors on an NMEA 2000 bus (PGN 130306), by a gateway or SocketCAN",
    options=Nmea2000WindOptions,
    make=Nmea2000Wind,
    reads_can=True,
)
