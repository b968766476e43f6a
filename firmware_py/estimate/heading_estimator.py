"""The lookout of a tick: from the samples of compasses and receiver to what is known of her heading.

Only puts together what the estimate's parts compute; `step` calls it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Estimate, Event, FixType, HeadingSample, PositionSample, Severity
from firmware_py.estimate import declination, kalman, sources, wave_filter
from firmware_py.estimate import observer as heading
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.observer import HeadingState, ObserverSettings
from firmware_py.estimate.sources import Limits, Source, SourceState, TrueHeadingSample
from firmware_py.estimate.wave_filter import FilterSettings, FilterState

SLOWEST_COURSE_M_S: Final = 0.02  # below it a receiver gives no course worth the name
WIDEST_COURSE_RAD: Final = radians(20.0)  # a heading less certain than this is not steered by without a compass
COMPASSES: Final = (Source.COMPASS_A, Source.COMPASS_B)


@dataclass(frozen=True, slots=True)
class HeadingEstimatorSettings:
    """How the heading is estimated."""

    observer: ObserverSettings
    filter: FilterSettings
    plain: bool
    declination_by_model: bool
    position_timeout_s: float
    course_speed_m_s: float
    limits: Limits

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingEstimatorSettings:
        """Read the settings from the parameters."""
        return cls(
            ObserverSettings.of(parameters),
            FilterSettings.of(parameters),
            parameters["EST_MODE"] == 0,
            parameters["CMP_DECL_AUTO"] == 1,
            parameters["POS_TIMEOUT_S"],
            parameters["COG_SPEED_MIN"],
            Limits(parameters["CMP_TIMEOUT_S"], parameters["CMP_FROZEN_S"]),
        )


@dataclass(frozen=True, slots=True)
class HeadingEstimatorState:
    """The wave filter, the heading sources and the declination of the place."""

    waves: FilterState = FilterState()  # noqa: RUF009 - frozen
    sources: SourceState = SourceState()  # noqa: RUF009 - frozen
    declination: Declination = Declination()  # noqa: RUF009 - frozen


def update(
    settings: HeadingEstimatorSettings,
    state: HeadingEstimatorState,
    before: HeadingState,
    headings: Sequence[HeadingSample],
    positions: Sequence[PositionSample],
    rudder_rad: float,
    now_s: float,
) -> tuple[HeadingEstimatorState, HeadingState, tuple[Event, ...]]:
    """Take a tick's samples in; return what is remembered, what is steered by, and what is to be told."""
    observer = settings.observer
    if settings.declination_by_model:
        state = _with_declination(state, positions)
        if state.declination.declination_rad is not None:
            observer = replace(observer, declination_rad=state.declination.declination_rad)
    if settings.plain:
        first = [sample for sample in headings if sample.source == Source.COMPASS_A]
        known = heading.update(observer, before, first, rudder_rad, now_s)
        return replace(state, waves=FilterState(), sources=SourceState()), known, ()
    seen = [
        TrueHeadingSample(sample.t_s, heading.true_heading_rad(observer, sample), sample.heading_rad, sample.source)
        for sample in headings
        if math.isfinite(sample.heading_rad) and math.isfinite(sample.t_s) and sample.source in COMPASSES
    ]
    anew: tuple[Event, ...] = ()
    if sources.estranged(state.sources, now_s, settings.observer.timeout_s):
        state = HeadingEstimatorState(declination=state.declination)
        anew = (Event(Severity.WARNING, "Heading estimate is begun anew"),)
    chosen, told = _select_source(settings, state, seen, before, now_s)
    used = sources.usable(chosen, seen)
    waves = wave_filter.update(settings.filter, state.waves, used, velocities_of(positions), rudder_rad)
    state = HeadingEstimatorState(waves, chosen, state.declination)
    if not waves.x:
        return state, before, anew + told
    heading_rad, yaw_rate_rad_s = wave_filter.predict_heading(settings.filter, waves, now_s)
    # Fixes come rarely; whether they still come has been judged by their own timeout.
    heard_s = now_s if chosen.in_use is Source.COURSE else waves.sample_t_s
    newest = headings[-1] if headings else before
    return (
        state,
        HeadingState(now_s, heading_rad, yaw_rate_rad_s, heard_s, newest.roll_rad, newest.pitch_rad),
        anew + told,
    )


