"""An NMEA 0183 wind sensor, which sends once a second and ignores input."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from firmware_py.common.angles import KNOTS_PER_METRE_PER_SECOND, degrees
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice, Weather
from hil.devices.nmea_text import bearing, whole_sentence
from hil.devices.timing import Pace, Transmitter

PERIOD_S = 1.0
GUST_TIME_S = 8.0  # time constant of the turbulence
_KILOMETRES_PER_HOUR = 3.6


def _relative(angle_deg: float, knots: float) -> str:
    """Return the fields of VWR and VWT for an angle from the bow, 0 to 360 degrees clockwise."""
    left = angle_deg > 180.0
    speeds = f"{knots:.1f},N,{knots / KNOTS_PER_METRE_PER_SECOND:.1f},M"
    kilometres = knots / KNOTS_PER_METRE_PER_SECOND * _KILOMETRES_PER_HOUR
    return f"{360.0 - angle_deg if left else angle_deg:.1f},{'L' if left else 'R'},{speeds},{kilometres:.1f},K"


# Body by kind, from angle [deg] and speed [kn]: of the apparent wind, of the true wind from the bow and from north.
_BODIES: Mapping[str, tuple[str, Callable[[float, float], str]]] = {
    "MWV": ("apparent", lambda angle_deg, knots: f"MWV,{angle_deg:.1f},R,{knots:.1f},N,A"),
    "VWR": ("apparent", lambda angle_deg, knots: f"VWR,{_relative(angle_deg, knots)}"),
    "VWT": ("bow", lambda angle_deg, knots: f"VWT,{_relative(angle_deg, knots)}"),
    "MWD": (
        "north",
        lambda angle_deg, knots: f"MWD,{angle_deg:.1f},T,,M,{knots:.1f},N,{knots / KNOTS_PER_METRE_PER_SECOND:.1f},M",
    ),
}


class NmeaWindEmulator:
    """A sensor that sends MWV (apparent), VWR, VWT or MWD; its `offset_deg` is the mounting angle from the bow."""

    def __init__(
        self,
        weather: Weather,
        rng: np.random.Generator,
        *,
        sentence: str = "MWV",
        offset_deg: float = 0.0,
        period_s: float = PERIOD_S,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        baud: int = 4800,
    ) -> None:
        """Start at phase_s; raise ValueError for an unknown kind of sentence."""
        if sentence not in _BODIES:
            raise ValueError(f"sentence {sentence} is not supported; use one of {', '.join(_BODIES)}")
        self._weather = weather
        self._rng = rng
        self._reference, self._body = _BODIES[sentence]
        self._offset_deg = offset_deg
        self._correlation = math.exp(-period_s / GUST_TIME_S)
        self._gust = rng.normal(0.0, 1.0, 2)  # north and east, relative to the standard deviation
        self._pace = Pace(period_s, start_s=phase_s, error_ppm=frequency_error_ppm)
        self.transmitter = Transmitter(baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return when the next sample is taken or the next sentence is complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete sentences."""
        for sample_s in self._pace.take(now_s):
            from_deg, speed_m_s = self.measure()
            body = self._body(bearing(from_deg, 0.1), speed_m_s * KNOTS_PER_METRE_PER_SECOND)
            self.transmitter.send(sample_s, whole_sentence(f"WI{body}"))
        return self.transmitter.take(now_s)

    def measure(self) -> tuple[float, float]:
        """Take a sample; return the direction in degrees, relative to that of the sentence, and the speed in m/s."""
        innovation = self._rng.normal(0.0, math.sqrt(1.0 - self._correlation**2), 2)
        self._gust = self._correlation * self._gust + innovation
        north_m_s, east_m_s = self._weather.air_velocity_m_s()
        deviation_m_s = self._weather.turbulence * math.hypot(north_m_s, east_m_s)
        north_m_s, east_m_s = north_m_s + deviation_m_s * self._gust[0], east_m_s + deviation_m_s * self._gust[1]
        if self._reference == "apparent":
            boat_north_m_s, boat_east_m_s = self._weather.velocity_m_s()
            north_m_s, east_m_s = north_m_s - boat_north_m_s, east_m_s - boat_east_m_s
        from_deg = degrees(math.atan2(-east_m_s, -north_m_s))
        if self._reference != "north":
            from_deg -= degrees(self._weather.bow_rad()) + self._offset_deg
        return from_deg, math.hypot(north_m_s, east_m_s)


def _make(context: DeviceContext) -> Device:
    return NmeaWindEmulator(
        context.world,
        context.rng,
        sentence=(*context.options.sentences, "MWV")[0],
        offset_deg=context.options.offset_deg,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="nmea", baud=4800, make=_make)
