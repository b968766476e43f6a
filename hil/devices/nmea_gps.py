"""An NMEA 0183 GNSS receiver: RMC, GGA and VTG at its own rate."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import KNOTS_PER_METRE_PER_SECOND, degrees
from hil.devices.emulator import METRES_PER_DEGREE, Whereabouts
from hil.devices.nmea_text import bearing, format_clock_and_date, format_coordinate, whole_sentence
from hil.devices.timing import Pace, Transmitter

POSITION_NOISE_M = 1.5
NOISE_TIME_S = 60.0  # time constant of position errors (ionosphere, multipath), which are not white
_SATELLITES = 11
_HDOP = 0.9
_ALTITUDE_M = 2.0
_GEOID_M = 17.5
_KILOMETRES_PER_HOUR = 3.6
_SAMPLE_S = 0.1  # of the velocity filter


class NmeaGpsEmulator:
    """A receiver of position, speed and course; `fix = False` removes the fix.

    Position errors are a first-order Gauss-Markov process of `position_noise_m` in each axis; the velocity error is
    white, so the course of a boat at rest is noise, as on a real receiver. Each epoch is sampled at its time; its
    sentences start `latency_s` later. With `velocity_filter_s` the velocity passes a first-order filter with ten
    samples a second. `gaps` are the times without a fix.
    """

    def __init__(
        self,
        whereabouts: Whereabouts,
        rng: np.random.Generator,
        *,
        rate_hz: float = 1.0,
        position_noise_m: float = POSITION_NOISE_M,
        velocity_noise_m_s: float = 0.03,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        latency_s: float = 0.06,
        velocity_filter_s: float = 0.0,
        gaps: Gaps | None = None,
        talker: str = "GP",
        baud: int = 9600,
    ) -> None:
        """Start at phase_s; raise ValueError for a rate that is not positive."""
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise ValueError(f"the rate must be positive, not {rate_hz} Hz")
        self.fix = True
        self._whereabouts = whereabouts
        self._rng = rng
        self._position_noise_m = position_noise_m
        self._velocity_noise_m_s = velocity_noise_m_s
        self._correlation = math.exp(-1.0 / (rate_hz * NOISE_TIME_S))
        self._error_m = rng.normal(0.0, position_noise_m, 2)
        self._latency_s = latency_s
        self._filter = VelocityFilter(velocity_filter_s, phase_s) if velocity_filter_s > 0.0 else None
        self._gaps = gaps
        self._talker = talker
        self._pace = Pace(1.0 / rate_hz, start_s=phase_s, error_ppm=frequency_error_ppm)
        self.transmitter = Transmitter(baud)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return when the next epoch is sampled or the next burst is complete."""
        next_s = min(self._pace.next_s, self.transmitter.next_s())
        return next_s if self._filter is None else min(next_s, self._filter.next_s)

    def take_output(self, now_s: float) -> bytes:
        """Sample the epochs that are due and return the complete bursts."""
        if self._filter is not None:
            self._filter.take(now_s, self._whereabouts)
        for epoch_s in self._pace.take(now_s):
            self.transmitter.send(epoch_s + self._latency_s, self._sentences(epoch_s))
        return self.transmitter.take(now_s)

    def _sentences(self, epoch_s: float) -> bytes:
        clock, date = format_clock_and_date(self._whereabouts.utc_s())
        # The noise is also drawn without a fix, so that a gap does not change the rest of the run.
        position = self._measure_position()
        speed_m_s, course_deg = self._measure_velocity()
        if not self.fix or (self._gaps is not None and self._gaps.is_gap(epoch_s)):
            bodies = (f"RMC,{clock},V,,,,,,,{date},,,N", f"GGA,{clock},,,,,0,00,99.99,,,,,,", "VTG,,,,,,,,,N")
        else:
            knots = speed_m_s * KNOTS_PER_METRE_PER_SECOND
            course = f"{bearing(course_deg, 0.01):.2f}"
            bodies = (
                f"RMC,{clock},A,{position},{knots:.3f},{course},{date},,,A",
                f"GGA,{clock},{position},1,{_SATELLITES:02d},{_HDOP},{_ALTITUDE_M},M,{_GEOID_M},M,,",
                f"VTG,{course},T,,M,{knots:.3f},N,{speed_m_s * _KILOMETRES_PER_HOUR:.3f},K,A",
            )
        return b"".join(whole_sentence(self._talker + body) for body in bodies)

    def _measure_position(self) -> str:
        """Return latitude and longitude as NMEA fields."""
        step = self._rng.normal(0.0, self._position_noise_m, 2)
        self._error_m = self._correlation * self._error_m + math.sqrt(1.0 - self._correlation**2) * step
        latitude_deg = self._whereabouts.latitude_deg()
        cos_latitude = max(math.cos(math.radians(latitude_deg)), 1e-3)
        longitude_deg = self._whereabouts.longitude_deg() + self._error_m[1] / (METRES_PER_DEGREE * cos_latitude)
        latitude_deg += self._error_m[0] / METRES_PER_DEGREE
        longitude_deg = (longitude_deg + 180.0) % 360.0 - 180.0
        north = format_coordinate(latitude_deg, degree_digits=2, letters=("N", "S"))
        east = format_coordinate(longitude_deg, degree_digits=3, letters=("E", "W"))
        return f"{north},{east}"

    def _measure_velocity(self) -> tuple[float, float]:
        """Return speed in m/s and course in degrees."""
        velocity = _velocity_north_east(self._whereabouts) if self._filter is None else self._filter.velocity_m_s
        error_north, error_east = self._rng.normal(0.0, self._velocity_noise_m_s, 2)
        north_m_s = velocity[0] + error_north
        east_m_s = velocity[1] + error_east
        return math.hypot(north_m_s, east_m_s), degrees(math.atan2(east_m_s, north_m_s))


