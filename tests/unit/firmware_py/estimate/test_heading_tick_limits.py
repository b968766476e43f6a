"""Limits of a tick of the heading estimate: constant compass, course, jumps, learning."""

import math

import pytest

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate import heading_filter, heading_model, heading_tick, sources, water
from firmware_py.estimate.heading_filter import PRIOR
from firmware_py.estimate.heading_tick import HeadingSettings, Smoothed
from firmware_py.estimate.observer import ObserverSettings
from firmware_py.estimate.prediction_check import PredictionCheck
from firmware_py.estimate.sources import (
    CompassState,
    CompassTurns,
    HeadingPlateau,
    Source,
    SourceState,
    TrueHeadingSample,
)
from firmware_py.model.kt import OCEAN_RAMBLER

NAN, DEGREE = math.nan, math.radians(1.0)
SETTINGS = HeadingSettings.of(ParameterSet())
# Wave yaw of 5 deg with a period of 6 s; compass noise of 0.1 deg.
LEVELS = PRIOR._replace(wave_sd=math.log(5.0 * DEGREE), wave_period=math.log(6.0), compass_noise=math.log(0.1 * DEGREE))
MOTION = heading_model.begin(1.0, LEVELS)._replace(
    p00=(1.0 * DEGREE) ** 2, p03=(0.5 * DEGREE) ** 2, p33=(2.0 * DEGREE) ** 2
)
# A compass in use that has measured since 0 s, at 100 s.
COMPASS = CompassState(
    100.0,
    1.0,
    100.0,
    100.0,
    0.0,
    0.0,
    0.0,
    1.0,
    False,
    0.0,
    True,
    1.0,
    HeadingPlateau(),
    CompassTurns(0.1 * DEGREE, 0.0),
)


def tick_of(compass=COMPASS, in_use=Source.COMPASS_A, motion=MOTION, **changes):
    """Return the state at 100 s of an estimate that has begun at 0 s."""
    f = heading_filter.begin(0.0, 1.0)._replace(t_s=100.0, motion=motion, levels=LEVELS)
    s = heading_tick.START._replace(filter=f, wave_yaw_rad2=(8.0 * DEGREE) ** 2)
    return s._replace(sources=SourceState((compass, CompassState()), in_use))._replace(**changes)


def constant(seconds, **changes):
    return COMPASS._replace(changed_s=100.0 - seconds)._replace(**changes)


@pytest.mark.parametrize(
    ("compass", "wave_yaw_deg", "is_contradicted"),
    [
        (constant(6.1), 8.0, True),
        (constant(5.9), 8.0, False),
        (constant(6.1), 3.0, True),
        (constant(6.1), 2.9, False),
        (constant(6.25, sound_since_s=33.75), 8.0, True),  # 60 s of waves before
        (constant(6.25, sound_since_s=33.8), 8.0, False),
        # 20 resolution steps of 0.5 deg are two periods of waves of 5 deg, and two and a half of 4 deg.
        (constant(12.1, turns=CompassTurns(0.5 * DEGREE)), 8.0, True),
        (constant(11.9, turns=CompassTurns(0.5 * DEGREE)), 8.0, False),
        (constant(15.1, turns=CompassTurns(0.5 * DEGREE)), 4.0, True),
        (constant(14.9, turns=CompassTurns(0.5 * DEGREE)), 4.0, False),
    ],
)
def test_constant_reading_over_a_period_of_waves_of_3_deg_is_a_contradiction(compass, wave_yaw_deg, is_contradicted):
    s = tick_of(compass, wave_yaw_rad2=(wave_yaw_deg * DEGREE) ** 2)
    assert heading_tick.is_contradicted(s, compass, MOTION, 1.0) is is_contradicted


