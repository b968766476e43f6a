"""Filter of the compass swing on a simulated boat on straight legs without waves."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import TWO_PI, degrees, radians
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.estimate import deviation_filter
from firmware_py.estimate.deviation import deviation_rad
from firmware_py.estimate.deviation_filter import DeviationInput, DeviationSettings, DeviationState

NO_CORRECTION = DeviationSettings(0.0, (0.0,) * 5)
DEVIATION = tuple(radians(coefficient) for coefficient in (1.0, 4.0, -3.0, 1.5, 0.5))


def sail(
    courses_rad, leg_s=1200.0, current=(0.1, -0.05), declination_rad=0.0, settings=NO_CORRECTION, seed=1, velocity=True
):
    """Sail the courses by a compass with the deviation DEVIATION; return the state."""
    rng, state, t_s, north_m, east_m = random.Random(seed), DeviationState(), 0.0, 0.0, 0.0
    for compass_rad in courses_rad:
        for _ in range(round(leg_s / 2.0)):
            t_s += 2.0
            sample_rad = compass_rad + radians(rng.gauss(0.0, 1.0))
            # The compass heading is the magnetic heading minus the deviation.
            course_rad = compass_rad + deviation_rad(DEVIATION, compass_rad) + declination_rad + settings.offset_rad
            north, east = current[0] + 0.6 * math.cos(course_rad), current[1] + 0.6 * math.sin(course_rad)
            north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
            velocity_or_none = (math.hypot(north, east), math.atan2(east, north) % TWO_PI) if velocity else (None, None)
            place = (north_m / 6371000.0, east_m / 6371000.0)
            fix = PositionSample(t_s, FixType.FIX_3D, *place, 0.0, *velocity_or_none)
            sample = HeadingSample(t_s, sample_rad % TWO_PI, NorthReference.MAGNETIC)
            inputs = DeviationInput((sample,), declination_rad, fix, compass_rad, (0.0, 0.0, 0.5))
            state = deviation_filter.update(settings, state, inputs, t_s)
    return state


def random_courses(legs, seed=2):
    rng = random.Random(seed)
    return [rng.uniform(0.0, TWO_PI) for _ in range(legs)]


def estimate(courses_rad, **options):
    return deviation_filter.result(NO_CORRECTION, sail(courses_rad, **options))


def errors_rad(result):
    return np.subtract(result.coefficients_rad, DEVIATION)


@pytest.mark.parametrize("options", [{"declination_rad": 0.2}, {"velocity": False}])
def test_deviation_is_estimated_in_a_current(options):
    result = estimate(random_courses(40), **options)
    assert result.ready
    assert np.degrees(np.abs(errors_rad(result))).max() < 0.5
    max_rad = max(abs(deviation_rad(DEVIATION, radians(heading))) for heading in range(360))
    assert degrees(result.off_rad) == pytest.approx(degrees(max_rad), abs=0.6)


def test_coefficients_are_uncertain_after_a_single_course():
    result = estimate([0.5], leg_s=36000.0)
    assert not result.ready
    assert degrees(result.sd_rad) > 5.0


def test_errors_match_their_standard_deviations():
    results = [estimate(random_courses(24, seed), seed=seed, leg_s=600.0) for seed in range(8)]
    normalised = np.array([errors_rad(result) / result.sds_rad for result in results])
    assert 0.1 < np.sqrt(np.mean(normalised**2)) < 1.6


def update_all(ticks):
    """Return the state after ticks of 1 s with these compass headings, speeds, courses and smoothed headings."""
    state = DeviationState()
    for t_s, (compass_rad, speed_m_s, course_rad, heading_rad) in enumerate(ticks):
        sample = HeadingSample(float(t_s), compass_rad, NorthReference.TRUE)
        fix = PositionSample(float(t_s), FixType.FIX_3D, 0.0, 0.0, 0.0, speed_m_s, course_rad)
        inputs = DeviationInput((sample,), 0.0, fix, heading_rad, (0.0, 0.0, 0.5))
        state = deviation_filter.update(NO_CORRECTION, state, inputs, float(t_s))
    return state


def test_a_turn_gives_no_observation():
    headings_rad = [math.radians(tick) for tick in range(1800)]
    state = update_all((angle % TWO_PI, 0.5, angle % TWO_PI, angle) for angle in headings_rad)
    assert sum(state.sectors) == 0
    assert deviation_filter.result(NO_CORRECTION, state) is None


@pytest.mark.parametrize(("speed", "course"), [(math.nan, 0.0), (1e9, 0.0), (0.5, math.nan), (-1.0, 0.0)])
def test_impossible_velocities_are_ignored(speed, course):
    state = update_all((math.nan if tick % 2 else 1.0, speed, course, 1.0) for tick in range(200))
    assert deviation_filter.result(NO_CORRECTION, state) is None


def test_angle_of_a_gyroscope_is_no_heading():
    fix = PositionSample(1.0, FixType.FIX_3D, 0.0, 0.0, 0.0, 0.5, 0.5)
    for reference, is_used in ((NorthReference.MAGNETIC, True), (NorthReference.RELATIVE, False)):
        inputs = DeviationInput((HeadingSample(1.0, 0.5, reference),), 0.0, fix, 0.5, (0.0, 0.0, 0.5))
        state = deviation_filter.update(NO_CORRECTION, DeviationState(), inputs, 1.0)
        assert (state.minute is not None) is is_used


def test_a_changed_mounting_angle_restarts_the_filter():
    state, inputs = sail([0.5]), DeviationInput((), 0.0, None, 0.5, (0.0, 0.0, 0.5))
    assert deviation_filter.update(NO_CORRECTION, state, inputs, 1e5).x
    assert not deviation_filter.update(DeviationSettings(0.1, (0.0,) * 5), state, inputs, 1e5).x


@pytest.mark.parametrize(
    ("sectors_sailed", "sd_deg", "is_ready"), [(8, 0.74, True), (7, 0.74, False), (8, 0.76, False), (12, 0.1, True)]
)
def test_proposal_needs_8_sectors_and_three_quarters_of_a_degree(sectors_sailed, sd_deg, is_ready):
    variance = radians(sd_deg) ** 2 / 3.0  # 1 + sin^2 + cos^2 + sin^2 + cos^2 = 3
    state = DeviationState(
        x=(*DEVIATION, 0.0, 0.0, 0.5),
        p=(variance * np.eye(8)).tobytes(),
        sectors=(1,) * sectors_sailed + (0,) * (12 - sectors_sailed),
    )
    estimate = deviation_filter.result(NO_CORRECTION, state)
    assert estimate.ready is is_ready
    assert estimate.sd_rad == pytest.approx(radians(sd_deg))
    assert estimate.off_rad == pytest.approx(max(abs(deviation_rad(DEVIATION, TWO_PI * n / 36)) for n in range(36)))
