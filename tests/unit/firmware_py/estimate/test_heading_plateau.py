"""A compass that contradicts the estimate: when the estimate restarts with it."""

import math
import random

import pytest

from firmware_py.common.angles import radians
from firmware_py.estimate.sources import (
    MAX_CONTRADICTION_S,
    PLATEAU_TIME_S,
    PROBATION_S,
    SourceState,
    TrueHeadingSample,
    add_sample,
    needs_restart,
    select,
)

EXPECTED, FROZEN_S, TIMEOUTS_S = 1.0, 30.0, (1.0, 1.0)


def restarted_s(off_deg, *, course=False, other=False, interval_s=0.1, lasts_s=70.0):
    """Return when a compass off by off_deg(t) restarts the estimate, None: never; `other`: there is a second."""
    state, rng = SourceState(), random.Random(5)
    for tick in range(round((20.0 + lasts_s) / interval_s)):
        since_s = tick * interval_s - 20.0  # without an error before
        off_rad = radians(off_deg(since_s)) if since_s > 0.0 else 0.0
        for source, off in ((0, off_rad), *(((1, 0.0),) if other else ())):
            heading = (EXPECTED + off + rng.gauss(0.0, 0.005)) % (2.0 * math.pi)
            state = add_sample(state, TrueHeadingSample(since_s, heading, heading, source), EXPECTED)
        state = select(state, since_s, FROZEN_S, TIMEOUTS_S, course)
        if needs_restart(state, since_s, TIMEOUTS_S):
            return since_s
    return None


def turned_by_a_sea(degrees, seconds):
    return lambda t_s: degrees * min(t_s / seconds, 1.0)


@pytest.mark.parametrize("course", [False, True])
@pytest.mark.parametrize("degrees", [-170.0, -90.0, 45.0, 90.0, 180.0])
def test_a_compass_that_shows_the_turn_restarts_the_estimate_soon_after_it_settles(degrees, course):
    seconds = abs(degrees) / 60.0
    assert seconds < restarted_s(turned_by_a_sea(degrees, seconds), course=course) < seconds + PLATEAU_TIME_S + 0.3


def test_a_compass_that_jumped_restarts_the_estimate_after_its_probation_and_only_without_another_source():
    sudden = turned_by_a_sea(90.0, 1e-9)
    assert restarted_s(sudden) == pytest.approx(PROBATION_S, abs=0.3)
    assert restarted_s(sudden, course=True) is None
    assert restarted_s(turned_by_a_sea(90.0, 2.0), other=True) is None


@pytest.mark.parametrize("course", [False, True])
@pytest.mark.parametrize(
    "off_deg",
    [
        lambda t_s: 90.0 if t_s % 5.0 < 0.1 else 0.0,  # a spike now and then
        lambda t_s: 90.0 if t_s % 12.0 < 9.0 else 0.0,  # there and back again
        lambda t_s: (
            turned_by_a_sea(90.0, 1.0)(t_s) - turned_by_a_sea(90.0, 1.0)(max(t_s - 1.5, 0.0))
        ),  # turned there and back
        lambda t_s: 60.0 * t_s,  # it turns without end
    ],
)
def test_headings_that_do_not_settle_do_not_restart_the_estimate(off_deg, course):
    assert restarted_s(off_deg, course=course) is None


def test_without_another_source_a_jumping_compass_restarts_the_estimate_after_a_minute():
    leaps = lambda t_s: 120.0 if round(10.0 * t_s) % 2 else -100.0  # noqa: E731
    assert restarted_s(leaps) == pytest.approx(MAX_CONTRADICTION_S, abs=0.3)
    assert restarted_s(leaps, course=True) is None


def test_a_slow_compass_cannot_show_a_fast_turn():
    """Between two headings of 1 Hz anything may have happened; 15 deg in a second is a boat's own way."""
    assert restarted_s(turned_by_a_sea(90.0, 2.0), course=True, interval_s=1.0) is None
    assert restarted_s(turned_by_a_sea(90.0, 6.0), course=True, interval_s=1.0) == pytest.approx(
        6.0 + PLATEAU_TIME_S, abs=1.1
    )
