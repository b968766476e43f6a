"""Heading estimation in a tick: sources, filter, frozen compass, prediction check and fallback. Numeric core.

A tick calls, in this order: `begin_tick`, `add_sample` for each heading of either compass, `select`, `take_heading`
for each heading of the source in use (or `take_course` where there is no compass), and `end_tick`. The autopilot
(heading_estimator.py) and the compiled loop of the laboratory call the same functions.

A compass whose reading (the heading as the device sent it) is constant while the boat turns has stopped measuring.
While the reading of the compass in use is constant, a second state is predicted without it. The compass is rejected,
and the filter continues from the second state, if the reading has been constant

* for longer than usual and differs too much from that state, or
* for a whole period of waves that turn the boat, or
* for CMP_FROZEN_S while the track has turned.

A coarse compass may have a constant reading for a long time on a straight course in calm water, or at the dock, where
the rudder has no effect. It is not rejected there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.estimate import (
    delay_test,
    fixed_gain,
    heading_filter,
    heading_model,
    prediction_check,
    sources,
    water,
    water_results,
)
from firmware_py.estimate.delay_test import DelayTest
from firmware_py.estimate.heading_filter import HeadingFilter
from firmware_py.estimate.heading_model import Motion
from firmware_py.estimate.prediction_check import PredictionCheck
from firmware_py.estimate.sources import SourceState, TrueHeadingSample
from firmware_py.estimate.water import WaterState
from firmware_py.model.heading_estimate import HeadingEstimate
from firmware_py.model.kt import KtModel, decay_over

if TYPE_CHECKING:
    from firmware_py.common.parameters import ParameterSet

JUMP_GATE_SDS: Final = 4.0  # gate of a jump, in standard deviations of the predicted wave yaw
MAX_COURSE_SD_RAD: Final = radians(20.0)  # of a heading that is used without a compass
MIN_CONTRADICTION_RAD: Final = radians(5.0)
# Limits of the difference in standard deviations: they decrease with the time of the constant reading, and are smaller
# for a compass that has shown the wave yaw.
CONTRADICTION_SDS, MIN_CONTRADICTION_SDS = 4.0, 2.5
OSCILLATING_SDS, MIN_OSCILLATING_SDS = 3.0, 1.5
MAX_UNCORRECTED_SD_RAD: Final = radians(10.0)  # of the state without the compass; beyond it that state restarts
MIN_WAVE_YAW_RAD: Final = radians(3.0)  # from here on a constant reading over a wave period is a fault
MAX_STANDSTILL_PERIODS: Final = 20.0  # of the waves, for a resolution as large as the wave yaw
WAVE_YAW_MEMORY_S: Final = 20.0
MIN_TRACK_DIFFERENCE_RAD: Final = radians(30.0)  # of compass and track, which wind and current also change
MOORED_SPEED_M_S: Final = 0.1  # over ground; a slower boat may be moored, and its rudder has no effect then
WAVE_LEARNING_S: Final = 60.0  # time in which the wave yaw is learned
BIAS_MEAN_S: Final = 300.0
# Time in which the levels are learned. The predictions are checked after it; a rejected filter learns again.
LEVEL_LEARNING_S: Final = 600.0
MAX_PREDICTION_S: Final = 600.0


class HeadingSettings(NamedTuple):
    """Model of the boat, parameters CMP_FROZEN_S, COG_SPEED_MIN and EST_TAU_S, and yaw rate limit of the observer."""

    model: KtModel
    frozen_s: float
    course_speed_m_s: float
    smoothing_s: float
    yaw_rate_limit_rad_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingSettings:
        """Read the settings from the parameters."""
        model = KtModel.of(parameters)
        limit_rad_s = fixed_gain.yaw_rate_limit(model.turning_ability_1_s, radians(parameters["RUD_LIMIT_DEG"]))
        return cls(model, parameters["CMP_FROZEN_S"], parameters["COG_SPEED_MIN"], parameters["EST_TAU_S"], limit_rad_s)


class Smoothed(NamedTuple):
    """State of the fixed-gain observer; t_s is NaN before the first heading."""

    t_s: float = math.nan
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0


NO_MOTION: Final = Motion()
NO_CHECK: Final = PredictionCheck()
NO_SMOOTHED: Final = Smoothed()
NO_DELAY_TEST: Final = DelayTest()


class HeadingTick(NamedTuple):
    """State of the heading estimate.

    `uncorrected` is the state at `uncorrected_s` that is predicted without the compass in use while its reading is
    constant (NaN: it changes). `bias_mean_rad` is the mean of the rudder bias over BIAS_MEAN_S, `rudder_rad` the angle
    measured at the last tick, `wave_yaw_rad2` the mean square of the wave yaw over WAVE_YAW_MEMORY_S in which the
    reading of the compass in use has changed.
    """

    sources: SourceState = sources.START
    filter: HeadingFilter = HeadingFilter()
    uncorrected: Motion = NO_MOTION
    uncorrected_s: float = math.nan
    check: PredictionCheck = NO_CHECK
    delay: DelayTest = NO_DELAY_TEST
    smoothed: Smoothed = NO_SMOOTHED
    bias_mean_rad: float = 0.0
    rudder_rad: float = 0.0
    wave_yaw_rad2: float = 0.0


START: Final = HeadingTick()


def with_sources(s: HeadingTick, state: SourceState) -> HeadingTick:
    """Return the state with these sources."""
    return HeadingTick(
        state, s.filter, s.uncorrected, s.uncorrected_s, s.check, s.delay, s.smoothed, s.bias_mean_rad, s.rudder_rad,
        s.wave_yaw_rad2,
    )  # fmt: skip


def needs_restart(s: HeadingTick, now_s: float, timeouts_s: tuple[float, float]) -> bool:
    """Return whether the estimate restarts because a compass contradicts it."""
    return sources.needs_restart(s.sources, now_s, timeouts_s)


def begin_tick(s: HeadingTick, now_s: float, step_s: float, timeouts_s: tuple[float, float]) -> HeadingTick:
    """Return the state at the start of a tick, step_s after the previous one; the estimate restarts if necessary."""
    if needs_restart(s, now_s, timeouts_s):
        f = heading_filter.not_started()
        s = HeadingTick(
            sources.START, f, NO_MOTION, math.nan, NO_CHECK, NO_DELAY_TEST, s.smoothed, 0.0, s.rudder_rad, 0.0
        )
    state, delay = sources.decay_offsets(s.sources, clamp(step_s, 0.0, 1.0)), delay_test.begin_tick(s.delay)
    return HeadingTick(
        state, s.filter, s.uncorrected, s.uncorrected_s, s.check, delay, s.smoothed, s.bias_mean_rad, s.rudder_rad,
        s.wave_yaw_rad2,
    )  # fmt: skip


def add_sample(s: HeadingTick, model: KtModel, sample: TrueHeadingSample) -> HeadingTick:
    """Return the state whose sources have checked a heading of either compass; the filter is not updated.

    The heading is compared with the motion predicted to its time, because waves turn the boat by more than
    JUMP_GATE_RAD between two headings of a slow compass. There is no comparison before the filter has first chosen its
    levels, because large waves would look like a jump.
    """
    f, expected_rad, gate_rad = s.filter, math.nan, sources.JUMP_GATE_RAD
    if heading_filter.has_started(f) and sample.t_s - f.begun_s > heading_filter.WINDOW_S:
        m, step_s = f.motion, sample.t_s - f.t_s
        if 0.0 < step_s <= MAX_PREDICTION_S:
            angle_rad = s.rudder_rad if math.isfinite(s.rudder_rad) else 0.0
            m = heading_model.predict(m, f.levels, model, angle_rad, step_s)
        expected_rad, gate_rad = m.heading_rad + m.wave_rad, max(gate_rad, JUMP_GATE_SDS * math.sqrt(m.p33))
    return with_sources(s, sources.add_sample(s.sources, sample, expected_rad, gate_rad))


def select(
    s: HeadingTick,
    settings: HeadingSettings,
    model: KtModel,
    now_s: float,
    timeouts_s: tuple[float, float],
    water_state: WaterState,
    fix_timeout_s: float,
) -> HeadingTick:
    """Return the state with the source chosen. `model` is that of the boat at its present speed."""
    has_fix = now_s - water_state.fix_t_s <= fix_timeout_s
    north_m_s, east_m_s = water.over_ground_m_s(water_state, s.filter.motion.heading_rad)
    if has_fix and math.sqrt(north_m_s * north_m_s + east_m_s * east_m_s) < MOORED_SPEED_M_S:
        s = with_uncorrected(s, s.uncorrected, math.nan)
    s = with_standstill(s, settings, model, now_s)
    is_course_usable = (
        heading_filter.has_started(s.filter)
        and has_fix
        and s.filter.motion.p00 <= MAX_COURSE_SD_RAD * MAX_COURSE_SD_RAD
        and water.guidance_values(water_state)[2] >= settings.course_speed_m_s
    )
    s = with_sources(s, sources.select(s.sources, now_s, settings.frozen_s, timeouts_s, is_course_usable))
    step_s = now_s - s.filter.t_s
    if s.sources.in_use != sources.Source.COURSE or not 0.0 < step_s <= MAX_PREDICTION_S:
        return s
    # Headings from the track are rare: between them the motion follows the rudder, and its variance grows.
    angle_rad = s.rudder_rad if math.isfinite(s.rudder_rad) else 0.0
    return with_motion(s, now_s, heading_model.predict(s.filter.motion, s.filter.levels, model, angle_rad, step_s))


def with_motion(s: HeadingTick, t_s: float, motion: Motion) -> HeadingTick:
    """Return the state with a motion that no compass has updated."""
    f = heading_filter.with_motion(s.filter, t_s, motion)
    check, delay = prediction_check.restart(s.check, motion, t_s), delay_test.with_motion(s.delay, motion)
    return HeadingTick(
        s.sources, f, s.uncorrected, s.uncorrected_s, check, delay, s.smoothed, s.bias_mean_rad, s.rudder_rad,
        s.wave_yaw_rad2,
    )  # fmt: skip


def with_standstill(s: HeadingTick, settings: HeadingSettings, model: KtModel, now_s: float) -> HeadingTick:
    """Return the state in which the compass in use is marked as contradicted if it has stopped measuring."""
    compass, f = sources.compass_in_use(s.sources), s.filter
    if math.isnan(compass.t_s) or compass.t_s == compass.changed_s or not heading_filter.has_started(f):
        return with_uncorrected(s, s.uncorrected, math.nan)
    uncorrected, uncorrected_s = s.uncorrected, s.uncorrected_s
    if math.isnan(uncorrected_s) or uncorrected.p00 > MAX_UNCORRECTED_SD_RAD * MAX_UNCORRECTED_SD_RAD:
        uncorrected, uncorrected_s = f.motion, f.t_s
    step_s, angle_rad = now_s - uncorrected_s, s.rudder_rad if math.isfinite(s.rudder_rad) else 0.0
    if 0.0 < step_s <= MAX_PREDICTION_S:
        uncorrected, uncorrected_s = heading_model.predict(uncorrected, f.levels, model, angle_rad, step_s), now_s
    ratio = sources.standstill_ratio(compass)
    if settings.frozen_s > 0.0 and ratio > 1.0 and is_contradicted(s, compass, uncorrected, ratio):
        return without_compass(s, uncorrected_s, uncorrected)
    return with_uncorrected(s, uncorrected, uncorrected_s)


def with_uncorrected(s: HeadingTick, uncorrected: Motion, uncorrected_s: float) -> HeadingTick:
    """Return the state with this state without the compass, of the time uncorrected_s."""
    return HeadingTick(
        s.sources, s.filter, uncorrected, uncorrected_s, s.check, s.delay, s.smoothed, s.bias_mean_rad, s.rudder_rad,
        s.wave_yaw_rad2,
    )  # fmt: skip


def without_compass(s: HeadingTick, t_s: float, motion: Motion) -> HeadingTick:
    """Return the state with the compass in use marked as contradicted, and the motion predicted without it."""
    f, state = heading_filter.with_motion(s.filter, t_s, motion), sources.mark_contradicted(s.sources)
    return HeadingTick(
        state, f, motion, math.nan, s.check, delay_test.with_motion(s.delay, motion), s.smoothed, s.bias_mean_rad,
        s.rudder_rad, s.wave_yaw_rad2,
    )  # fmt: skip


def is_contradicted(s: HeadingTick, compass: sources.CompassState, uncorrected: Motion, ratio: float) -> bool:
    """Return whether a constant reading contradicts the state; `ratio`: its duration divided by the usual maximum."""
    levels = s.filter.levels
    noise_rad, wave_yaw_rad = math.exp(levels.compass_noise), min(math.exp(levels.wave_sd), math.sqrt(s.wave_yaw_rad2))
    has_learned_waves = compass.changed_s - compass.sound_since_s >= WAVE_LEARNING_S
    if has_learned_waves and wave_yaw_rad >= MIN_WAVE_YAW_RAD:
        periods = max(1.0, MAX_STANDSTILL_PERIODS * compass.turns.resolution_rad / wave_yaw_rad)
        if compass.t_s - compass.changed_s > periods * math.exp(levels.wave_period):
            return True
    difference_rad = wrap_pi(compass.heading_rad + compass.offset_rad - uncorrected.heading_rad - uncorrected.wave_rad)
    sd_rad = math.sqrt(uncorrected.p00 + 2.0 * uncorrected.p03 + uncorrected.p33 + noise_rad * noise_rad)
    sds = max(CONTRADICTION_SDS / math.sqrt(ratio), MIN_CONTRADICTION_SDS)
    if compass.turns.swings >= sources.MIN_SWINGS:
        sds = max(OSCILLATING_SDS / math.sqrt(ratio), MIN_OSCILLATING_SDS)
    return abs(difference_rad) > max(sources.min_contradiction(compass, MIN_CONTRADICTION_RAD), sds * sd_rad)


def take_heading(
    s: HeadingTick, settings: HeadingSettings, model: KtModel, t_s: float, heading_rad: float, timeout_s: float
) -> HeadingTick:
    """Return the state updated with a true heading of the compass in use."""
    heading_rad += sources.compass_in_use(s.sources).offset_rad
    previous = s.filter
    f = heading_filter.update(previous, model, t_s, heading_rad, s.rudder_rad)
    step_s = f.t_s - previous.t_s
    angle_rad = s.rudder_rad if math.isfinite(s.rudder_rad) else 0.0
    delay = delay_test.update(s.delay, previous, f, model, s.rudder_rad, heading_rad)
    check, bias_mean_rad = s.check, s.bias_mean_rad
    if f.begun_s == previous.begun_s:
        if f.t_s - f.begun_s < LEVEL_LEARNING_S:
            check = prediction_check.restart(check, f.motion, f.t_s)
        else:
            check = prediction_check.update(check, f.motion, previous.levels, model, angle_rad, f.t_s, step_s)
            if check.is_rejected:
                f = heading_filter.with_learning_restarted(f)
        gain = max(step_s, 0.0) / clamp(f.t_s - f.begun_s, 1.0, BIAS_MEAN_S)
        bias_mean_rad += min(gain, 1.0) * (f.motion.bias_rad - bias_mean_rad)
    else:
        check = prediction_check.begin(f.motion, f.t_s)
    smoothed = update_smoothed(s.smoothed, settings, t_s, heading_rad, angle_rad, timeout_s)
    wave_yaw_rad2, compass = s.wave_yaw_rad2, sources.compass_in_use(s.sources)
    if compass.t_s == compass.changed_s:
        wave_yaw_rad2 += clamp(step_s / WAVE_YAW_MEMORY_S, 0.0, 1.0) * (
            f.motion.wave_rad * f.motion.wave_rad - wave_yaw_rad2
        )
    return HeadingTick(
        s.sources, f, s.uncorrected, s.uncorrected_s, check, delay, smoothed, bias_mean_rad, s.rudder_rad, wave_yaw_rad2
    )


def update_smoothed(
    o: Smoothed, settings: HeadingSettings, t_s: float, heading_rad: float, rudder_rad: float, timeout_s: float
) -> Smoothed:
    """Return the observer updated with a heading; the first one, and one after a gap, restart it."""
    step_s = t_s - o.t_s
    if not 0.0 <= step_s <= timeout_s:
        return Smoothed(t_s, wrap_two_pi(heading_rad), 0.0)
    model = settings.model
    predicted_rad, rate_rad_s = fixed_gain.predict(
        o.heading_rad, o.yaw_rate_rad_s, rudder_rad, step_s, decay_over(step_s, model.turning_lag_s),
        model.turning_ability_1_s, model.turning_lag_s,
    )  # fmt: skip
    corrected_rad, rate_rad_s = fixed_gain.correct(
        predicted_rad, rate_rad_s, heading_rad, step_s, math.exp(-step_s / settings.smoothing_s),
        settings.yaw_rate_limit_rad_s,
    )  # fmt: skip
    return Smoothed(t_s, corrected_rad, rate_rad_s)


def take_course(
    s: HeadingTick, settings: HeadingSettings, t_s: float, heading_rad: float, sd_rad: float
) -> HeadingTick:
    """Return the state updated with a heading from the track and its standard deviation (NaN: none).

    While a compass is in use, the heading is only compared with it; it can contradict a constant reading.
    """
    if s.sources.in_use != sources.Source.COURSE:
        compass = sources.compass_in_use(s.sources)
        difference_rad = abs(wrap_pi(heading_rad - compass.heading_rad - compass.offset_rad))
        limit_rad = max(sources.min_contradiction(compass, MIN_TRACK_DIFFERENCE_RAD), CONTRADICTION_SDS * sd_rad)
        if sources.has_stood_still(compass, settings.frozen_s) and difference_rad > limit_rad:
            return without_compass(s, t_s, heading_model.begin(heading_rad, s.filter.levels))
        return s
    if not sd_rad <= water_results.MAX_HEADING_SD_RAD:
        return s
    return with_motion(s, s.filter.t_s, heading_model.correct_course(s.filter.motion, heading_rad, sd_rad))


def take_rate(s: HeadingTick, yaw_rate_rad_s: float, sd_rad_s: float) -> HeadingTick:
    """Return the state updated with the yaw rate of a gyroscope at the time of the filter, which has started."""
    noise_variance = sd_rad_s * sd_rad_s
    motion, innovation_rad_s, variance = heading_model.correct_rate(s.filter.motion, yaw_rate_rad_s, noise_variance)
    delay = delay_test.take_rate(s.delay, yaw_rate_rad_s, noise_variance, innovation_rad_s, variance)
    return HeadingTick(
        s.sources, heading_filter.with_rate(s.filter, motion), s.uncorrected, s.uncorrected_s, s.check, delay,
        s.smoothed, s.bias_mean_rad, s.rudder_rad, s.wave_yaw_rad2,
    )  # fmt: skip


def end_tick(s: HeadingTick, rudder_rad: float) -> HeadingTick:
    """Return the state with the rudder angle measured at this tick; NaN: not known."""
    return HeadingTick(
        s.sources, s.filter, s.uncorrected, s.uncorrected_s, s.check, s.delay, s.smoothed, s.bias_mean_rad, rudder_rad,
        s.wave_yaw_rad2,
    )  # fmt: skip


def is_trusted(s: HeadingTick) -> bool:
    """Return whether the filter is used for steering: it has started and its predictions are consistent."""
    return heading_filter.has_started(s.filter) and not s.check.is_rejected


def heading_at(s: HeadingTick, model: KtModel, now_s: float) -> tuple[float, float]:
    """Return heading in [0, 2 pi) and yaw rate at a time; the filter must have started.

    While the check rejects the filter and a compass is in use, they are those of the fixed-gain observer.
    """
    angle_rad = s.rudder_rad if math.isfinite(s.rudder_rad) else 0.0
    if s.check.is_rejected and sources.uses_compass(s.sources):
        step_s = clamp(now_s - s.smoothed.t_s, 0.0, MAX_PREDICTION_S)
        return fixed_gain.predict(
            s.smoothed.heading_rad, s.smoothed.yaw_rate_rad_s, angle_rad, step_s,
            decay_over(step_s, model.turning_lag_s), model.turning_ability_1_s, model.turning_lag_s,
        )  # fmt: skip
    step_s = clamp(now_s - s.filter.t_s, 0.0, MAX_PREDICTION_S)
    heading_rad, yaw_rate_rad_s = heading_model.extrapolate(s.filter.motion, model, angle_rad, step_s)
    return wrap_two_pi(heading_rad), yaw_rate_rad_s


def estimate_of(s: HeadingTick, heading_rad: float, yaw_rate_rad_s: float, water_state: WaterState) -> HeadingEstimate:
    """Return the input of the control law at this heading and yaw rate."""
    m = s.filter.motion
    # Positional arguments take half the time of keyword arguments.
    return HeadingEstimate(
        heading_rad,
        max(2.0 * m.p01, 0.0),
        yaw_rate_rad_s,
        m.bias_rad,
        s.bias_mean_rad,
        water.model_speed(water_state),
        water.speed_sd(water_state),
    )


def learned_disturbance(s: HeadingTick) -> tuple[float, float]:
    """Return the diffusion of the heading [rad^2/s] and the mean rudder bias [rad].

    The diffusion is 0 in the first minute of the filter. The bias is 0 in the first LEVEL_LEARNING_S, because it is
    wrong if the servo is reversed from the start; that is detected within this time.
    """
    f = s.filter
    age_s = f.t_s - f.begun_s
    if not age_s > heading_filter.CANDIDATE_PHASE_S:
        return 0.0, 0.0
    return math.exp(f.levels.diffusion), s.bias_mean_rad if age_s > LEVEL_LEARNING_S else 0.0


def heading_sd(s: HeadingTick) -> float:
    """Return the standard deviation of the heading [rad], with the inflation by the check; 0 before the start."""
    return math.sqrt(s.filter.motion.p00) * prediction_check.sd_inflation(s.check)
