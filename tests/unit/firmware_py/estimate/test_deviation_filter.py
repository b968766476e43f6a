"""The filter of the swing alone: a boat on straight legs without waves, one minute after the other."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import TWO_PI, degrees, radians
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.estimate import deviation_filter
from firmware_py.estimate.deviation import deviation_rad
from firmware_py.estimate.deviation_filter import DeviationInput, DeviationSettings, DeviationState

PLAIN = DeviationSettings(0.0, (0.0,) * 5)
TRUE = tuple(radians(one) for one in (1.0, 4.0, -3.0, 1.5, 0.5))


def sail(courses_rad, leg_s=1200.0, current=(0.1, -0.05), declination_rad=0.0, settings=PLAIN, seed=1, velocity=True):
    """Sail the courses by a compass with the deviation TRUE; return the state."""
    noise, state, t_s, north_m, east_m = random.Random(seed), DeviationState(), 0.0, 0.0, 0.0
    for compass_rad in courses_rad:
        for _ in range(round(leg_s / 2.0)):
            t_s += 2.0
            shown_rad = compass_rad + radians(noise.gauss(0.0, 1.0))
            # The compass heading is the true one less the deviation, with noise of the compass.
            way_rad = compass_rad + deviation_rad(TRUE, compass_rad) + declination_rad + settings.offset_rad
            north, east = current[0] + 0.6 * math.cos(way_rad), current[1] + 0.6 * math.sin(way_rad)
            north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
            velocity_or_none = (math.hypot(north, east), math.atan2(east, north) % TWO_PI) if velocity else (None, None)
            place = (north_m / 6371000.0, east_m / 6371000.0)
            fix = PositionSample(t_s, FixType.FIX_3D, *place, 0.0, *velocity_or_none)
            sample = HeadingSample(t_s, shown_rad % TWO_PI, NorthReference.MAGNETIC)
            given = DeviationInput((sample,), declination_rad, fix, compass_rad, (0.0, 0.0, 0.5))
            state = deviation_filter.update(settings, state, given, t_s)
    return state


def round_about(legs, seed=2):
    courses = random.Random(seed)
    return [courses.uniform(0.0, TWO_PI) for _ in range(legs)]


def errors_deg(found):
    return np.degrees(np.subtract(found.coefficients_rad, TRUE))


@pytest.mark.parametrize("how", [{"declination_rad": 0.2}, {"velocity": False}])
def test_the_deviation_is_estimated_in_a_current(how):
    found = deviation_filter.result(PLAIN, sail(round_about(40), **how))
    assert found.ready
    assert np.abs(errors_deg(found)).max() < 0.5
    most_rad = max(abs(deviation_rad(TRUE, radians(each))) for each in range(360))
    assert degrees(found.off_rad) == pytest.approx(degrees(most_rad), abs=0.6)


def test_one_course_leaves_the_coefficients_uncertain():
    found = deviation_filter.result(PLAIN, sail([0.5], leg_s=36000.0))
    assert not found.ready
    assert degrees(found.sd_rad) > 5.0


def test_errors_match_their_standard_deviations():
    found = [deviation_filter.result(PLAIN, sail(round_about(24, seed), seed=seed, leg_s=600.0)) for seed in range(8)]
    normalised = np.array([np.radians(errors_deg(one)) / one.sds_rad for one in found])
    assert 0.1 < np.sqrt(np.mean(normalised**2)) < 1.6


def test_a_turn_is_no_observation():
    state = DeviationState()
    for tick in range(1800):
        heading_rad = math.radians(1.0) * tick
        sample = HeadingSample(1.0 * tick, heading_rad % TWO_PI, NorthReference.TRUE)
        fix = PositionSample(1.0 * tick, FixType.FIX_3D, 0.0, 0.0, 0.0, 0.5, heading_rad % TWO_PI)
        state = deviation_filter.update(
            PLAIN, state, DeviationInput((sample,), 0.0, fix, heading_rad, (0.0, 0.0, 0.5)), 1.0 * tick
        )
    assert sum(state.sectors) == 0
    assert deviation_filter.result(PLAIN, state) is None


def test_a_changed_mounting_angle_restarts_the_filter():
    state = sail([0.5])
    given = DeviationInput((), 0.0, None, 0.5, (0.0, 0.0, 0.5))
    assert deviation_filter.update(PLAIN, state, given, 1e5).x
    assert not deviation_filter.update(DeviationSettings(0.1, (0.0,) * 5), state, given, 1e5).x


@pytest.mark.parametrize(("speed", "course"), [(math.nan, 0.0), (1e9, 0.0), (0.5, math.nan), (-1.0, 0.0)])
def test_impossible_velocities_change_nothing(speed, course):
    state = DeviationState()
    for tick in range(200):
        sample = HeadingSample(1.0 * tick, math.nan if tick % 2 else 1.0, NorthReference.TRUE)
        fix = PositionSample(1.0 * tick, FixType.FIX_3D, 0.0, 0.0, 0.0, speed, course)
        state = deviation_filter.update(
            PLAIN, state, DeviationInput((sample,), 0.0, fix, 1.0, (0.0, 0.0, 0.5)), 1.0 * tick
        )
    assert deviation_filter.result(PLAIN, state) is None