@pytest.mark.parametrize(
    ("ratio", "swings", "sds"),
    [
        (1.0, 0.0, 4.0),
        (2.0, 2.9, 4.0 / math.sqrt(2.0)),
        (4.0, 0.0, 2.5),
        (1.0, 3.0, 3.0),
        (2.0, 3.0, 3.0 / math.sqrt(2.0)),
        (9.0, 3.0, 1.5),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("share", "is_contradicted"), [(0.99, False), (1.01, True)])
def test_constant_reading_contradicts_a_motion_that_differs_by_some_standard_deviations(
    ratio, swings, sds, sign, share, is_contradicted
):
    compass = constant(3.0, offset_rad=0.2, turns=CompassTurns(0.1 * DEGREE, 0.0, swings), sound_since_s=90.0)
    variances = {"p00": (3.0 * DEGREE) ** 2, "p03": (1.5 * DEGREE) ** 2, "p33": (6.0 * DEGREE) ** 2}
    sd_rad = DEGREE * math.sqrt(9.0 + 4.5 + 36.0 + 0.01)  # of the compass heading
    motion = MOTION._replace(heading_rad=1.3 + sign * share * sds * sd_rad, wave_rad=-0.1, **variances)
    assert heading_tick.is_contradicted(tick_of(compass), compass, motion, ratio) is is_contradicted


@pytest.mark.parametrize(
    ("difference_deg", "resolution_deg", "is_contradicted"),
    [(4.9, 0.1, False), (5.1, 0.1, True), (9.9, 4.0, False), (10.1, 4.0, True)],
)
def test_difference_of_5_deg_or_of_2_5_resolution_steps_contradicts(difference_deg, resolution_deg, is_contradicted):
    compass, exact = (
        constant(3.0, turns=CompassTurns(resolution_deg * DEGREE)),
        MOTION._replace(p00=0.0, p03=0.0, p33=0.0),
    )
    motion = exact._replace(heading_rad=1.0 + difference_deg * DEGREE)
    assert heading_tick.is_contradicted(tick_of(compass), compass, motion, 1.0) is is_contradicted


def standstill(compass, *, frozen_s=30.0, **changes):
    return heading_tick.with_standstill(
        tick_of(compass, **changes), SETTINGS._replace(frozen_s=frozen_s), OCEAN_RAMBLER, 100.5
    )


def test_state_without_the_compass_is_predicted_while_the_reading_is_constant():
    """It begins at the filter, and again beyond a standard deviation of 10 deg."""
    compass = constant(1.0)
    for rudder_rad, angle_rad in ((0.3, 0.3), (NAN, 0.0)):
        first = standstill(compass, rudder_rad=rudder_rad)
        expected = heading_model.predict(MOTION, LEVELS, OCEAN_RAMBLER, angle_rad, 0.5)
        assert (first.uncorrected, first.uncorrected_s) == (expected, 100.5)
    earlier = MOTION._replace(heading_rad=2.0, p00=radians(10.0) * radians(10.0))
    expected = heading_model.predict(earlier, LEVELS, OCEAN_RAMBLER, 0.0, 1.5)
    assert standstill(compass, uncorrected=earlier, uncorrected_s=99.0).uncorrected == expected
    for begun_s, end_s in ((-499.5, 100.5), (-500.0, -500.0)):  # 600 s and more
        assert standstill(compass, uncorrected=earlier, uncorrected_s=begun_s).uncorrected_s == end_s
    uncertain = earlier._replace(p00=(10.1 * DEGREE) ** 2)
    assert (
        standstill(compass, uncorrected=uncertain, uncorrected_s=99.0).uncorrected.heading_rad != expected.heading_rad
    )
    for s in (
        standstill(COMPASS, uncorrected_s=99.0),
        standstill(constant(1.0, t_s=NAN), uncorrected_s=99.0),
        standstill(compass, in_use=Source.COURSE, uncorrected_s=99.0),
        standstill(compass, filter=heading_filter.not_started(), uncorrected_s=99.0),
    ):
        assert math.isnan(s.uncorrected_s)


@pytest.mark.parametrize(
    ("seconds", "frozen_s", "off_deg", "is_used"),
    [
        (2.1, 30.0, 20.0, False),
        (2.1, 0.5, 20.0, False),
        (2.0, 30.0, 20.0, True),
        (2.1, 0.0, 20.0, True),
        (2.1, 30.0, 0.0, True),
    ],
)
def test_contradicted_compass_is_replaced_by_the_state_without_it(seconds, frozen_s, off_deg, is_used):
    compass = constant(seconds, sound_since_s=90.0)
    s = standstill(
        compass, frozen_s=frozen_s, uncorrected=MOTION._replace(heading_rad=1.0 + off_deg * DEGREE), uncorrected_s=100.0
    )
    assert s.sources.compasses[0].contradicted is not is_used
    if is_used:
        assert s.filter.motion == MOTION
    else:
        assert s.filter.motion == s.delay.motion == s.uncorrected
        assert (s.filter.t_s, math.isnan(s.uncorrected_s)) == (100.5, True)
        assert s.filter.motion.heading_rad == pytest.approx(1.0 + off_deg * DEGREE)


def water_of(speed_m_s, fix_t_s=100.0):
    return water.initial_state(0.0, 0.0, speed_m_s)._replace(fix_t_s=fix_t_s)


def select(s, now_s=100.5, speed_m_s=0.5, fix_t_s=100.0):
    return heading_tick.select(s, SETTINGS, OCEAN_RAMBLER, now_s, (2.0, 2.0), water_of(speed_m_s, fix_t_s), 3.0)


COURSE_M_S = SETTINGS.course_speed_m_s


@pytest.mark.parametrize(
    ("options", "heading_sd_deg", "source"),
    [
        ({}, 19.9, Source.COURSE),
        ({}, 20.1, Source.NONE),
        ({"speed_m_s": COURSE_M_S}, 1.0, Source.COURSE),
        ({"speed_m_s": 0.99 * COURSE_M_S}, 1.0, Source.NONE),
        ({"fix_t_s": 97.5}, 1.0, Source.COURSE),
        ({"fix_t_s": 97.4}, 1.0, Source.NONE),
        ({"fix_t_s": NAN}, 1.0, Source.NONE),
    ],
)
def test_course_needs_a_fix_speed_and_a_heading_within_20_deg(options, heading_sd_deg, source):
    motion = MOTION._replace(p00=(heading_sd_deg * DEGREE) ** 2)
    lost = COMPASS._replace(t_s=90.0, changed_s=90.0)
    assert select(tick_of(lost, motion=motion), **options).sources.in_use is source
    unstarted = tick_of(lost, filter=heading_filter.not_started())
    assert select(unstarted, **options).sources.in_use is Source.NONE


@pytest.mark.parametrize(
    ("speed_m_s", "fix_t_s", "begins_again"), [(0.09, 100.0, True), (0.11, 100.0, False), (0.09, 97.4, False)]
)
def test_boat_slower_than_0_1_m_s_may_be_moored(speed_m_s, fix_t_s, begins_again):
    s = tick_of(constant(1.0), uncorrected=MOTION._replace(heading_rad=1.02), uncorrected_s=100.0)
    selected = select(s, speed_m_s=speed_m_s, fix_t_s=fix_t_s)
    assert selected.uncorrected.heading_rad == pytest.approx(1.0 if begins_again else 1.02)


@pytest.mark.parametrize(("step_s", "is_predicted"), [(600.0, True), (601.0, False), (0.0, False)])
@pytest.mark.parametrize(("rudder_rad", "angle_rad"), [(0.3, 0.3), (NAN, 0.0)])
def test_motion_with_the_course_follows_the_rudder(step_s, is_predicted, rudder_rad, angle_rad):
    s = tick_of(CompassState(), Source.COURSE, rudder_rad=rudder_rad)
    selected = select(s, now_s=100.0 + step_s, fix_t_s=100.0 + step_s)
    expected = heading_model.predict(MOTION, LEVELS, OCEAN_RAMBLER, angle_rad, step_s) if is_predicted else MOTION
    assert selected.filter.motion == expected
    assert selected.filter.t_s == (100.0 + step_s if is_predicted else 100.0)
    expected_check = PredictionCheck(expected, 100.0 + step_s, expected.heading_rad) if is_predicted else s.check
    assert repr(selected.check) == repr(expected_check)


def course(s, off_deg, sd_deg, frozen_s=30.0):
    settings = SETTINGS._replace(frozen_s=frozen_s)
    return heading_tick.take_course(s, settings, 101.0, 1.0 + off_deg * DEGREE, sd_deg * DEGREE)


@pytest.mark.parametrize(
    ("seconds", "off_deg", "sd_deg", "frozen_s", "is_contradicted"),
    [
        (30.1, 30.1, 1.0, 30.0, True),
        (30.1, -30.1, 1.0, 30.0, True),
        (30.1, 29.9, 1.0, 30.0, False),
        (30.1, 40.1, 10.0, 30.0, True),
        (30.1, 39.9, 10.0, 30.0, False),
        (29.9, 50.0, 1.0, 30.0, False),
        (30.1, 50.0, 1.0, 0.0, False),
        (30.1, 50.0, NAN, 30.0, True),
        (30.1, NAN, 1.0, 30.0, False),
    ],
)
def test_track_contradicts_a_reading_constant_for_30_s_from_30_deg_or_4_sds_on(
    seconds, off_deg, sd_deg, frozen_s, is_contradicted
):
    compass = constant(seconds, heading_rad=0.9, offset_rad=0.1)
    s = course(tick_of(compass), off_deg, sd_deg, frozen_s)
    assert s.sources.compasses[0].contradicted is is_contradicted
    if is_contradicted:
        assert s.filter.motion == heading_model.begin(1.0 + off_deg * DEGREE, LEVELS)
        assert s.filter.t_s == 101.0


@pytest.mark.parametrize(("sd_rad", "is_used"), [(1.0, True), (1.01, False), (NAN, False)])
def test_course_with_a_standard_deviation_above_1_rad_is_not_used(sd_rad, is_used):
    s = tick_of(COMPASS, Source.COURSE)
    expected = heading_model.correct_course(MOTION, 1.1, sd_rad) if is_used else MOTION
    assert heading_tick.take_course(s, SETTINGS, 101.0, 1.1, sd_rad).filter.motion == expected


@pytest.mark.parametrize(
    ("off_deg", "wave_sd_deg", "age_s", "is_near"),
    [
        (23.9, 6.0, 100.0, True),
        (24.1, 6.0, 100.0, False),
        (19.9, 2.0, 100.0, True),
        (20.1, 2.0, 100.0, False),
        (170.0, 6.0, 15.0, True),  # before the filter has chosen its levels, any heading is near
        (170.0, 6.0, 15.1, False),
    ],
)
def test_jump_gate_is_20_deg_or_4_standard_deviations_of_the_waves(off_deg, wave_sd_deg, age_s, is_near):
    motion = MOTION._replace(wave_rad=0.1, p33=(wave_sd_deg * DEGREE) ** 2)
    s = tick_of(COMPASS._replace(t_s=99.0, near_s=99.0), motion=motion)
    s = s._replace(filter=s.filter._replace(begun_s=100.0 - age_s))
    heading_rad = 1.1 + off_deg * DEGREE
    added = heading_tick.add_sample(s, OCEAN_RAMBLER, TrueHeadingSample(100.0, heading_rad, heading_rad, 0))
    assert (added.sources.compasses[0].near_s == 100.0) is is_near


@pytest.mark.parametrize(("step_s", "is_predicted"), [(5.0, True), (600.0, True), (601.0, False), (-1.0, False)])
@pytest.mark.parametrize(("rudder_rad", "angle_rad"), [(0.3, 0.3), (NAN, 0.0)])
def test_heading_is_compared_with_the_motion_predicted_to_its_time(step_s, is_predicted, rudder_rad, angle_rad):
    motion = MOTION
    if is_predicted:
        motion = heading_model.predict(MOTION, LEVELS, OCEAN_RAMBLER, angle_rad, step_s)
    compass = COMPASS._replace(t_s=NAN, difference_rad=0.3)
    sample = TrueHeadingSample(100.0 + step_s, motion.heading_rad + motion.wave_rad + 0.01, 0.5, 0)
    s = heading_tick.add_sample(tick_of(compass, rudder_rad=rudder_rad), OCEAN_RAMBLER, sample)
    expected = sources.update_compass(compass, sample, sample.heading_rad - 0.01)
    assert s.sources.compasses[0].steady_rad == pytest.approx(expected.steady_rad)


@pytest.mark.parametrize(
    ("age_s", "step_s", "gain"),
    [(0.5, 0.5, 0.5), (100.0, 0.5, 0.005), (299.0, 0.5, 0.5 / 299.0), (900.0, 0.5, 0.5 / 300.0), (2.0, 3.0, 1.0)],
)
def test_mean_bias_is_that_of_the_whole_time_and_later_of_5_min(age_s, step_s, gain):
    s = tick_of(motion=MOTION._replace(bias_rad=0.2), bias_mean_rad=0.1)
    s = s._replace(filter=s.filter._replace(begun_s=100.0 + step_s - age_s))
    after = heading_tick.take_heading(s, SETTINGS, OCEAN_RAMBLER, 100.0 + step_s, 1.0, 2.0)
    assert after.bias_mean_rad == pytest.approx(0.1 + gain * (after.filter.motion.bias_rad - 0.1))
    assert after.filter.motion.bias_rad != 0.1


@pytest.mark.parametrize(("changed_s", "gain"), [(100.0, 0.025), (99.0, 0.0)])
def test_wave_yaw_is_the_mean_of_20_s_in_which_the_reading_has_changed(changed_s, gain):
    s = tick_of(COMPASS._replace(changed_s=changed_s))
    after = heading_tick.take_heading(s, SETTINGS, OCEAN_RAMBLER, 100.5, 1.2, 2.0)
    before, square = (8.0 * DEGREE) ** 2, after.filter.motion.wave_rad**2
    assert after.wave_yaw_rad2 == pytest.approx(before + gain * (square - before))
    long_after = heading_tick.take_heading(tick_of(), SETTINGS, OCEAN_RAMBLER, 130.0, 1.2, 2.0)
    assert long_after.wave_yaw_rad2 == pytest.approx(long_after.filter.motion.wave_rad**2)


@pytest.mark.parametrize(("age_s", "is_checked"), [(599.5, False), (600.0, True)])
def test_predictions_are_checked_after_10_min_of_learning(age_s, is_checked):
    check = PredictionCheck(MOTION, 80.0, 1.0, 2.0, 15.0, is_rejected=False)
    s = tick_of(check=check)
    s = s._replace(filter=s.filter._replace(begun_s=100.5 - age_s))
    after = heading_tick.take_heading(s, SETTINGS, OCEAN_RAMBLER, 100.5, 1.0, 2.0)
    assert (after.check.begun_s, after.check.mean_square) == (80.0 if is_checked else 100.5, 2.0)
    assert after.check.motion.heading_rad == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("age_s", "learned"),
    [
        (60.0, (False, False)),
        (60.1, (True, False)),
        (600.0, (True, False)),
        (600.1, (True, True)),
        (NAN, (False, False)),
    ],
)
def test_disturbance_is_learned_after_a_minute_and_the_bias_after_ten(age_s, learned):
    s = tick_of(bias_mean_rad=0.2)
    s = s._replace(filter=s.filter._replace(begun_s=100.0 - age_s))
    expected = (DEGREE**2 if learned[0] else 0.0, 0.2 if learned[1] else 0.0)
    assert heading_tick.learned_disturbance(s) == pytest.approx(expected)


