"""An NMEA 0183 satellite receiver: RMC, GGA and VTG at its own pace."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import KNOTS_PER_METRE_PER_SECOND, degrees
from hil.devices.emulator import METRES_PER_DEGREE, Whereabouts
from hil.devices.nmea_text import bearing, clock_and_date, coordinate, whole_sentence
from hil.devices.timing import Pace, Transmitter

_NOISE_TIME_S = 60.0  # position errors of a receiver wander (ionosphere, multipath); they are not white
_SATELLITES = 11
_HDOP = 0.9
_ALTITUDE_M = 2.0
_GEOID_M = 17.5
_KILOMETRES_PER_HOUR = 3.6


class NmeaGpsEmulator:
    """A receiver that reports position, speed and course; `fix = False` makes it lose the sky.

    Position errors wander as a first-order Gauss-Markov process of `position_noise_m`
    in each axis; the velocity error is white, so the course of a boat at rest is noise,
    as it is on a real one. The epoch is sampled at its instant; the sentences start
    `latency_s` later.
    """

    def __init__(
        self,
        whereabouts: Whereabouts,
        rng: np.random.Generator,
        *,
        rate_hz: float = 1.0,
        position_noise_m: float = 1.5,
        velocity_noise_m_s: float = 0.03,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        latency_s: float = 0.06,
        talker: str = "GP",
        baud: int = 9600,
    ) -> None:
        """Start at phase_s; ValueError for a rate that is not positive."""
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise ValueError(f"the rate must be positive, not {rate_hz} Hz")
        self.fix = True
        self._whereabouts = whereabouts
        self._rng = rng
        self._position_noise_m = position_noise_m
        self._velocity_noise_m_s = velocity_noise_m_s
        self._keep = math.exp(-1.0 / (rate_hz * _NOISE_TIME_S))
        self._error_m = rng.normal(0.0, position_noise_m, 2)
        self._latency_s = latency_s
        self._talker = talker
        self._pace = Pace(1.0 / rate_hz, start_s=phase_s, error_ppm=frequency_error_ppm)
        self._line = Transmitter(baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore what is sent to it."""

    def next_output_s(self) -> float:
        """When the next epoch is sampled or the next burst is complete."""
        return min(self._pace.next_s, self._line.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Sample the epochs that are due and return the bursts that are complete."""
        for epoch_s in self._pace.take(now_s):
            self._line.send(epoch_s + self._latency_s, self._talk())
        return self._line.take(now_s)

    def _talk(self) -> bytes:
        clock, date = clock_and_date(self._whereabouts.utc_s())
        # The noise is drawn with and without a fix, so that a lost sky does not shift the rest of the run.
        position = self._position()
        speed_m_s, course_deg = self._velocity()
        if not self.fix:
            bodies = (
                f"RMC,{clock},V,,,,,,,{date},,,N",
                f"GGA,{clock},,,,,0,00,99.99,,,,,,",
                "VTG,,,,,,,,,N",
            )
        else:
            knots = speed_m_s * KNOTS_PER_METRE_PER_SECOND
            course = f"{bearing(course_deg, 0.01):.2f}"
            bodies = (
                f"RMC,{clock},A,{position},{knots:.3f},{course},{date},,,A",
                f"GGA,{clock},{position},1,{_SATELLITES:02d},{_HDOP},{_ALTITUDE_M},M,{_GEOID_M},M,,",
                f"VTG,{course},T,,M,{knots:.3f},N,{speed_m_s * _KILOMETRES_PER_HOUR:.3f},K,A",
            )
        return b"".join(whole_sentence(self._talker + body) for body in bodies)

    def _position(self) -> str:
        step = self._rng.normal(0.0, self._position_noise_m, 2)
        self._error_m = self._keep * self._error_m + math.sqrt(1.0 - self._keep**2) * step
        latitude_deg = self._whereabouts.latitude_deg()
        narrowing = max(math.cos(math.radians(latitude_deg)), 1e-3)
        longitude_deg = self._whereabouts.longitude_deg() + self._error_m[1] / (METRES_PER_DEGREE * narrowing)
        latitude_deg += self._error_m[0] / METRES_PER_DEGREE
        longitude_deg = (longitude_deg + 180.0) % 360.0 - 180.0
        north = coordinate(latitude_deg, degree_digits=2, letters=("N", "S"))
        east = coordinate(longitude_deg, degree_digits=3, letters=("E", "W"))
        return f"{north},{east}"

    def _velocity(self) -> tuple[float, float]:
        speed_m_s = self._whereabouts.speed_over_ground_m_s()
        course_rad = self._whereabouts.course_over_ground_rad()
        error_north, error_east = self._rng.normal(0.0, self._velocity_noise_m_s, 2)
        north_m_s = speed_m_s * math.cos(course_rad) + error_north
        east_m_s = speed_m_s * math.sin(course_rad) + error_east
        return math.hypot(north_m_s, east_m_s), degrees(math.atan2(east_m_s, north_m_s))
