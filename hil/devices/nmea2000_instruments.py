"""Wind sensor, echo sounder and rudder angle sensor on an NMEA 2000 bus, each behind an Actisense gateway of its own.

Each sends one message periodically, without waiting for the start command of the gateway: PGN 130306 (apparent wind),
128267 or 127245.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.angles import degrees, radians
from hil.devices import nmea2000_frames as n2k
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea2000 import require_actisense
from hil.devices.nmea_depth import MAX_RANGE_M
from hil.devices.nmea_wind import NmeaWindEmulator
from hil.devices.timing import Pace, Transmitter

WIND_SENSOR, SOUNDER, RUDDER_SENSOR = 0x40, 0x41, 0x42  # addresses
APPARENT_WIND = 2
WIND_PERIOD_S, DEPTH_PERIOD_S, RUDDER_PERIOD_S = 0.5, 1.0, 0.1
DEPTH_NOISE_M, RUDDER_NOISE_DEG = 0.1, 0.2
BAUD = 115_200


class Nmea2000Instrument:
    """A device that sends one message periodically and ignores commands; `measure` returns its data."""

    def __init__(
        self, context: DeviceContext, pgn: int, address: int, period_s: float, measure: Callable[[], bytes]
    ) -> None:
        """Start at phase_s; the option `source` of the vehicle file replaces the address."""
        require_actisense(context)
        self._pgn = pgn
        self._address = address if context.options.source < 0 else context.options.source
        self._measure = measure
        self._pace = Pace(period_s, start_s=context.phase_s, error_ppm=context.frequency_error_ppm)
        self.transmitter = Transmitter(context.baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return when the next sample is taken or the next message is complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete messages."""
        for sample_s in self._pace.take(now_s):
            message = n2k.actisense_message(self._pgn, self._address, self._measure(), t_ms=round(1e3 * sample_s))
            self.transmitter.send(sample_s, message)
        return self.transmitter.take(now_s)


def make_wind(context: DeviceContext) -> Device:
    """Return a wind sensor."""
    vane = NmeaWindEmulator(
        context.world, context.rng, offset_deg=context.options.offset_deg, period_s=WIND_PERIOD_S, baud=context.baud
    )

    def measure() -> bytes:
        from_deg, speed_m_s = vane.measure()
        return n2k.wind(speed_m_s, radians(from_deg % 360.0), APPARENT_WIND)

    return Nmea2000Instrument(context, 130306, WIND_SENSOR, WIND_PERIOD_S, measure)


def make_depth(context: DeviceContext) -> Device:
    """Return an echo sounder; without a bottom in its range it sends no depth."""

    def measure() -> bytes:
        noise_m = float(context.rng.normal(0.0, DEPTH_NOISE_M))
        depth_m = context.world.water_depth_m() - context.options.transducer_depth_m + noise_m
        return n2k.depth(depth_m if 0.0 < depth_m <= MAX_RANGE_M else None)

    return Nmea2000Instrument(context, 128267, SOUNDER, DEPTH_PERIOD_S, measure)


def make_rudder_angle(context: DeviceContext) -> Device:
    """Return a rudder angle sensor whose reading is angle / scale + offset_deg."""
    options = context.options

    def measure() -> bytes:
        noise_deg = float(context.rng.normal(0.0, RUDDER_NOISE_DEG))
        reading_deg = (degrees(context.world.rudder_rad()) + noise_deg) / options.scale + options.offset_deg
        return n2k.rudder(radians(reading_deg), max(options.instance, 0))

    return Nmea2000Instrument(context, 127245, RUDDER_SENSOR, RUDDER_PERIOD_S, measure)


WIND = EmulatedDevice(interface=INTERFACE, driver="nmea2000", baud=BAUD, make=make_wind)
DEPTH = EmulatedDevice(interface=INTERFACE, driver="nmea2000", baud=BAUD, make=make_depth)
RUDDER_ANGLE = EmulatedDevice(interface=INTERFACE, driver="nmea2000", baud=BAUD, make=make_rudder_angle)