class VelocityFilter:
    """First-order velocity filter of a receiver, with ten samples a second."""

    def __init__(self, time_s: float, start_s: float) -> None:
        """Start at start_s; time_s is the time constant."""
        self._pace = Pace(_SAMPLE_S, start_s=start_s)
        self._weight = -math.expm1(-_SAMPLE_S / time_s)
        self._has_sample = False
        self.velocity_m_s = (0.0, 0.0)

    @property
    def next_s(self) -> float:
        """The time of the next sample."""
        return self._pace.next_s

    def take(self, now_s: float, whereabouts: Whereabouts) -> None:
        """Take the samples that are due."""
        for _ in self._pace.take(now_s):
            north_m_s, east_m_s = _velocity_north_east(whereabouts)
            previous_north, previous_east = self.velocity_m_s if self._has_sample else (north_m_s, east_m_s)
            self._has_sample = True
            self.velocity_m_s = (
                previous_north + self._weight * (north_m_s - previous_north),
                previous_east + self._weight * (east_m_s - previous_east),
            )


class Gaps:
    """Times without a fix; the durations with and without a fix have exponential distributions."""

    def __init__(self, lost_share: float, mean_s: float, rng: np.random.Generator) -> None:
        """Start with a fix, unless `lost_share`, the share of the time without a fix, is 1; mean_s is the mean gap."""
        self._lost_share, self._mean_s = lost_share, mean_s
        self._rng = rng
        self._is_gap = lost_share >= 1.0
        self._until_s = math.inf if lost_share <= 0.0 or lost_share >= 1.0 else self._draw_duration_s()

    def is_gap(self, now_s: float) -> bool:
        """Return whether there is no fix at now_s; now_s must not decrease."""
        while now_s >= self._until_s:
            self._is_gap = not self._is_gap
            self._until_s += self._draw_duration_s()
        return self._is_gap

    def _draw_duration_s(self) -> float:
        mean_fix_s = self._mean_s * (1.0 - self._lost_share) / self._lost_share
        return float(self._rng.exponential(self._mean_s if self._is_gap else mean_fix_s))


def _velocity_north_east(whereabouts: Whereabouts) -> tuple[float, float]:
    speed_m_s = whereabouts.speed_over_ground_m_s()
    course_rad = whereabouts.course_over_ground_rad()
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
