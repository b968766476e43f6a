"""Heading estimate of a tick from the records of compasses and receiver; the calculation is heading_tick.py."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, HeadingSample, NorthReference, PositionSample, Severity
from firmware_py.common.reports import Estimate, Water
from firmware_py.estimate import (
    declination,
    gyro,
    heading_filter,
    heading_tick,
    observer,
    prediction_check,
    sources,
    variation,
    water,
)
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.gyro import GyroState
from firmware_py.estimate.heading_tick import HeadingSettings, HeadingTick
from firmware_py.estimate.observer import HeadingState, ObserverSettings
from firmware_py.estimate.position import place_of
from firmware_py.estimate.sources import Source, TrueHeadingSample
from firmware_py.estimate.water import WaterState
from firmware_py.model.heading_estimate import HeadingEstimate
from firmware_py.model.kt import KtModel

COMPASSES: Final = (Source.COMPASS_A, Source.COMPASS_B)
NAMES: Final = {Source.COMPASS_A: "compass A", Source.COMPASS_B: "compass B", Source.COURSE: "course over ground"}


class HeadingEstimatorSettings(msgspec.Struct, frozen=True):
    """Settings of the heading estimate; `observer_only`: the fixed-gain observer of compass A replaces the filter."""

    observer: ObserverSettings
    tick: HeadingSettings
    observer_only: bool
    declination_by_model: bool

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingEstimatorSettings:
        """Read the settings from the parameters."""
        return cls(
            observer=ObserverSettings.of(parameters),
            tick=HeadingSettings.of(parameters),
            observer_only=parameters["EST_MODE"] == 0,
            declination_by_model=parameters["CMP_DECL_AUTO"] == 1,
        )


class HeadingTimeouts(msgspec.Struct, frozen=True):
    """Time-outs of compass A, compass B and the fixes, which give the course over ground."""

    compass_s: tuple[float, float]
    position_s: float

    def of(self, source: Source) -> float:
        """Return the time-out of a compass; for any other source, that of compass A."""
        return self.compass_s[source if source in COMPASSES else 0]


class HeadingEstimatorState(msgspec.Struct, frozen=True):
    """Heading and yaw rate of the tick, state of the filter and its sources, water, declination at the position.

    `odd_variation`: variations that the compasses state and that are not used as stated. `gyro`: comparison of a
    gyroscope without north with the compass.
    """

    heading: HeadingState = HeadingState()
    tick: HeadingTick = heading_tick.START
    water: WaterState = water.START
    declination: Declination = Declination()
    odd_variation: variation.UnusedVariations = (None, None)
    gyro: GyroState = gyro.START

    @classmethod
    def at_start(cls, parameters: ParameterSet) -> HeadingEstimatorState:
        """Return the state before the first heading."""
        return with_expected_water(cls(), (0.0, 0.0, parameters["CRUISE_SPEED"]))


def with_expected_water(state: HeadingEstimatorState, water_m_s: tuple[float, float, float]) -> HeadingEstimatorState:
    """Return the state with the water restarted at the expected current north and east, and speed [m/s]."""
    return replace(state, water=water.initial_state(*water_m_s))


def update(
    settings: HeadingEstimatorSettings,
    state: HeadingEstimatorState,
    headings: Sequence[HeadingSample],
    positions: Sequence[PositionSample],
    rudder_rad: float,
    timeouts: HeadingTimeouts,
    now_s: float,
) -> tuple[HeadingEstimatorState, tuple[Event, ...]]:
    """Return the state after the samples of a tick, and the events.

    `positions` are the accepted ones. `rudder_rad` is the angle measured at this tick; NaN: not known.
    """
    previous, tick = state.heading, state.tick
    gyro_samples, headings = _split_samples(headings)
    observer_settings = settings.observer
    if settings.declination_by_model:
        state = _with_declination(state, positions)
        if state.declination.declination_rad is not None:
            observer_settings = replace(observer_settings, declination_rad=state.declination.declination_rad)
    declination_rad = observer_settings.declination_rad or None
    odd_variation, events = variation.find_unused(state.odd_variation, headings, declination_rad)
    headings = [variation.apply(sample, declination_rad) for sample in headings]
    true_samples = _to_true_headings(observer_settings, headings)
    previous_source = tick.sources.in_use
    if heading_tick.needs_restart(tick, now_s, timeouts.compass_s):
        events = (*events, Event(Severity.WARNING, "Heading estimate restarted"))
        previous_source = Source.NONE
    model = water.model_at_speed(settings.tick.model, state.water)
    tick = heading_tick.begin_tick(tick, now_s, now_s - previous.t_s, timeouts.compass_s)
    for sample in true_samples:
        tick = heading_tick.add_sample(tick, model, sample)
    tick = heading_tick.select(tick, settings.tick, model, now_s, timeouts.compass_s, state.water, timeouts.position_s)
    in_use = tick.sources.in_use
    if in_use != previous_source:
        events = (*events, change_event(previous_source, Source(in_use)))
    for sample in true_samples:
        if sample.source == in_use:
            timeout_s = timeouts.of(Source(in_use))
            tick = heading_tick.take_heading(tick, settings.tick, model, sample.t_s, sample.heading_rad, timeout_s)
    gyro_state = state.gyro
    if gyro_samples:
        tick, gyro_state, gyro_events = _take_rate(tick, gyro_state, gyro_samples, true_samples)
        events = (*events, *gyro_events)
    water_state = state.water
    for fix in positions:
        place = place_of(fix)
        water_state, course_rad, sd_rad = water.take_position(
            water_state, fix.t_s, place.latitude_rad, place.longitude_rad
        )
        tick = heading_tick.take_course(tick, settings.tick, fix.t_s, course_rad, sd_rad)
    tick = heading_tick.end_tick(tick, rudder_rad)
    heading = _heading_to_steer_by(
        settings, observer_settings, state, tick, model, headings, timeouts, rudder_rad, now_s
    )
    if heading.t_s == now_s:
        is_compass_used = sources.uses_compass(tick.sources)
        water_state = water.take_heading(water_state, heading.heading_rad, is_compass_used, now_s - previous.t_s)
    water_state = water.update(water_state, now_s)
    return HeadingEstimatorState(heading, tick, water_state, state.declination, odd_variation, gyro_state), events


def _split_samples(
    headings: Sequence[HeadingSample],
) -> tuple[Sequence[HeadingSample], Sequence[HeadingSample]]:
    """Return the samples of gyroscopes without north, and the others."""
    gyro_samples = [sample for sample in headings if sample.reference is NorthReference.RELATIVE]
    if not gyro_samples:
        return (), headings
    return gyro_samples, [sample for sample in headings if sample.reference is not NorthReference.RELATIVE]


def _take_rate(
    tick: HeadingTick,
    state: GyroState,
    gyro_samples: Sequence[HeadingSample],
    true_samples: Sequence[TrueHeadingSample],
) -> tuple[HeadingTick, GyroState, tuple[Event, ...]]:
    """Return the heading estimate with the yaw rate of a gyroscope, its comparison with the compass, and the events.

    The rate is used at the time of a heading of the compass in use. With course over ground, whose headings are rare,
    it is used in each tick.
    """
    in_use = tick.sources.in_use
    used = [sample for sample in true_samples if sample.source == in_use]
    state, events = gyro.update(state, gyro_samples, (used[-1].t_s, used[-1].heading_rad) if used else None)
    rate_rad_s, levels = gyro.rate_at(state, tick.filter.t_s), tick.filter.levels
    if not math.isnan(rate_rad_s) and (used or in_use == Source.COURSE):
        sd_rad_s = gyro.rate_sd_rad_s(math.exp(levels.wave_sd), math.exp(levels.wave_period))
        tick = heading_tick.take_rate(tick, rate_rad_s, sd_rad_s)
    return tick, state, events


def _to_true_headings(settings: ObserverSettings, headings: Sequence[HeadingSample]) -> list[TrueHeadingSample]:
    """Return the finite samples of the known compasses with their headings from true north."""
    return [
        TrueHeadingSample(sample.t_s, observer.true_heading_rad(settings, sample), sample.heading_rad, sample.source)
        for sample in headings
        if math.isfinite(sample.heading_rad) and math.isfinite(sample.t_s) and sample.source in COMPASSES
    ]


def _heading_to_steer_by(
    settings: HeadingEstimatorSettings,
    observer_settings: ObserverSettings,
    state: HeadingEstimatorState,
    tick: HeadingTick,
    model: KtModel,
    headings: Sequence[HeadingSample],
    timeouts: HeadingTimeouts,
    rudder_rad: float,
    now_s: float,
) -> HeadingState:
    """Return heading and yaw rate for the control law at now_s, and the time of the last sample."""
    previous = state.heading
    if settings.observer_only:
        compass_a = [sample for sample in headings if sample.source == Source.COMPASS_A]
        observer_settings = replace(observer_settings, timeout_s=timeouts.compass_s[Source.COMPASS_A])
        return observer.update(observer_settings, previous, compass_a, rudder_rad, now_s)
    if not heading_filter.has_started(tick.filter):
        return previous
    heading_rad, yaw_rate_rad_s = heading_tick.heading_at(tick, model, now_s)
    # With course over ground the fixes are rare, and their time-out is checked in `select`.
    sample_t_s: float | None = now_s
    if tick.sources.in_use != Source.COURSE:
        sample_t_s = tick.filter.t_s if previous.sample_t_s is None else max(previous.sample_t_s, tick.filter.t_s)
    newest = headings[-1] if headings else previous
    return HeadingState(now_s, heading_rad, yaw_rate_rad_s, sample_t_s, newest.roll_rad, newest.pitch_rad)


def change_event(previous: Source, current: Source) -> Event:
    """Return the event of a change of the heading source."""
    if current is Source.NONE:
        return Event(Severity.ERROR, f"Heading lost: {NAMES[previous]} failed")
    if previous is Source.NONE:
        return Event(Severity.INFO, f"Heading source: {NAMES[current]}")
    is_worse = current > previous
    return Event(
        Severity.WARNING if is_worse else Severity.NOTICE, f"Heading source: {NAMES[current]} (was {NAMES[previous]})"
    )


def _with_declination(state: HeadingEstimatorState, positions: Sequence[PositionSample]) -> HeadingEstimatorState:
    """Return the state with the declination at the last position."""
    current = state.declination
    for sample in positions:
        place = place_of(sample)
        current = declination.update(current, place.latitude_rad, place.longitude_rad, sample.utc_s)
    return state if current is state.declination else replace(state, declination=current)


def heading_estimate(settings: HeadingEstimatorSettings, state: HeadingEstimatorState) -> HeadingEstimate | None:
    """Return the input of the control law; None if the filter is not used: not started, or not consistent."""
    tick = state.tick
    if settings.observer_only or not heading_tick.is_trusted(tick):
        return None
    heading = state.heading
    return heading_tick.estimate_of(tick, heading.heading_rad, heading.yaw_rate_rad_s, state.water)


def report(settings: HeadingEstimatorSettings, state: HeadingEstimatorState) -> Estimate | None:
    """Return the estimate for the log and the link; None if the filter is not used or has not started."""
    heading, tick = state.heading, state.tick
    if settings.observer_only or not heading_filter.has_started(tick.filter):
        return None
    f, m, levels = tick.filter, tick.filter.motion, tick.filter.levels
    estimate = water.estimate_at(state.water, heading.t_s)
    inflation = prediction_check.sd_inflation(tick.check)
    return Estimate(
        int(tick.sources.in_use),
        heading.heading_rad,
        heading_tick.heading_sd(tick),
        heading.yaw_rate_rad_s,
        inflation * math.sqrt(m.p11),
        m.bias_rad,
        inflation * math.sqrt(m.p22),
        wave_period_s=math.exp(levels.wave_period),
        wave_sd_rad=math.exp(levels.wave_sd),
        compass_noise_rad=math.exp(levels.compass_noise),
        speed_m_s=estimate.speed_m_s,
        speed_sd_m_s=estimate.speed_sd_m_s,
        current_north_m_s=estimate.current_north_m_s,
        current_east_m_s=estimate.current_east_m_s,
        innovation_rad=f.innovation_rad,
        innovation_sd_rad=f.innovation_sd_rad,
        innovation_square=f.innovation_square,
        wave_yaw_rad=m.wave_rad,
        wave_damping=math.exp(levels.wave_damping),
        yaw_diffusion_rad2_s=math.exp(levels.diffusion),
        bias_walk_rad_sqrt_s=math.exp(levels.bias_walk),
        prediction_square=tick.check.mean_square,
    )


def water_report(state: HeadingEstimatorState) -> Water:
    """Return speed, current and leeway for guidance; before the first position, the expected values."""
    north_m_s, east_m_s, speed_m_s, leeway_rad = water.guidance_values(state.water)
    estimate = water.estimate_at(state.water, state.heading.t_s)
    return Water(
        speed_m_s,
        math.hypot(estimate.mean_speed_sd_m_s, water.EDDY_SD_M_S),
        north_m_s,
        east_m_s,
        math.hypot(estimate.current_sd_m_s, water.EDDY_SD_M_S),
        leeway_rad,
        estimate.leeway_sd_rad,
        state.water.verdict.too_strong > 0.5,
    )
