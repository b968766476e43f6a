"""Wind over the ground from measurements on the moving boat, its mean values and gusts.

The wind velocity over the ground [m/s, north and east] is the apparent wind plus the velocity v of the boat:

    w = -V (cos(psi + beta), sin(psi + beta)) + v

with the apparent wind speed V, the angle beta from the bow from which it comes, and the heading psi of the boat. v is
the velocity over the ground: that of the GNSS fix while it is fresh, otherwise that of the water filter (speed through
the water, leeway, current). A wind that the sensor has corrected is used as it is, without v; one over the water
(`BOW_WATER`) differs from the wind over the ground by the current.

Mean and gust are those of meteorology (WMO-No. 8, Guide to Instruments and Methods of Observation, vol. I, chapter 5):
speeds are means of the speed, directions those of the mean vector; the gust is the maximum of the mean over 3 s in the
last 10 minutes. The mean is that over 2 minutes, as for airfields. The height of the sensor is not corrected to 10 m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.records import WindReference, WindSample
from firmware_py.common.reports import Wind

SHORT_S: Final = 10  # of the present wind
MEAN_S: Final = 120
GUST_S: Final = 3
MIN_GUST_SECONDS: Final = 2  # with samples, of the GUST_S: the clock of a sensor of 1 Hz is not that of the boat
GUST_MINUTES: Final = 10
Velocity = tuple[float, float]  # north and east [m/s]


class Motion(msgspec.Struct, frozen=True):
    """Heading, velocity over the ground (north, east) and magnetic declination of the boat; a heading None: unknown."""

    heading_rad: float | None
    north_m_s: float
    east_m_s: float
    declination_rad: float = 0.0


class Second(msgspec.Struct, frozen=True):
    """Number of the samples of one second of the clock, and their means; the velocity is that of the air."""

    second: int
    count: int
    north_m_s: float
    east_m_s: float
    wind_m_s: float


class Peak(msgspec.Struct, frozen=True):
    """The maximum gust that ended in one minute of the clock."""

    minute: int
    gust_m_s: float


class WindState(msgspec.Struct, frozen=True):
    """The seconds of the last MEAN_S, the gusts of the last GUST_MINUTES, and the report after the newest sample."""

    seconds: tuple[Second, ...] = ()
    peaks: tuple[Peak, ...] = ()
    report: Wind | None = None


def velocity_over_ground(sample: WindSample, motion: Motion) -> Velocity | None:
    """Return the velocity of the air over the ground; None if it needs a heading and there is none."""
    from_rad, drift = sample.angle_rad, (0.0, 0.0)
    if sample.reference is WindReference.MAGNETIC:
        from_rad += motion.declination_rad
    elif sample.reference is not WindReference.NORTH:
        if motion.heading_rad is None:
            return None
        from_rad += motion.heading_rad
        if sample.reference is WindReference.APPARENT:
            drift = (motion.north_m_s, motion.east_m_s)
    return drift[0] - sample.wind_m_s * math.cos(from_rad), drift[1] - sample.wind_m_s * math.sin(from_rad)


def update(state: WindState, samples: Sequence[WindSample], motion: Motion) -> WindState:
    """Return the state after the samples of a tick, at least one, in order."""
    for sample in samples:
        if (velocity := velocity_over_ground(sample, motion)) is not None:
            state = _add(state, sample.t_s, velocity)
    return replace(state, report=_report(state, samples[-1]))


def _add(state: WindState, t_s: float, velocity: Velocity) -> WindState:
    """Return the state with a velocity added."""
    second, last = math.floor(t_s), state.seconds[-1] if state.seconds else None
    north_m_s, east_m_s = velocity
    wind_m_s = math.hypot(north_m_s, east_m_s)
    if last is not None and last.second >= second:
        count = last.count + 1
        merged = Second(
            last.second,
            count,
            last.north_m_s + (north_m_s - last.north_m_s) / count,
            last.east_m_s + (east_m_s - last.east_m_s) / count,
            last.wind_m_s + (wind_m_s - last.wind_m_s) / count,
        )
        return replace(state, seconds=(*state.seconds[:-1], merged))
    peaks = state.peaks if last is None else _with_gust(state, last.second)
    kept = tuple(entry for entry in state.seconds if entry.second > second - MEAN_S)
    return replace(state, seconds=(*kept, Second(second, 1, north_m_s, east_m_s, wind_m_s)), peaks=peaks)


def _with_gust(state: WindState, second: int) -> tuple[Peak, ...]:
    """Return the gusts with the mean of the GUST_S that end with this second, which is complete."""
    window = [entry for entry in state.seconds[-GUST_S:] if entry.second > second - GUST_S]
    minute = second // 60
    peaks = tuple(peak for peak in state.peaks if peak.minute > minute - GUST_MINUTES)
    if len(window) < MIN_GUST_SECONDS:
        return peaks
    gust_m_s = _mean([entry.wind_m_s for entry in window])
    if peaks and peaks[-1].minute == minute:
        return (*peaks[:-1], Peak(minute, max(gust_m_s, peaks[-1].gust_m_s)))
    return (*peaks, Peak(minute, gust_m_s))


def _report(state: WindState, sample: WindSample) -> Wind:
    """Return the report after a sample."""
    newest_s = math.floor(sample.t_s)
    mean = [entry for entry in state.seconds if entry.second > newest_s - MEAN_S]
    short = [entry for entry in mean if entry.second > newest_s - SHORT_S]
    is_apparent = sample.reference is WindReference.APPARENT
    report = Wind(sample.t_s, sample.wind_m_s if is_apparent else None, sample.angle_rad if is_apparent else None)
    if not short:
        return report
    speeds = [entry.wind_m_s for entry in mean]
    gusts = [peak.gust_m_s for peak in state.peaks if peak.minute > (newest_s - 1) // 60 - GUST_MINUTES]
    mean_m_s = _mean(speeds)
    north_m_s, east_m_s = _mean([entry.north_m_s for entry in short]), _mean([entry.east_m_s for entry in short])
    return replace(
        report,
        north_m_s=north_m_s,
        east_m_s=east_m_s,
        wind_m_s=_mean([entry.wind_m_s for entry in short]),
        from_rad=_origin_rad(north_m_s, east_m_s),
        mean_m_s=mean_m_s,
        mean_from_rad=_origin_rad(
            _mean([entry.north_m_s for entry in mean]), _mean([entry.east_m_s for entry in mean])
        ),
        sd_m_s=math.sqrt(_mean([(speed - mean_m_s) ** 2 for speed in speeds])),
        gust_m_s=max(gusts, default=None),
    )


def _origin_rad(north_m_s: float, east_m_s: float) -> float:
    """Return the direction from which air with this velocity comes."""
    return wrap_two_pi(math.atan2(-east_m_s, -north_m_s))


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
