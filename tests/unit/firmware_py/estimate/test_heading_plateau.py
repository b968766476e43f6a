"""Restart of the heading estimate because a compass contradicts it."""

import math
import random

import pytest

from firmware_py.common.angles import radians
from firmware_py.estimate.sources import SourceState, TrueHeadingSample, add_sample, needs_restart, select

PLATEAU_TIME_S = 2.0
PROBATION_S = 10.0

EXPECTED_RAD, FROZEN_S, TIMEOUTS_S = 1.0, 30.0, (1.0, 1.0)


def restart_time_s(off_deg, *, has_course=False, has_other=False):
    """Return the time when a compass with the error off_deg(t) restarts the estimate, or None."""
    state, rng = SourceState(), random.Random(5)
    for tick in range(900):
        t_s = 0.1 * tick - 20.0  # the first 20 s have no error
        off_rad = radians(off_deg(t_s)) if t_s > 0.0 else 0.0
        for source, error_rad in ((0, off_rad), *(((1, 0.0),) if has_other else ())):
            heading_rad = (EXPECTED_RAD + error_rad + rng.gauss(0.0, 0.005)) % (2.0 * math.pi)
            state = add_sample(state, TrueHeadingSample(t_s, heading_rad, heading_rad, source), EXPECTED_RAD)
        state = select(state, t_s, FROZEN_S, TIMEOUTS_S, has_course)
        if needs_restart(state, t_s, TIMEOUTS_S):
            return t_s
    return None


def turn_by_a_wave(degrees, seconds):
    return lambda t_s: degrees * min(t_s / seconds, 1.0)


@pytest.mark.parametrize("course", [False, True])
@pytest.mark.parametrize("degrees", [-170.0, -90.0, 45.0, 90.0, 180.0])
def test_compass_that_measures_the_turn_restarts_the_estimate_soon_after_it_settles(degrees, course):
    seconds = abs(degrees) / 60.0
    assert (
        seconds < restart_time_s(turn_by_a_wave(degrees, seconds), has_course=course) < seconds + PLATEAU_TIME_S + 0.3
    )


def test_compass_that_jumped_restarts_the_estimate_after_10_s_without_another_source():
    sudden = turn_by_a_wave(90.0, 1e-9)
    assert restart_time_s(sudden) == pytest.approx(PROBATION_S, abs=0.3)
    assert restart_time_s(sudden, has_course=True) is None
    assert restart_time_s(turn_by_a_wave(90.0, 2.0), has_other=True) is None


@pytest.mark.parametrize("course", [False, True])
@pytest.mark.parametrize(
    "off_deg",
    [
        lambda t_s: 90.0 if t_s % 5.0 < 0.1 else 0.0,
        lambda t_s: 90.0 if t_s % 12.0 < 9.0 else 0.0,
        lambda t_s: turn_by_a_wave(90.0, 1.0)(t_s) - turn_by_a_wave(90.0, 1.0)(max(t_s - 1.5, 0.0)),
        lambda t_s: 60.0 * t_s,
    ],
    ids=["spikes", "jumps to and fro", "turn and turn back", "endless turn"],
)
def test_headings_that_do_not_settle_do_not_restart_the_estimate(off_deg, course):
    assert restart_time_s(off_deg, has_course=course) is None
