"""A rudder angle sensor with NMEA 0183, which sends RSA periodically and ignores input."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from firmware_py.common.angles import degrees
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea_text import whole_sentence
from hil.devices.timing import Pace, Transmitter

RATE_HZ = 10.0
NOISE_DEG = 0.2


class NmeaRudderEmulator:
    """A sensor whose reading is angle / scale + offset_deg; `is_valid` False: it sends the status V."""

    def __init__(
        self,
        angle_rad: Callable[[], float],
        rng: np.random.Generator,
        *,
        rate_hz: float = RATE_HZ,
        noise_deg: float = NOISE_DEG,
        offset_deg: float = 0.0,
        scale: float = 1.0,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        baud: int = 4800,
    ) -> None:
        """Start at phase_s; raise ValueError for an invalid rate or scale."""
        if not (math.isfinite(rate_hz) and rate_hz > 0.0 and scale != 0.0):
            raise ValueError(f"rate {rate_hz} Hz, scale {scale}: out of range")
        self.is_valid = True
        self._angle_rad = angle_rad
        self._rng = rng
        self._noise_deg = noise_deg
        self._offset_deg = offset_deg
        self._scale = scale
        self._pace = Pace(1.0 / rate_hz, start_s=phase_s, error_ppm=frequency_error_ppm)
        self.transmitter = Transmitter(baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input: the sensor has no receiver."""

    def next_output_s(self) -> float:
        """Return when the next sample is taken or the next sentence is complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete sentences."""
        for sample_s in self._pace.take(now_s):
            angle_deg = degrees(self._angle_rad()) + self._rng.normal(0.0, self._noise_deg)
            reading_deg = angle_deg / self._scale + self._offset_deg
            fields = f"{reading_deg:.1f},A,," if self.is_valid else ",V,,"
            self.transmitter.send(sample_s, whole_sentence(f"IIRSA,{fields}"))
        return self.transmitter.take(now_s)


def _make(context: DeviceContext) -> Device:
    return NmeaRudderEmulator(
        context.world.rudder_rad,
        context.rng,
        offset_deg=context.options.offset_deg,
        scale=context.options.scale,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="nmea", baud=4800, make=_make)
