"""Driver of a compass on an NMEA 2000 bus."""

from __future__ import annotations

import math

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceRole, HeadingSample, NorthReference
from firmware_py.sensors.nmea2000_capture import CAPTURE_FORMAT
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_heading import HEADING, Heading, heading_of
from firmware_py.sensors.nmea2000_reader import Nmea2000Options

RATE_OF_TURN, ATTITUDE = 127251, 127257
SOURCE_TIMEOUT_S = 3.0  # then another device may become the source; the standard interval is 0.1 s
TURN_RATE_HOLD_S = 1.0
ATTITUDE_HOLD_S = 2.5  # the standard interval is 1 s
MAX_TURN_RATE_RAD_S = math.radians(60.0)
MAX_PITCH_RAD = math.pi / 2.0
MIN_TRUE_HEADINGS, TRUE_HOLD_S = 3, 2.0


class Nmea2000Compass(Nmea2000Device[HeadingSample]):
    """Returns every heading (PGN 127250) of one device, with its rate of turn (127251), roll and pitch (127257).

    All true headings are returned; magnetic ones are ignored after
    MIN_TRUE_HEADINGS true ones at intervals of at most TRUE_HOLD_S. Messages of other devices are not used. Only
    headings count as accepted.
    """

    def __init__(self, line: ByteLine, options: Nmea2000Options) -> None:
        """Store line and options."""
        pgns = (HEADING, RATE_OF_TURN, ATTITUDE)
        super().__init__(line, options, DeviceRole.COMPASS, "heading", pgns, SOURCE_TIMEOUT_S)
        self._forget(0.0)

    def _forget(self, now_s: float) -> None:
        """Discard the values of the previous device."""
        self._turn_rate: tuple[float, float | None] = (now_s, None)  # time, rate [rad/s]
        self._attitude: tuple[float, float | None, float | None] = (now_s, None, None)  # time, roll, pitch [rad]
        self._true_count = 0
        self._true_s = now_s

    def _handle_message(self, message: Message, now_s: float) -> None:
        if message.pgn != HEADING and message.source != self._selection.address:
            return
        values = numbers_of(message)
        if message.pgn == RATE_OF_TURN:
            self._turn_rate = now_s, _within(values["rate_rad_s"], MAX_TURN_RATE_RAD_S)
        elif message.pgn == ATTITUDE:
            self._attitude = now_s, _within(values["roll_rad"], math.pi), _within(values["pitch_rad"], MAX_PITCH_RAD)
        elif (heading := heading_of(values)) is None:
            # A device without a heading does not become or remain the source.
            if message.source == self._selection.address:
                self._monitor.note("no heading from the device")
        elif self._is_used(message, now_s):
            self._handle_heading(heading, now_s)

    def _handle_heading(self, heading: Heading, now_s: float) -> None:
        heading_rad, reference, variation_rad = heading
        if reference is NorthReference.TRUE:
            self._true_count = self._true_count + 1 if now_s - self._true_s <= TRUE_HOLD_S else 1
            self._true_s = now_s
        elif self._true_count >= MIN_TRUE_HEADINGS and now_s - self._true_s <= TRUE_HOLD_S:
            return
        self._monitor.accept(now_s)
        self._monitor.note("")
        turn_s, yaw_rate_rad_s = self._turn_rate
        attitude_s, roll_rad, pitch_rad = self._attitude
        has_attitude = now_s - attitude_s <= ATTITUDE_HOLD_S
        self._samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=heading_rad,
                reference=reference,
                variation_rad=variation_rad,
                yaw_rate_rad_s=yaw_rate_rad_s if now_s - turn_s <= TURN_RATE_HOLD_S else None,
                roll_rad=roll_rad if has_attitude else None,
                pitch_rad=pitch_rad if has_attitude else None,
            )
        )


def _within(value: float | None, limit: float) -> float | None:
    return value if value is not None and abs(value) <= limit else None


DRIVER = Driver(
    interface=INTERFACE,
    device="compasses on an NMEA 2000 bus (PGN 127250, 127251, 127257), by a gateway or SocketCAN",
    options=Nmea2000Options,
    make=Nmea2000Compass,
    reads_can=True,
    capture=CAPTURE_FORMAT,
)
