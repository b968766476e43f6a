"""The boat's heading in a tick, from the samples of compasses and receiver.

Only puts together what the estimate's parts compute; core/step calls it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, FixType, HeadingSample, PositionSample, Severity
from firmware_py.common.reports import Estimate
from firmware_py.estimate import declination, kalman, observer, sources, standstill, track_average, wave_filter
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.observer import HeadingState, ObserverSettings
from firmware_py.estimate.sources import Source, SourceState, TrueHeadingSample
from firmware_py.estimate.track_average import Stretch
from firmware_py.estimate.wave_filter_state import Heading, Velocity, WaveFilterSettings, WaveFilterState, water_of
from firmware_py.model.heading_estimate import HeadingEstimate

SLOWEST_COURSE_M_S: Final = 0.02  # below it a receiver gives no course worth the name
WIDEST_COURSE_RAD: Final = radians(20.0)  # a heading less certain than this is not steered by without a compass
LONGEST_CARRIED_S: Final = 2.0  # a yaw rate says nothing of what comes later
COMPASSES: Final = (Source.COMPASS_A, Source.COMPASS_B)
NAMES: Final = ("compass A", "compass B", "course over ground", "no heading source")


class HeadingEstimatorSettings(msgspec.Struct, frozen=True):
    """How the heading is estimated.

    `frozen_s`: a compass that shows the same number for longer has stopped measuring (0: any time is allowed).
    """

    observer: ObserverSettings
    wave_filter: WaveFilterSettings
    frozen_s: float
    observer_only: bool
    declination_by_model: bool
    course_speed_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingEstimatorSettings:
        """Read the settings from the parameters."""
        return cls(
            observer=ObserverSettings.of(parameters),
            wave_filter=WaveFilterSettings.of(parameters),
            frozen_s=parameters["CMP_FROZEN_S"],
            observer_only=parameters["EST_MODE"] == 0,
            declination_by_model=parameters["CMP_DECL_AUTO"] == 1,
            course_speed_m_s=parameters["COG_SPEED_MIN"],
        )


class HeadingTimeouts(msgspec.Struct, frozen=True):
    """After what silence compass A, compass B and the fixes, which give the course over ground, are lost."""

    compass_s: tuple[float, float]
    position_s: float

    def of(self, source: Source) -> float:
        """Return the time-out of what is steered by; what is no compass is judged by compass A's."""
        return self.compass_s[source if source in COMPASSES else 0]


class HeadingEstimatorState(msgspec.Struct, frozen=True):
    """Heading and yaw rate of the tick, the wave filter, the heading sources and the declination of the place.

    `stretch` is the stretch of track under way, where the receiver states no velocity; `deaf` the wave filter without
    what the compass in use repeats, None while it changes.
    """

    heading: HeadingState = HeadingState()
    wave_filter: WaveFilterState = WaveFilterState()
    sources: SourceState = sources.START
    declination: Declination = Declination()
    stretch: Stretch | None = None
    deaf: WaveFilterState | None = None

    @classmethod
    def at_start(cls, parameters: ParameterSet) -> HeadingEstimatorState:
        """Return the state before the first heading."""
        return expecting(cls(), (0.0, 0.0, parameters["CRUISE_SPEED"]))


def expecting(state: HeadingEstimatorState, water: tuple[float, float, float]) -> HeadingEstimatorState:
    """Return a state before the first heading that expects this current, north and east, and speed [m/s]."""
    return replace(state, wave_filter=replace(state.wave_filter, expected_water=water))


