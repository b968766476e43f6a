"""The filter of the swing alone: a boat on straight legs without waves, one minute after the other."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import TWO_PI, degrees, radians
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.estimate import swing
from firmware_py.estimate.deviation import deviation_rad
from firmware_py.estimate.swing import SwingInput, SwingSettings, SwingState

PLAIN = SwingSettings(0.0, (0.0,) * 5)
TRUE = tuple(radians(one) for one in (1.0, 4.0, -3.0, 1.5, 0.5))


def sail(courses_rad, leg_s=1200.0, current=(0.1, -0.05), declination_rad=0.0, settings=PLAIN, seed=1, velocity=True):
    """Sail the courses by a compass with the deviation TRUE; return the state."""
    noise, state, t_s, north_m, east_m = random.Random(seed), SwingState(), 0.0, 0.0, 0.0
    for compass_rad in courses_rad:
        for _ in range(round(leg_s / 2.0)):
            t_s += 2.0
            shown_rad = compass_rad + radians(noise.gauss(0.0, 1.0))
            # What the compass shows is where she heads but for the deviation, and the noise is its own.
            way_rad = compass_rad + deviation_rad(TRUE, compass_rad) + declination_rad + settings.offset_rad
            north, east = current[0] + 0.6 * math.cos(way_rad), current[1] + 0.6 * math.sin(way_rad)
            north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
            told = (math.hypot(north, east), math.atan2(east, north) % TWO_PI) if velocity else (None, None)
            place = (north_m / 6371000.0, east_m / 6371000.0)
            fix = PositionSample(t_s, FixType.FIX_3D, *place, 0.0, *told)
            sample = HeadingSample(t_s, shown_rad % TWO_PI, NorthReference.MAGNETIC)
            given = SwingInput((sample,), declination_rad, fix, compass_rad, (0.0, 0.0, 0.5))
            state = swing.update(settings, state, given, t_s)
    return state


def round_about(legs, seed=2):
    courses = random.Random(seed)
    return [courses.uniform(0.0, TWO_PI) for _ in range(legs)]


def errors_deg(found):
    return np.degrees(np.subtract(found.coefficients_rad, TRUE))


@pytest.mark.parametrize("how", [{"declination_rad": 0.2}, {"velocity": False}])
def test_the_deviation_is_found_beside_a_current(how):
    found = swing.result(PLAIN, sail(round_about(40), **how))
    assert found.ready
    assert np.abs(errors_deg(found)).max() < 0.5
    most_rad = max(abs(deviation_rad(TRUE, radians(each))) for each in range(360))
    assert degrees(found.off_rad) == pytest.approx(degrees(most_rad), abs=0.6)


def test_one_course_tells_no_coefficient_and_says_so():
    found = swing.result(PLAIN, sail([0.5], leg_s=36000.0))
    assert not found.ready
    assert degrees(found.sd_rad) > 5.0


def test_errors_are_as_large_as_they_say():
    found = [swing.result(PLAIN, sail(round_about(24, seed), seed=seed, leg_s=600.0)) for seed in range(8)]
    normalised = np.array([np.radians(errors_deg(one)) / one.sds_rad for one in found])
    assert 0.1 < np.sqrt(np.mean(normalised**2)) < 1.6


def test_a_turn_is_no_observation():
    state = SwingState()
    for tick in range(1800):
        heading_rad = math.radians(1.0) * tick
        sample = HeadingSample(1.0 * tick, heading_rad % TWO_PI, NorthReference.TRUE)
        fix = PositionSample(1.0 * tick, FixType.FIX_3D, 0.0, 0.0, 0.0, 0.5, heading_rad % TWO_PI)
        state = swing.update(PLAIN, state, SwingInput((sample,), 0.0, fix, heading_rad, (0.0, 0.0, 0.5)), 1.0 * tick)
    assert sum(state.sectors) == 0
    assert swing.result(PLAIN, state) is None


def test_a_compass_that_is_mounted_anew_begins_anew():
    state = sail([0.5])
    given = SwingInput((), 0.0, None, 0.5, (0.0, 0.0, 0.5))
    assert swing.update(PLAIN, state, given, 1e5).x
    assert not swing.update(SwingSettings(0.1, (0.0,) * 5), state, given, 1e5).x


@pytest.mark.parametrize(("speed", "course"), [(math.nan, 0.0), (1e9, 0.0), (0.5, math.nan), (-1.0, 0.0)])
def test_what_no_receiver_can_mean_changes_nothing(speed, course):
    state = SwingState()
    for tick in range(200):
        sample = HeadingSample(1.0 * tick, math.nan if tick % 2 else 1.0, NorthReference.TRUE)
        fix = PositionSample(1.0 * tick, FixType.FIX_3D, 0.0, 0.0, 0.0, speed, course)
        state = swing.update(PLAIN, state, SwingInput((sample,), 0.0, fix, 1.0, (0.0, 0.0, 0.5)), 1.0 * tick)
    assert swing.result(PLAIN, state) is None
