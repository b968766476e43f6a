"""An NMEA 0183 echo sounder, which sends once a second and ignores input."""

from __future__ import annotations

import numpy as np

from hil.devices.emulator import INTERFACE, Bottom, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea_text import whole_sentence
from hil.devices.timing import Pace, Transmitter

PERIOD_S = 1.0
NOISE_M = 0.05
MAX_RANGE_M = 200.0  # beyond it the sounder loses the bottom
_METRES_PER_FOOT, _FEET_PER_FATHOM = 0.3048, 6.0
SENTENCES = ("DPT", "DBT", "DBS", "DBK")


class NmeaDepthEmulator:
    """A sounder that sends DPT with its offset to the surface, DBT, DBS or DBK."""

    def __init__(
        self,
        bottom: Bottom,
        rng: np.random.Generator,
        *,
        sentence: str = "DPT",
        transducer_m: float = 0.0,
        keel_m: float = 0.0,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        baud: int = 4800,
    ) -> None:
        """Start at phase_s; transducer and keel are depths below the surface. ValueError for an unknown sentence."""
        if sentence not in SENTENCES:
            raise ValueError(f"sentence {sentence} is not supported; use one of {', '.join(SENTENCES)}")
        self._bottom = bottom
        self._rng = rng
        self._sentence = sentence
        self._transducer_m = transducer_m
        self._keel_m = keel_m
        self._pace = Pace(PERIOD_S, start_s=phase_s, error_ppm=frequency_error_ppm)
        self.transmitter = Transmitter(baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return when the next sample is taken or the next sentence is complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete sentences."""
        for sample_s in self._pace.take(now_s):
            self.transmitter.send(sample_s, whole_sentence(f"SD{self._sentence},{self._fields()}"))
        return self.transmitter.take(now_s)

    def _fields(self) -> str:
        reference_m = {"DBS": 0.0, "DBK": self._keel_m}.get(self._sentence, self._transducer_m)
        depth_m = self._bottom.water_depth_m() - reference_m + self._rng.normal(0.0, NOISE_M)
        is_lost = not 0.0 < depth_m <= MAX_RANGE_M
        if self._sentence == "DPT":
            return f"{'' if is_lost else f'{depth_m:.1f}'},{self._transducer_m:.1f}"
        if is_lost:
            return ",f,,M,,F"
        feet = depth_m / _METRES_PER_FOOT
        return f"{feet:.1f},f,{depth_m:.1f},M,{feet / _FEET_PER_FATHOM:.1f},F"


def _make(context: DeviceContext) -> Device:
    return NmeaDepthEmulator(
        context.world,
        context.rng,
        sentence=(*context.options.sentences, "DPT")[0],
        transducer_m=context.options.transducer_depth_m,
        keel_m=context.options.keel_depth_m,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="nmea", baud=4800, make=_make)