def update(
    settings: HeadingEstimatorSettings,
    state: HeadingEstimatorState,
    headings: Sequence[HeadingSample],
    positions: Sequence[PositionSample],
    rudder_rad: float,
    timeouts: HeadingTimeouts,
    now_s: float,
) -> tuple[HeadingEstimatorState, tuple[Event, ...]]:
    """Take a tick's samples in; return the state, with the heading that is steered by, and the events."""
    before = state.heading
    observer_settings = settings.observer
    if settings.declination_by_model:
        state = _with_declination(state, positions)
        if state.declination.declination_rad is not None:
            observer_settings = replace(observer_settings, declination_rad=state.declination.declination_rad)
    true_headings = [
        TrueHeadingSample(
            sample.t_s, observer.true_heading_rad(observer_settings, sample), sample.heading_rad, sample.source
        )
        for sample in headings
        if math.isfinite(sample.heading_rad) and math.isfinite(sample.t_s) and sample.source in COMPASSES
    ]
    events: tuple[Event, ...] = ()
    if sources.needs_restart(state.sources, now_s, timeouts.compass_s):
        fresh = WaveFilterState(expected_water=water_of(state.wave_filter))
        state = HeadingEstimatorState(before, fresh, declination=state.declination)
        events = (Event(Severity.WARNING, "Heading estimate is begun anew"),)
    state = _with_samples(settings, state, true_headings, before, now_s)
    source_state = _select_source(settings, state, timeouts, now_s)
    source_events = change_events(state.sources.in_use, source_state.in_use)
    samples = samples_in_use(source_state, true_headings)
    stretch, velocities = over_ground(state.stretch, positions, before.heading_rad)
    waves = wave_filter.update(settings.wave_filter, state.wave_filter, samples, velocities, rudder_rad)
    deaf = state.deaf
    if deaf is not None:
        deaf = wave_filter.update(settings.wave_filter, deaf, (), velocities, rudder_rad)
    if settings.observer_only:
        of_first = [sample for sample in headings if sample.source == Source.COMPASS_A]
        observer_settings = replace(observer_settings, timeout_s=timeouts.compass_s[Source.COMPASS_A])
        heading = observer.update(observer_settings, before, of_first, rudder_rad, now_s)
        return HeadingEstimatorState(heading, waves, source_state, state.declination, stretch, deaf), ()
    if not waves.x:
        state = HeadingEstimatorState(before, waves, source_state, state.declination, stretch, deaf)
        return state, events + source_events
    heading_rad, yaw_rate_rad_s = wave_filter.predict_heading(settings.wave_filter, waves, now_s)
    # Fixes come rarely; whether they still come has been judged by their own timeout. A compass that comes back after
    # them may speak in the next tick only.
    sample_t_s = now_s if source_state.in_use is Source.COURSE else _later(before.sample_t_s, waves.sample_t_s)
    newest = headings[-1] if headings else before
    heading = HeadingState(now_s, heading_rad, yaw_rate_rad_s, sample_t_s, newest.roll_rad, newest.pitch_rad)
    state = HeadingEstimatorState(heading, waves, source_state, state.declination, stretch, deaf)
    return state, events + source_events


def _later(one_s: float | None, other_s: float | None) -> float | None:
    if one_s is None or other_s is None:
        return other_s if one_s is None else one_s
    return max(one_s, other_s)


def _with_declination(state: HeadingEstimatorState, positions: Sequence[PositionSample]) -> HeadingEstimatorState:
    """Return the state with the declination of where the boat is."""
    latest = state.declination
    for sample in positions:
        latitude_rad, longitude_rad = sample.latitude_rad, sample.longitude_rad
        if sample.fix is FixType.NONE or latitude_rad is None or longitude_rad is None:
            continue
        if abs(latitude_rad) <= 0.5 * math.pi and abs(longitude_rad) <= math.pi:
            latest = declination.update(latest, latitude_rad, longitude_rad, sample.utc_s)
    return state if latest is state.declination else replace(state, declination=latest)


def _with_samples(
    settings: HeadingEstimatorSettings,
    state: HeadingEstimatorState,
    samples: Sequence[TrueHeadingSample],
    before: HeadingState,
    now_s: float,
) -> HeadingEstimatorState:
    """Return the state after the samples of the compasses; what a compass that stands still repeated is undone."""
    waves, source_state = state.wave_filter, sources.decay_offsets(state.sources, clamp(now_s - before.t_s, 0.0, 1.0))
    expected_rad = waves.x[kalman.FLOAT] + waves.x[kalman.WAVE] if waves.x else math.nan
    for sample in samples:
        source_state = sources.add_sample(source_state, sample, expected_rad)
    deaf = standstill.deaf_filter(settings.wave_filter, state.deaf, waves, source_state, now_s)
    found = standstill.contradicted(source_state, samples, deaf) if settings.frozen_s > 0.0 else None
    if deaf is not None and found is not None:
        return replace(state, sources=found, wave_filter=deaf, deaf=None)
    if source_state is state.sources and deaf is state.deaf:
        return state
    return replace(state, sources=source_state, deaf=deaf)


def _select_source(
    settings: HeadingEstimatorSettings, state: HeadingEstimatorState, timeouts: HeadingTimeouts, now_s: float
) -> SourceState:
    """Judge the sources by their samples and choose one."""
    waves, source_state = state.wave_filter, state.sources
    course_ok = (
        bool(waves.x)  # not begun, or begun anew, it may know of a fix and of nothing else
        and waves.fix_t_s is not None
        and now_s - waves.fix_t_s <= timeouts.position_s
        and waves.spread(kalman.HEADING) <= WIDEST_COURSE_RAD
        and waves.x[kalman.SPEED] >= settings.course_speed_m_s
    )
    return sources.select(source_state, now_s, settings.frozen_s, timeouts.compass_s, course_ok)