@pytest.mark.parametrize(("now_s", "step_s"), [(103.0, 3.0), (99.0, 0.0), (900.0, 600.0)])
@pytest.mark.parametrize(("rudder_rad", "angle_rad"), [(0.3, 0.3), (NAN, 0.0)])
def test_heading_at_a_time_is_extrapolated_for_at_most_10_min(now_s, step_s, rudder_rad, angle_rad):
    motion = MOTION._replace(heading_rad=-1.0, yaw_rate_rad_s=0.02)
    s = tick_of(motion=motion, rudder_rad=rudder_rad, smoothed=Smoothed(100.0, 2.0, 0.01))
    heading_rad, rate_rad_s = heading_model.extrapolate(motion, OCEAN_RAMBLER, angle_rad, step_s)
    expected = (heading_rad % (2.0 * math.pi), rate_rad_s)
    assert heading_tick.heading_at(s, OCEAN_RAMBLER, now_s) == pytest.approx(expected)
    rejected = s._replace(check=PredictionCheck(is_rejected=True))
    # The observer has the linear model without a bias.
    decay, steady = math.exp(-step_s / 4.0), 0.049 * angle_rad
    turned_rad = steady * step_s + (0.01 - steady) * 4.0 * (1.0 - decay)
    expected = ((2.0 + turned_rad) % (2.0 * math.pi), steady + (0.01 - steady) * decay)
    assert heading_tick.heading_at(rejected, OCEAN_RAMBLER, now_s) == pytest.approx(expected)


