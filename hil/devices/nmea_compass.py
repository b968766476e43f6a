"""An NMEA 0183 heading sensor, which sends periodically and ignores input."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np

from firmware_py.common.angles import degrees
from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea_text import bearing, decimals_of, hemisphere_letter, whole_sentence
from hil.devices.timing import Pace, Transmitter

Kind = Literal["HDT", "HDG", "HDM"]

_RATE_HZ = 10.0


class NmeaCompassEmulator:
    """A compass that sends HDT, HDG or HDM, and with `rot` also ROT, at its own rate.

    Each period it samples the attitude and sends the sentence; the bytes are complete after the transfer time.
    `declination_deg` is that of the location (true minus magnetic, east positive); `variation_deg` and `deviation_deg`
    are those in an HDG sentence, empty when None. The raw HDG reading is magnetic minus deviation.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        rate_hz: float = 10.0,
        sentence: Kind = "HDT",
        noise_deg: float = 0.3,
        resolution_deg: float = 0.1,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        talker: str = "HC",
        declination_deg: float = 0.0,
        variation_deg: float | None = None,
        deviation_deg: float | None = None,
        rot: bool = False,
        rate_noise_deg_s: float = 0.05,
        baud: int = 38400,
    ) -> None:
        """Start at phase_s; raise ValueError for an invalid rate, resolution or kind of sentence."""
        if sentence not in ("HDT", "HDG", "HDM"):
            raise ValueError(f"sentence {sentence} is not supported; use HDT, HDG or HDM")
        if not (math.isfinite(rate_hz) and rate_hz > 0.0 and resolution_deg > 0.0):
            raise ValueError(f"rate {rate_hz} Hz and resolution {resolution_deg} deg must be positive")
        self._attitude = attitude
        self._rng = rng
        self._kind = sentence
        self._noise_deg = noise_deg
        self._resolution_deg = resolution_deg
        self._decimals = decimals_of(resolution_deg)
        self._talker = talker
        self._declination_deg = declination_deg
        self._variation_deg = variation_deg
        self._deviation_deg = deviation_deg
        self._sends_rot = rot
        self._rate_noise_deg_s = rate_noise_deg_s
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
            self.transmitter.send(sample_s, self._sentences())
        return self.transmitter.take(now_s)

    def _sentences(self) -> bytes:
        true_deg = degrees(self._attitude.heading_rad()) + self._rng.normal(0.0, self._noise_deg)
        sentences = whole_sentence(f"{self._talker}{self._kind},{self._fields(true_deg)}")
        if self._sends_rot:
            rate_deg_s = degrees(self._attitude.yaw_rate_rad_s()) + self._rng.normal(0.0, self._rate_noise_deg_s)
            sentences += whole_sentence(f"{self._talker}ROT,{rate_deg_s * 60.0:.1f},A")
        return sentences

    def _fields(self, true_deg: float) -> str:
        magnetic_deg = true_deg - self._declination_deg
        if self._kind == "HDT":
            return f"{self._format(true_deg)},T"
        if self._kind == "HDM":
            return f"{self._format(magnetic_deg)},M"
        raw_deg = magnetic_deg - (self._deviation_deg or 0.0)
        return f"{self._format(raw_deg)},{_correction(self._deviation_deg)},{_correction(self._variation_deg)}"

    def _format(self, angle_deg: float) -> str:
        return f"{bearing(angle_deg, self._resolution_deg):.{self._decimals}f}"


def _correction(angle_deg: float | None) -> str:
    """Return `x.x,E` or `x.x,W`, or two empty fields for an unknown value."""
    return "," if angle_deg is None else f"{abs(angle_deg):.1f},{hemisphere_letter(angle_deg, 'E', 'W')}"


def _make(context: DeviceContext) -> Device:
    sentences = [sentence for sentence in context.options.sentences if sentence in get_args(Kind)]
    return NmeaCompassEmulator(
        context.world,
        context.rng,
        rate_hz=_RATE_HZ,
        sentence=sentences[0] if sentences else "HDT",
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        declination_deg=context.declination_deg,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="nmea", baud=38400, make=_make)