def _with_declination(state: HeadingEstimatorState, positions: Sequence[PositionSample]) -> HeadingEstimatorState:
    """Know the declination of where she is."""
    known = state.declination
    for sample in positions:
        latitude_rad, longitude_rad = sample.latitude_rad, sample.longitude_rad
        if sample.fix is FixType.NONE or latitude_rad is None or longitude_rad is None:
            continue
        if abs(latitude_rad) <= 0.5 * math.pi and abs(longitude_rad) <= math.pi:
            known = declination.update(known, latitude_rad, longitude_rad, sample.utc_s)
    return state if known is state.declination else replace(state, declination=known)


def _select_source(
    settings: HeadingEstimatorSettings,
    state: HeadingEstimatorState,
    seen: Sequence[TrueHeadingSample],
    before: HeadingState,
    now_s: float,
) -> tuple[SourceState, tuple[Event, ...]]:
    """Judge the sources by what they say and choose one."""
    waves, known = state.waves, sources.decay_offsets(state.sources, clamp(now_s - before.t_s, 0.0, 1.0))
    expected_rad = waves.x[kalman.HEADING] + waves.x[kalman.WAVE] if waves.x else None
    for sample in seen:
        known = sources.add_sample(known, sample, expected_rad)
    course_ok = (
        bool(waves.x)  # not begun, or begun anew, it may know of a fix and of nothing else
        and waves.fix_t_s is not None
        and now_s - waves.fix_t_s <= settings.position_timeout_s
        and waves.spread(kalman.HEADING) <= WIDEST_COURSE_RAD
        and waves.x[kalman.SPEED] >= settings.course_speed_m_s
    )
    return sources.select(known, now_s, settings.limits, course_ok=course_ok)


def velocities_of(positions: Sequence[PositionSample]) -> list[wave_filter.Velocity]:
    """Return time, speed and course over the ground of the fixes that state them."""
    found = []
    for sample in positions:
        speed_m_s, course_rad = sample.speed_over_ground_m_s, sample.course_over_ground_rad
        if sample.fix is FixType.NONE or speed_m_s is None:
            continue
        if course_rad is not None:
            found.append((sample.t_s, speed_m_s, course_rad))
        elif speed_m_s < SLOWEST_COURSE_M_S:
            found.append((sample.t_s, speed_m_s, 0.0))
    return found


def report(state: HeadingEstimatorState, known: HeadingState) -> Estimate | None:
    """Return what the filter knows, for the log and the link; None without a filter."""
    waves = state.waves
    if not waves.x:
        return None
    x, learned = waves.x, waves.learned
    return Estimate(
        source=int(state.sources.in_use),
        heading_rad=known.heading_rad,
        heading_sd_rad=waves.spread(kalman.HEADING),
        yaw_rate_rad_s=known.yaw_rate_rad_s,
        yaw_rate_sd_rad_s=waves.spread(kalman.RATE),
        bias_rad=x[kalman.BIAS],
        bias_sd_rad=waves.spread(kalman.BIAS),
        wave_period_s=2.0 * math.pi / learned.omega_rad_s,
        wave_sd_rad=learned.wave_spread_rad,
        compass_noise_rad=math.exp(0.5 * learned.log_noise),
        speed_m_s=x[kalman.SPEED],
        speed_sd_m_s=waves.spread(kalman.SPEED),
        current_north_m_s=x[kalman.NORTH],
        current_east_m_s=x[kalman.EAST],
        turning_factor=x[kalman.FACTOR],
        innovation_rad=waves.innovation_rad,
        innovation_sd_rad=waves.innovation_sd_rad,
        innovation_square=learned.average_square,
    )