def test_input_of_the_law_has_twice_the_covariance_of_heading_and_yaw_rate():
    s = tick_of(motion=MOTION._replace(bias_rad=0.1, p01=0.003), bias_mean_rad=0.2)
    state = water.initial_state(0.0, 0.0, 0.7)
    expected = (1.5, 0.006, 0.01, 0.1, 0.2, 0.7, math.hypot(0.3, 0.03))
    assert heading_tick.estimate_of(s, 1.5, 0.01, state) == pytest.approx(expected)
    s = tick_of(motion=MOTION._replace(p01=-0.003))
    assert heading_tick.estimate_of(s, 1.5, 0.01, state).correction_rad2_s == 0.0


def test_yaw_rate_of_the_observer_is_limited_to_ten_times_that_of_full_rudder():
    expected = 10.0 * 0.049 * math.radians(30.0) + math.radians(5.0)
    assert SETTINGS.yaw_rate_limit_rad_s == pytest.approx(expected)
    assert ObserverSettings.of(ParameterSet()).yaw_rate_limit_rad_s == SETTINGS.yaw_rate_limit_rad_s


def test_restart_keeps_only_the_observer_and_the_rudder():
    plateau = HeadingPlateau(2.0, 90.0, turned=True)
    s = tick_of(COMPASS._replace(plateau=plateau), Source.NONE, smoothed=Smoothed(99.0, 2.0, 0.01), rudder_rad=0.2)
    s = s._replace(bias_mean_rad=0.1, uncorrected_s=99.0, check=PredictionCheck(comparisons=3.0))
    restarted = heading_tick.begin_tick(s, 100.0, 0.1, (2.0, 2.0))
    assert repr(restarted) == repr(
        heading_tick.START._replace(filter=heading_filter.not_started(), smoothed=s.smoothed, rudder_rad=0.2)
    )
    kept = heading_tick.begin_tick(s, 103.0, 0.1, (2.0, 2.0))
    assert kept.filter is s.filter


@pytest.mark.parametrize(("step_s", "after_deg"), [(0.5, 2.75), (1.0, 2.5), (5.0, 2.5), (-1.0, 3.0)])
def test_offset_decays_for_at_most_a_second_a_tick(step_s, after_deg):
    s = tick_of(COMPASS._replace(offset_rad=3.0 * DEGREE))
    after = heading_tick.begin_tick(s, 100.0, step_s, (2.0, 2.0))
    assert after.sources.compasses[0].offset_rad == pytest.approx(after_deg * DEGREE)
