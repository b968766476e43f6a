"""Heading estimate of a tick from the records of compasses and receiver: sources, times, report."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample, Severity
from firmware_py.estimate import heading_estimator, heading_tick, water, water_filter
from firmware_py.estimate.declination import declination_rad
from firmware_py.estimate.gyro import GyroState
from firmware_py.estimate.heading_estimator import (
    HeadingEstimatorSettings,
    HeadingEstimatorState,
    HeadingTimeouts,
    change_event,
)
from firmware_py.estimate.prediction_check import PredictionCheck
from firmware_py.estimate.sources import Source

PARAMETERS = ParameterSet()
TIMEOUTS = HeadingTimeouts((1.0, 3.0), 5.0)
UTC_S = 1_767_225_600.0
PLACE = (0.6, 2.1)


def update(state, t_s, *headings, fixes=(), **parameters):
    """Return the state and texts after a tick with headings (source, rad)."""
    values = PARAMETERS
    for name, value in parameters.items():
        values = values.replaced(name, value)
    samples = [
        HeadingSample(t_s, heading_rad, NorthReference.TRUE, source=source, roll_rad=0.1 + source, pitch_rad=0.2)
        for source, heading_rad in headings
    ]
    settings = HeadingEstimatorSettings.of(values)
    state, events = heading_estimator.update(settings, state, samples, fixes, 0.0, TIMEOUTS, t_s)
    return state, [event.text for event in events]


def run(seconds, *headings, state=None, begin_s=0.0, **parameters):
    state = HeadingEstimatorState.at_start(PARAMETERS) if state is None else state
    for number in range(1, round(10 * seconds) + 1):
        state, _ = update(state, begin_s + 0.1 * number, *headings, **parameters)
    return state


@pytest.mark.parametrize(
    ("previous", "current", "severity", "text"),
    [
        (Source.COMPASS_A, Source.NONE, Severity.ERROR, "Heading lost: compass A failed"),
        (Source.NONE, Source.COMPASS_B, Severity.INFO, "Heading source: compass B"),
        (Source.COMPASS_A, Source.COURSE, Severity.WARNING, "Heading source: course over ground (was compass A)"),
        (Source.COURSE, Source.COMPASS_B, Severity.NOTICE, "Heading source: compass B (was course over ground)"),
    ],
)
def test_change_of_the_source_has_an_event(previous, current, severity, text):
    event = change_event(previous, current)
    assert (event.severity, event.text) == (severity, text)


@pytest.mark.parametrize(("source", "timeout_s"), [(0, 1.0), (1, 3.0), (2, 1.0), (3, 1.0)])
def test_each_compass_has_its_time_out(source, timeout_s):
    assert TIMEOUTS.of(Source(source)) == timeout_s


def test_samples_of_unknown_sources_and_without_a_finite_time_are_ignored():
    state = run(1.0, (0, 2.0))
    for samples in ([(2, 3.0)], [(0, math.nan)], [(0, math.inf)]):
        after, texts = update(state, 1.1, *samples)
        assert (after.tick.filter, texts) == (state.tick.filter, [])
        assert after.tick.sources.compasses[0].t_s == state.tick.sources.compasses[0].t_s
    sample = HeadingSample(math.nan, 2.0, NorthReference.TRUE)
    settings = HeadingEstimatorSettings.of(PARAMETERS)
    after, _ = heading_estimator.update(settings, state, [sample], (), 0.0, TIMEOUTS, 1.1)
    assert after.tick.filter == state.tick.filter
    assert after.tick.sources.compasses[0].t_s == state.tick.sources.compasses[0].t_s


def test_only_the_compass_in_use_gives_the_heading_and_the_newest_one_the_attitude():
    state = run(20.0, (1, 2.2), (0, 2.0))
    assert state.heading.heading_rad == pytest.approx(2.0, abs=1e-3)
    assert (state.heading.roll_rad, state.heading.pitch_rad) == (0.1, 0.2)
    after = run(0.1, (0, 2.0), (1, 2.2), state=state, begin_s=20.0)
    assert after.heading.roll_rad == 1.1
    without = run(0.1, state=after, begin_s=20.1)
    assert (without.heading.roll_rad, without.heading.pitch_rad) == (1.1, 0.2)
    assert (without.heading.t_s, without.heading.sample_t_s) == pytest.approx((20.2, 20.1))
    lost = run(4.0, state=without, begin_s=20.2)
    assert lost.tick.sources.in_use == Source.NONE
    assert lost.heading.sample_t_s == pytest.approx(20.1)


def test_observer_uses_compass_a_only_with_its_time_out():
    state = run(2.0, (1, 2.5), (0, 2.0), EST_MODE=0, CMP_TIMEOUT_S=0.5)
    assert state.heading.heading_rad == pytest.approx(2.0, abs=1e-3)
    assert run(2.0, (1, 2.5), EST_MODE=0).heading.sample_t_s is None
    later = run(0.9, state=state, begin_s=2.0, EST_MODE=0, CMP_TIMEOUT_S=0.5)
    assert later.heading.t_s == pytest.approx(2.9)
    assert run(0.3, state=later, begin_s=2.9, EST_MODE=0, CMP_TIMEOUT_S=5.0).heading.t_s == pytest.approx(3.0, abs=0.11)


def fix_at(t_s, **changes):
    return replace(PositionSample(t_s, FixType.FIX_3D, *PLACE, utc_s=UTC_S), **changes)


def test_declination_is_that_of_the_position_with_cmp_decl_auto_only():
    model_rad = declination_rad(*PLACE, UTC_S)
    start = HeadingEstimatorState.at_start(PARAMETERS)
    sample = HeadingSample(1.0, 2.0, NorthReference.MAGNETIC)
    for auto, expected_rad in ((1, model_rad), (0, math.radians(5.0))):
        settings = HeadingEstimatorSettings.of(PARAMETERS.replaced("CMP_DECL_AUTO", auto).replaced("CMP_DECL_DEG", 5))
        state, _ = heading_estimator.update(settings, start, [sample], [fix_at(1.0)], 0.0, TIMEOUTS, 1.0)
        assert state.heading.heading_rad == pytest.approx(2.0 + expected_rad)
        assert (state.declination.declination_rad is None) is (auto == 0)


def test_water_has_the_expected_speed_and_the_headings_between_positions():
    state = run(5.0, (0, 1.0))
    assert water.guidance_values(state.water) == (0.0, 0.0, PARAMETERS["CRUISE_SPEED"], 0.0)
    state, _ = update(state, 5.1, (0, 1.0), fixes=[fix_at(5.1)])
    assert (state.water.fix_t_s, state.water.origin) == (5.1, PLACE)
    state = run(2.0, (0, 1.0), state=state, begin_s=5.1)
    heading_rad = state.heading.heading_rad
    vector = (state.water.filter.known_s, state.water.filter.cosine_s, state.water.filter.sine_s)
    assert vector == pytest.approx((2.1, 2.1 * math.cos(heading_rad), 2.1 * math.sin(heading_rad)), abs=0.01)
    assert state.water.slow_t_s == pytest.approx(7.1)
    lost = run(3.0, state=state, begin_s=7.1)  # the filter uses no heading that no compass has measured
    assert lost.water.filter.known_s < 3.3


def test_restart_is_reported_and_the_source_is_new():
    state = run(20.0, (0, 1.0))
    state = run(1.5, state=state, begin_s=20.0)
    assert state.tick.sources.in_use == Source.NONE
    texts = []
    for number in range(150):
        state, new_texts = update(state, 21.6 + 0.1 * number, (0, 3.0 + 0.001 * (number % 2)))
        texts += new_texts
    # At first a single heading outside the gate is no jump.
    assert texts == [
        "Heading source: compass A",
        "Heading lost: compass A failed",
        "Heading estimate restarted",
        "Heading source: compass A",
    ]


@pytest.mark.parametrize("observer_only", [False, True])
@pytest.mark.parametrize("is_rejected", [False, True])
def test_estimate_is_used_by_the_law_if_the_filter_is_trusted(observer_only, is_rejected):
    settings = replace(HeadingEstimatorSettings.of(PARAMETERS), observer_only=observer_only)
    start = HeadingEstimatorState.at_start(PARAMETERS)
    assert heading_estimator.heading_estimate(settings, start) is None
    assert heading_estimator.report(settings, start) is None
    state = run(2.0, (0, 2.0))
    state = replace(state, tick=state.tick._replace(check=PredictionCheck(mean_square=4.0, is_rejected=is_rejected)))
    estimate, report = heading_estimator.heading_estimate(settings, state), heading_estimator.report(settings, state)
    assert (estimate is None) is (observer_only or is_rejected)
    assert (report is None) is observer_only
    if estimate is not None:
        heading = state.heading
        assert estimate == heading_tick.estimate_of(
            state.tick, heading.heading_rad, heading.yaw_rate_rad_s, state.water
        )
    if report is None:
        return
    m, inflation, expected = state.tick.filter.motion, 2.0 if is_rejected else 1.0, PARAMETERS["CRUISE_SPEED"]
    sds = (report.heading_sd_rad, report.yaw_rate_sd_rad_s, report.bias_sd_rad)
    assert sds == pytest.approx(tuple(inflation * math.sqrt(variance) for variance in (m.p00, m.p11, m.p22)))
    assert (report.heading_rad, report.yaw_rate_rad_s) == (state.heading.heading_rad, state.heading.yaw_rate_rad_s)
    assert (report.source, report.bias_rad, report.wave_yaw_rad) == (0, m.bias_rad, m.wave_rad)
    degree = math.radians(1.0)
    levels = (report.yaw_diffusion_rad2_s, report.wave_sd_rad, report.wave_period_s, report.wave_damping)
    assert levels == pytest.approx((degree**2, degree, 2.8, 0.2))
    assert (report.compass_noise_rad, report.bias_walk_rad_sqrt_s) == pytest.approx((0.1 * degree, 0.3 * degree))
    assert (report.speed_m_s, report.current_north_m_s, report.current_east_m_s) == (expected, 0.0, 0.0)
    assert report.speed_sd_m_s == pytest.approx(math.hypot(0.3, 0.1))
    f = state.tick.filter
    innovation = (report.innovation_rad, report.innovation_sd_rad, report.innovation_square, report.prediction_square)
    assert innovation == (f.innovation_rad, f.innovation_sd_rad, f.innovation_square, 4.0)


@pytest.mark.parametrize(("too_strong", "is_too_strong"), [(1.0, True), (0.0, False)])
def test_water_of_guidance_has_the_slow_values_and_the_uncertainty_with_eddies(too_strong, is_too_strong):
    state = HeadingEstimatorState.at_start(PARAMETERS)
    filter_ = water_filter.begin(
        0.0,
        0.0,
        0.0,
        speed_m_s=0.5,
        speed_sd_m_s=0.2,
        current_north_m_s=0.1,
        current_east_m_s=-0.1,
        current_sd_m_s=0.3,
        sideways_m_s=0.05,
        sideways_sd_m_s=0.1,
    )
    verdict = state.water.verdict._replace(too_strong=too_strong)
    slow = water.Expected(0.15, -0.2, 0.6)
    state = replace(
        state, water=state.water._replace(filter=filter_, verdict=verdict, slow=slow, slow_t_s=0.0, fix_t_s=0.0)
    )
    report = heading_estimator.water_report(state)
    assert (report.current_north_m_s, report.current_east_m_s) == (0.15, -0.2)
    assert (report.speed_m_s, report.too_strong) == (0.6, is_too_strong)
    sds = (report.speed_sd_m_s, report.current_sd_m_s, report.leeway_rad)
    assert sds == pytest.approx((math.hypot(0.2, 0.03), math.hypot(0.3, 0.03), math.atan2(0.05, 0.5)))
    assert report.leeway_sd_rad == water.estimate_at(state.water, 0.0).leeway_sd_rad


@pytest.mark.parametrize(
    ("has_compass", "is_used", "in_use", "takes_rate"),
    [
        (True, True, Source.COMPASS_A, True),
        (True, False, Source.COMPASS_A, False),
        (False, True, Source.COMPASS_A, False),
        (False, True, Source.COURSE, True),
        (False, False, Source.COURSE, False),
    ],
)
def test_rate_is_used_with_a_heading_of_the_compass_or_with_the_course(has_compass, is_used, in_use, takes_rate):
    state = run(20.0, (0, 1.0))
    tick = state.tick._replace(sources=state.tick.sources._replace(in_use=in_use))
    if in_use == Source.COURSE:  # the compass is lost
        tick = tick._replace(sources=tick.sources._replace(compasses=heading_tick.START.sources.compasses))
    state = replace(state, tick=tick, gyro=GyroState(t_s=20.0, rate_t_s=20.0, is_used=is_used))
    fixed = state.water._replace(fix_t_s=20.0)
    state = replace(state, water=fixed)
    rate = HeadingSample(20.05, 1.0, NorthReference.RELATIVE, yaw_rate_rad_s=0.5, source=1)
    compass = [HeadingSample(20.05, 1.0, NorthReference.TRUE)] if has_compass else []
    settings = HeadingEstimatorSettings.of(PARAMETERS)
    rates = [
        heading_estimator.update(settings, state, [*compass, *more], (), 0.0, TIMEOUTS, 20.05)[0].tick.filter.motion[1]
        for more in ((), (rate,))
    ]
    assert (rates[1] > rates[0] + 1e-5) is takes_rate
    assert math.isfinite(rates[1])