def samples_in_use(state: SourceState, samples: Sequence[TrueHeadingSample]) -> list[Heading]:
    """Return time and heading of the samples of the source in use, with its offset."""
    offset_rad = sources.compass_in_use(state).offset_rad
    return [Heading(sample.t_s, sample.heading_rad + offset_rad) for sample in samples if sample.source == state.in_use]


def change_events(before: Source, after: Source) -> tuple[Event, ...]:
    """Return the event of a change of source."""
    if after is before:
        return ()
    if after is Source.NONE:
        return (Event(Severity.ERROR, f"Heading lost: {NAMES[before]} fails"),)
    if before is Source.NONE:
        return (Event(Severity.INFO, f"Heading from {NAMES[after]}"),)
    severity = Severity.WARNING if after > before else Severity.NOTICE
    return (Event(severity, f"Heading from {NAMES[after]}, not {NAMES[before]}"),)


def over_ground(
    stretch: Stretch | None, positions: Sequence[PositionSample], heading_rad: float
) -> tuple[Stretch | None, list[Velocity]]:
    """Return the velocities over the ground that the fixes of a tick state, or come to from stretch to stretch."""
    stated = []
    if stretch is not None:
        stretch = stretch.with_heading(heading_rad)
    for sample in positions:
        speed_m_s, course_rad = sample.speed_over_ground_m_s, sample.course_over_ground_rad
        if sample.fix is FixType.NONE:
            continue
        if speed_m_s is None:
            stretch, mean = track_average.take_fix(stretch, sample)
            if mean is not None:
                stated.append(Velocity(mean.t_s, mean.speed_m_s, mean.course_rad, (mean.cosine, mean.sine)))
        elif course_rad is not None:
            stretch = None
            stated.append(Velocity(sample.t_s, speed_m_s, course_rad))
        elif speed_m_s < SLOWEST_COURSE_M_S:
            stretch = None
            stated.append(Velocity(sample.t_s, speed_m_s, 0.0))
    return stretch, stated


def heading_estimate(settings: HeadingEstimatorSettings, state: HeadingEstimatorState) -> HeadingEstimate | None:
    """Return what the filter gives to steer by; None where it does not steer, or has not begun."""
    heading, waves = state.heading, state.wave_filter
    if settings.observer_only or not waves.x:
        return None
    x = waves.x
    # By place, which a NamedTuple takes in half the time of keywords.
    return HeadingEstimate(
        heading.heading_rad,
        max(2.0 * waves.covariance(kalman.HEADING, kalman.RATE), 0.0),
        heading.yaw_rate_rad_s,
        x[kalman.BIAS],
        x[kalman.BIAS_MEAN],
        x[kalman.SPEED],
        waves.spread(kalman.SPEED),
        x[kalman.FACTOR],
    )


def shown_heading(settings: HeadingEstimatorSettings, state: HeadingEstimatorState) -> tuple[float, float]:
    """Return the heading and yaw rate that an operator is shown: those of the body that the compass rides on.

    It is what the compass shows without the waves and what one sees of the boat. The glider, which is steered by,
    is ahead of it in a turn; on a steady course both are the same.
    """
    heading, waves = state.heading, state.wave_filter
    if settings.observer_only or not waves.x:
        return heading.heading_rad, heading.yaw_rate_rad_s
    rate_rad_s = waves.x[kalman.FLOAT_RATE]
    since_s = clamp(heading.t_s - waves.t_s, 0.0, LONGEST_CARRIED_S)
    return wrap_two_pi(waves.x[kalman.FLOAT] + since_s * rate_rad_s), rate_rad_s


def report(settings: HeadingEstimatorSettings, state: HeadingEstimatorState) -> Estimate | None:
    """Return what the filter estimates, for the log and the link; None where it does not steer, or has not begun."""
    heading, waves = state.heading, state.wave_filter
    if settings.observer_only or not waves.x:
        return None
    x, model = waves.x, waves.noise_model
    return Estimate(
        int(state.sources.in_use),
        heading.heading_rad,
        waves.spread(kalman.HEADING),
        heading.yaw_rate_rad_s,
        waves.spread(kalman.RATE),
        x[kalman.BIAS],
        waves.spread(kalman.BIAS),
        wave_period_s=2.0 * math.pi / model.omega_rad_s,
        wave_sd_rad=model.wave_spread_rad,
        compass_noise_rad=math.exp(0.5 * model.log_noise),
        speed_m_s=x[kalman.SPEED],
        speed_sd_m_s=waves.spread(kalman.SPEED),
        current_north_m_s=x[kalman.NORTH],
        current_east_m_s=x[kalman.EAST],
        turning_factor=x[kalman.FACTOR],
        innovation_rad=waves.innovation_rad,
        innovation_sd_rad=waves.innovation_sd_rad,
        innovation_square=model.average_square,
    )
