"""Speed through the water, current and leeway in a tick, from positions. Numeric core; the filter is water_filter.py.

On a constant heading only the sum of the speed and the current along it is observable, and across it only the sum of
sideways speed and current. A turn makes them observable separately; the standard deviations are large until then.

The estimate varies from position to position within its standard deviation. In a current nearly as fast as the boat
this would also vary the heading for a course, and with it the rudder. So guidance uses slow values: the estimate
through a low-pass filter, limited to the standard deviation around the estimate.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate import water_filter, water_results
from firmware_py.estimate.water_filter import Water, WaterFilter
from firmware_py.estimate.water_results import CurrentVerdict
from firmware_py.model.kt import KtModel, scaled

# Standard deviations of the values expected before the first position.
FIRST_SPEED_SD_M_S, FIRST_CURRENT_SD_M_S, FIRST_SIDEWAYS_SD_M_S = 0.3, 0.3, 0.1
SLOW_TIME_CONSTANT_S: Final = 30.0
EDDY_SD_M_S: Final = 0.03  # of small eddies, relative to the filtered current
MAX_ORIGIN_DISTANCE_M: Final = 5000.0  # per axis; beyond it the origin is moved to the boat
SPEED_RATIOS: Final = (0.1, 10.0)  # limits of the speed divided by the speed of the model
KNOWN_SPEED_SD_M_S: Final = 0.05  # at which estimate and expected speed have the same weight
STRETCH_S: Final = 10.0  # duration of a stretch of track, for a heading from it


class Expected(NamedTuple):
    """Expected or slow values: current north and east, and speed through the water [m/s]."""

    north_m_s: float = 0.0
    east_m_s: float = 0.0
    speed_m_s: float = 0.5


class Place(NamedTuple):
    """Origin of the local coordinates."""

    latitude_rad: float = 0.0
    longitude_rad: float = 0.0


class Stretch(NamedTuple):
    """Start of a stretch of track (t_s NaN: there is none), and the estimated heading on it.

    `heading_rad` is the last one (NaN: none); `cosine_s` and `sine_s` are the integrals of the heading's cosine and
    sine since the start.
    """

    t_s: float = math.nan
    north_m: float = 0.0
    east_m: float = 0.0
    heading_rad: float = math.nan
    cosine_s: float = 0.0
    sine_s: float = 0.0


NO_STRETCH: Final = Stretch()
NO_PLACE: Final = Place()
NO_EXPECTATION: Final = Expected()
NO_FILTER: Final = WaterFilter()
NO_VERDICT: Final = CurrentVerdict()


class WaterState(NamedTuple):
    """Time of the last position (NaN: none), filter, verdict on the current, slow values.

    `slow_t_s` is the time of the slow values; while it is NaN, they are equal to `expected`.
    """

    fix_t_s: float = math.nan
    filter: WaterFilter = NO_FILTER
    verdict: CurrentVerdict = NO_VERDICT
    slow_t_s: float = math.nan
    slow: Expected = NO_EXPECTATION
    expected: Expected = NO_EXPECTATION
    origin: Place = NO_PLACE
    stretch: Stretch = NO_STRETCH


def begin_filter(t_s: float, e: Expected) -> WaterFilter:
    """Return the filter at the first position, which is the origin, with the expected speed and current."""
    return water_filter.begin(
        t_s, 0.0, 0.0, e.speed_m_s, FIRST_SPEED_SD_M_S, e.north_m_s, e.east_m_s, FIRST_CURRENT_SD_M_S, 0.0,
        FIRST_SIDEWAYS_SD_M_S,
    )  # fmt: skip


def initial_state(north_m_s: float, east_m_s: float, speed_m_s: float) -> WaterState:
    """Return the state before the first position, with the expected current and speed [m/s]."""
    expected = Expected(north_m_s, east_m_s, speed_m_s)
    return WaterState(
        math.nan, begin_filter(0.0, expected), NO_VERDICT, math.nan, expected, expected, NO_PLACE, NO_STRETCH
    )


START: Final = initial_state(0.0, 0.0, 0.5)


def has_started(s: WaterState) -> bool:
    """Return whether there has been a position."""
    return not math.isnan(s.fix_t_s)


def with_filter(s: WaterState, fix_t_s: float, f: WaterFilter, origin: Place, stretch: Stretch) -> WaterState:
    """Return the state with this filter and its fix time, origin and stretch."""
    return WaterState(fix_t_s, f, s.verdict, s.slow_t_s, s.slow, s.expected, origin, stretch)


def take_heading(s: WaterState, heading_rad: float, is_compass_used: bool, step_s: float) -> WaterState:  # noqa: FBT001 - compiled
    """Return the state after step_s on this estimated heading; the filter uses it only if a compass is in use."""
    if not has_started(s):
        return s
    f, t = water_filter.take_heading(s.filter, heading_rad if is_compass_used else math.nan, step_s), s.stretch
    stretch = Stretch(
        t.t_s, t.north_m, t.east_m, heading_rad,
        t.cosine_s + step_s * math.cos(heading_rad), t.sine_s + step_s * math.sin(heading_rad),
    )  # fmt: skip
    return with_filter(s, s.fix_t_s, f, s.origin, stretch)


def offset_m(origin: Place, latitude_rad: float, longitude_rad: float) -> tuple[float, float]:
    """Return the offset of a position north and east of the origin [m], for distances of kilometres."""
    east_rad = wrap_pi(longitude_rad - origin.longitude_rad)
    middle_rad = 0.5 * (latitude_rad + origin.latitude_rad)
    return EARTH_RADIUS_M * (latitude_rad - origin.latitude_rad), EARTH_RADIUS_M * math.cos(middle_rad) * east_rad


def take_position(
    s: WaterState, t_s: float, latitude_rad: float, longitude_rad: float
) -> tuple[WaterState, float, float]:
    """Return the state with a position, and the heading from the track with its standard deviation (NaN: none).

    A stretch of track gives the mean heading. The difference between the last and the mean estimated heading is added
    to it for the heading at the end.
    """
    position, heading_rad, sd_rad = Place(latitude_rad, longitude_rad), math.nan, math.nan
    if not has_started(s):
        return with_filter(s, t_s, begin_filter(t_s, s.expected), position, NO_STRETCH), heading_rad, sd_rad
    f, origin, stretch = s.filter, s.origin, s.stretch
    north_m, east_m = offset_m(origin, latitude_rad, longitude_rad)
    if abs(north_m) > MAX_ORIGIN_DISTANCE_M or abs(east_m) > MAX_ORIGIN_DISTANCE_M:
        f, origin, stretch = water_filter.with_moved_origin(f, north_m, east_m), position, NO_STRETCH
        north_m = east_m = 0.0
    f = water_filter.correct(f, t_s, north_m, east_m)
    duration_s = t_s - stretch.t_s
    if not 0.0 <= duration_s < STRETCH_S:
        if duration_s <= 3.0 * STRETCH_S:  # a longer one contains a gap
            heading_rad, sd_rad = water_results.heading_from_track(
                f, t_s, north_m - stretch.north_m, east_m - stretch.east_m, duration_s
            )
            heading_rad += wrap_pi(stretch.heading_rad - math.atan2(stretch.sine_s, stretch.cosine_s))
        stretch = Stretch(t_s, north_m, east_m, stretch.heading_rad, 0.0, 0.0)
    return with_filter(s, t_s, f, origin, stretch), heading_rad, sd_rad


def follow_slowly(previous: float, estimate: float, gain: float, sd: float) -> float:
    """Return the low-pass filtered value, limited to the standard deviation around the estimate."""
    return clamp(previous + gain * (estimate - previous), estimate - sd, estimate + sd)


def update(s: WaterState, now_s: float) -> WaterState:
    """Return the state after a tick: the verdict on the current and the slow values."""
    if not has_started(s):
        return s
    estimate = water_filter.water_at(s.filter, now_s)
    verdict = water_results.judge_current(s.verdict, s.filter, estimate, now_s)
    north, east, speed = estimate.current_north_m_s, estimate.current_east_m_s, estimate.mean_speed_m_s
    if not math.isnan(s.slow_t_s):
        gain, p = clamp((now_s - s.slow_t_s) / SLOW_TIME_CONSTANT_S, 0.0, 1.0), estimate.covariance
        north = follow_slowly(s.slow.north_m_s, north, gain, math.sqrt(max(p[0], 0.0)))
        east = follow_slowly(s.slow.east_m_s, east, gain, math.sqrt(max(p[4], 0.0)))
        speed = follow_slowly(s.slow.speed_m_s, speed, gain, estimate.mean_speed_sd_m_s)
    slow = Expected(north, east, max(speed, water_filter.MIN_SPEED_M_S))
    return WaterState(s.fix_t_s, s.filter, verdict, now_s, slow, s.expected, s.origin, s.stretch)


def estimate_at(s: WaterState, t_s: float) -> Water:
    """Return the estimate at a time; before the first position it has the expected values."""
    return water_filter.water_at(s.filter, t_s if has_started(s) else s.filter.t_s)


def guidance_values(s: WaterState) -> tuple[float, float, float, float]:
    """Return current north and east, speed through the water [m/s] and leeway [rad] for guidance."""
    state = s.filter.means[0]
    leeway_rad = math.atan2(
        state[water_filter.SIDEWAYS], max(state[water_filter.MEAN_SPEED], water_filter.MIN_SPEED_M_S)
    )
    return s.slow.north_m_s, s.slow.east_m_s, s.slow.speed_m_s, leeway_rad


def mean_speed_sd(s: WaterState) -> float:
    """Return the standard deviation of the estimated mean speed through the water [m/s]."""
    return water_filter.standard_deviation(s.filter.covariances[0, water_filter.MEAN_SPEED, water_filter.MEAN_SPEED])


def model_speed(s: WaterState) -> float:
    """Return the speed through the water for the K-T model [m/s].

    Errors of speed and heading would increase each other. So this is the expected speed while the standard deviation
    of the estimated one is much larger than KNOWN_SPEED_SD_M_S, and the estimated one while it is much smaller.
    """
    sd_ratio = mean_speed_sd(s) / KNOWN_SPEED_SD_M_S
    return s.expected.speed_m_s + (s.slow.speed_m_s - s.expected.speed_m_s) / (1.0 + sd_ratio * sd_ratio)


def model_at_speed(model: KtModel, s: WaterState) -> KtModel:
    """Return the K-T model at `model_speed`, limited by SPEED_RATIOS."""
    ratio = clamp(model_speed(s) / model.speed_m_s, SPEED_RATIOS[0], SPEED_RATIOS[1])
    ability_1_s, lag_s, norrbin_s2 = scaled(model, ratio)
    return KtModel(ability_1_s, lag_s, norrbin_s2, model.rudder_offset_rad, ratio * model.speed_m_s)


def over_ground_m_s(s: WaterState, heading_rad: float) -> tuple[float, float]:
    """Return the velocity over ground north and east on a heading; that of the current if the heading is NaN."""
    north_m_s, east_m_s, speed_m_s, leeway_rad = guidance_values(s)
    if math.isnan(heading_rad):
        return north_m_s, east_m_s
    course_rad = heading_rad + leeway_rad
    return north_m_s + speed_m_s * math.cos(course_rad), east_m_s + speed_m_s * math.sin(course_rad)


def speed_sd(s: WaterState) -> float:
    """Return the standard deviation of the mean speed through the water with small eddies [m/s]."""
    return math.hypot(mean_speed_sd(s), EDDY_SD_M_S)
