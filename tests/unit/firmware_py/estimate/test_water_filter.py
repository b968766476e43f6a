"""Water filter and its results: turns, gaps, outliers, restarts, extreme inputs, compiled code."""

import copy
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.estimate.water_filter import WaterFilter, begin, correct, take_heading, water_at, with_moved_origin
from firmware_py.estimate.water_results import (
    CurrentVerdict,
    advance_dead_reckoning,
    begin_dead_reckoning,
    dead_reckoning_sd,
    heading_from_track,
    judge_current,
    over_ground,
)
from hil.lab.compiled import compiled
from hil.lab.numeric_core import water_filter, water_results

NORTH = 5
REJECTION_TIME_S = 30.0
DECISION_TIME_S = 120.0

SQUARE = tuple(math.radians(angle) for angle in (0.0, 90.0, 180.0, 270.0))
NO_VERDICT = CurrentVerdict(math.nan, 0.0, 0.0)


def initial_filter(speed_m_s: float = 0.4) -> WaterFilter:
    return begin(
        0.0,
        0.0,
        0.0,
        speed_m_s,
        speed_sd_m_s=0.3,
        current_north_m_s=0.0,
        current_east_m_s=0.0,
        current_sd_m_s=0.3,
        sideways_m_s=0.0,
        sideways_sd_m_s=0.1,
    )


class Boat:
    """A boat in a current, and a filter with its headings and noisy positions as input."""

    def __init__(self, speed_m_s, current_m_s, leeway_rad=0.0, seed=1, speed_sd_m_s=0.05):
        self.state = initial_filter()
        self.speed_m_s, self.current_m_s, self.leeway_rad = speed_m_s, current_m_s, leeway_rad
        self.rng, self.speed_sd_m_s = np.random.default_rng(seed), speed_sd_m_s
        self.t_s, self.deviation_m_s, self.since_s, self.position_m = 0.0, 0.0, 0.0, [0.0, 0.0]
        self.verdict, self.too_strong_s = NO_VERDICT, math.nan

    def sail(self, heading_rad, duration_s, step_s=5.0, fix_s=5.0, jump_m=0.0):
        decay = math.exp(-step_s / 30.0)
        for _ in range(round(duration_s / step_s)):
            kick = self.speed_sd_m_s * math.sqrt(1.0 - decay * decay)
            self.deviation_m_s = decay * self.deviation_m_s + kick * float(self.rng.standard_normal())
            course_rad, speed_m_s = heading_rad + self.leeway_rad, self.speed_m_s + self.deviation_m_s
            self.position_m[0] += step_s * (speed_m_s * math.cos(course_rad) + self.current_m_s[0])
            self.position_m[1] += step_s * (speed_m_s * math.sin(course_rad) + self.current_m_s[1])
            self.t_s, self.since_s = self.t_s + step_s, self.since_s + step_s
            self.state = take_heading(self.state, heading_rad, step_s)
            if self.since_s >= fix_s - 1e-9:
                self.since_s = 0.0
                measured_m = [m + jump_m + 0.3 * float(self.rng.standard_normal()) for m in self.position_m]
                self.state = correct(self.state, self.t_s, *measured_m)
            self.verdict = judge_current(self.verdict, self.state, self.water, self.t_s)
            if self.verdict.too_strong and math.isnan(self.too_strong_s):
                self.too_strong_s = self.t_s
        return self

    def sail_square(self, legs, leg_s=600.0, **options):
        for leg in range(legs):
            self.sail(SQUARE[leg % 4], leg_s, **options)
        return self

    @property
    def water(self):
        return water_at(self.state, self.t_s)

    @property
    def normalised_errors(self):
        """Return the errors of current north and east, mean speed and sideways speed, in standard deviations."""
        w, speed_m_s = self.water, self.speed_m_s
        estimates = (w.current_north_m_s, w.current_east_m_s, w.mean_speed_m_s, w.sideways_m_s)
        true = (*self.current_m_s, speed_m_s * math.cos(self.leeway_rad), speed_m_s * math.sin(self.leeway_rad))
        variances = (w.covariance[place] for place in (0, 4, 7, 9))
        return [(value - exact) / math.sqrt(p) for value, exact, p in zip(estimates, true, variances, strict=True)]


@cache
def after_a_square():
    """Return a boat after a square; do not modify it."""
    return Boat(0.5, (0.15, -0.15)).sail_square(4)


@pytest.fixture
def boat():
    """Return a boat with a converged filter."""
    return copy.deepcopy(after_a_square())


@pytest.mark.parametrize(
    ("speed_m_s", "current_m_s", "leeway_deg"),
    [(0.05, (0.1, -0.05), 0.0), (0.5, (0.15, -0.15), 25.0), (2.5, (-0.3, 0.2), 0.0), (0.5, (0.0, 0.8), -8.0)],
)
def test_turns_separate_speed_current_and_leeway(speed_m_s, current_m_s, leeway_deg):
    boat = Boat(speed_m_s, current_m_s, math.radians(leeway_deg), speed_sd_m_s=0.1 * speed_m_s)
    boat.sail_square(8, step_s=10.0, fix_s=10.0)
    assert max(map(abs, boat.normalised_errors)) < 3.0
    assert boat.water.current_sd_m_s < 0.05
    assert boat.water.mean_speed_sd_m_s < 0.08
    assert abs(boat.water.leeway_rad - math.radians(leeway_deg)) < 3.0 * boat.water.leeway_sd_rad


def test_on_one_heading_only_the_sum_of_speed_and_current_is_observable():
    boat = Boat(0.6, (-0.3, 0.1)).sail(0.0, 3600.0)
    water = boat.water
    north_m_s, east_m_s = over_ground(water, 0.0)
    assert abs(north_m_s - 0.3) < 0.15
    assert abs(east_m_s - 0.1) < 0.05
    nn, _, nu, _, _, _, _, uu, _, _ = water.covariance
    assert math.sqrt(nn + uu + 2.0 * nu) < 0.05
    assert min(math.sqrt(nn), water.mean_speed_sd_m_s) > 0.15
    assert max(map(abs, boat.normalised_errors)) < 3.0


def test_errors_match_their_standard_deviations_over_many_passages():
    boats = [Boat(0.5, (0.2, -0.2), 0.1, seed, 0.1) for seed in range(4)]
    errors = [boat.sail_square(4, step_s=10.0, fix_s=10.0).normalised_errors for boat in boats]
    assert 0.1 < np.mean(np.square(errors)) < 1.5


def test_lasting_jump_restarts_the_position_and_keeps_speed_and_current(boat):
    boat.sail(0.5, REJECTION_TIME_S, jump_m=500.0)
    assert boat.state.means[0, NORTH] < boat.position_m[0] + 100.0
    boat.sail(0.5, 60.0, jump_m=500.0)
    assert abs(boat.state.means[0, NORTH] - boat.position_m[0] - 500.0) < 5.0
    boat.sail(0.5, 600.0, jump_m=500.0)
    assert max(map(abs, boat.normalised_errors)) < 3.0


def test_moved_origin_changes_only_the_position():
    boat = Boat(0.5, (0.15, -0.15)).sail_square(3)
    moved = with_moved_origin(boat.state, 1000.0, -500.0)
    assert water_at(moved, boat.t_s) == boat.water
    expected = correct(take_heading(boat.state, 0.1, 5.0), boat.t_s + 5.0, 700.0, 20.0)
    result = correct(take_heading(moved, 0.1, 5.0), boat.t_s + 5.0, -300.0, 520.0)
    assert flatten(water_at(result, boat.t_s)) == pytest.approx(flatten(water_at(expected, boat.t_s)), abs=1e-9)


def test_current_is_too_strong_only_if_it_exceeds_the_speed():
    assert math.isnan(Boat(0.5, (0.2, -0.2), speed_sd_m_s=0.2).sail_square(8, 900.0, step_s=2.5).too_strong_s)
    boat = Boat(0.5, (0.7, 0.4), speed_sd_m_s=0.1).sail_square(4, 900.0, step_s=2.5)
    assert 900.0 < boat.too_strong_s < 900.0 + 3.0 * DECISION_TIME_S  # not observable before the first turn
    boat.speed_m_s, boat.current_m_s = 1.5, (0.2, 0.0)
    boat.sail_square(4, 900.0, step_s=2.5)
    assert boat.verdict.too_strong == 0.0


def test_errors_of_dead_reckoning_match_their_standard_deviation():
    errors = []
    for seed in range(5):
        boat = Boat(0.5, (0.15, -0.1), 0.1, seed, 0.1).sail_square(4, step_s=10.0, fix_s=10.0)
        dead_reckoning, start_m = begin_dead_reckoning(boat.state, boat.t_s), list(boat.position_m)
        north_m = east_m = 0.0
        for heading_rad in (0.0, 1.0, 2.5):
            boat.sail(heading_rad, 600.0, fix_s=1e9)
            for _ in range(60):
                dead_reckoning, north_m_s, east_m_s = advance_dead_reckoning(dead_reckoning, heading_rad, 10.0)
                north_m, east_m = north_m + 10.0 * north_m_s, east_m + 10.0 * east_m_s
        sd_m = dead_reckoning_sd(dead_reckoning, 1800.0)
        assert 5.0 < sd_m < 250.0
        errors += [(start_m[i] + (north_m, east_m)[i] - boat.position_m[i]) / sd_m for i in (0, 1)]
    assert np.mean(np.square(errors)) < 1.5


ANY = st.floats(allow_nan=True, allow_infinity=True)
SENSIBLE = st.floats(-1e4, 1e4)
STEPS = st.lists(
    st.tuples(
        st.one_of(st.floats(-10.0, 10.0), ANY),
        st.one_of(st.floats(0.0, 20.0), ANY),
        st.one_of(SENSIBLE, ANY),
        st.one_of(SENSIBLE, ANY),
    ),
    max_size=40,
)


def flatten(value):
    is_sequence = isinstance(value, (tuple, np.ndarray))
    return [number for item in value for number in flatten(item)] if is_sequence else [value]


@settings(max_examples=25)
@given(STEPS)
def test_state_stays_finite_with_any_input(steps):
    state, t_s, verdict = initial_filter(), 0.0, NO_VERDICT
    for heading_rad, step_s, north_m, east_m in steps:
        t_s += step_s if 0.0 < step_s < 1e6 else 0.0
        state = take_heading(state, heading_rad, step_s)
        state = correct(state, t_s if math.isfinite(step_s) else step_s, north_m, east_m)
        water = water_at(state, t_s)
        verdict = judge_current(verdict, state, water, t_s)
        dead_reckoning, _, _ = advance_dead_reckoning(begin_dead_reckoning(state, t_s), heading_rad, 10.0)
        assert all(map(math.isfinite, flatten((state.means, state.covariances, state.levels, state.information))))
        assert all(map(math.isfinite, flatten(water)))
        assert math.isfinite(dead_reckoning_sd(dead_reckoning, 10.0))
        heading_from_track(state, t_s, north_m, east_m, step_s)


@compiled
def follow(heading_rad, north_m, east_m, out):
    """Compute the filter and its results for a recording with a sample each second."""
    # As in `initial_filter`.
    state = water_filter.begin(0.0, north_m[0], east_m[0], 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    verdict = water_results.CurrentVerdict(math.nan, 0.0, 0.0, math.nan, math.nan, 0.0)
    for number in range(1, heading_rad.size):
        t_s = float(number)
        state = water_filter.take_heading(state, heading_rad[number - 1], 1.0)
        state = water_filter.correct(state, t_s, north_m[number], east_m[number])
        if number % 500 == 0:
            state = water_filter.with_moved_origin(state, 0.5, -0.25)
        water = water_filter.water_at(state, t_s)
        verdict = water_results.judge_current(verdict, state, water, t_s)
        north_m_s, east_m_s = water_results.over_ground(water, heading_rad[number])
        dead_reckoning, _, dead_reckoning_m_s = water_results.advance_dead_reckoning(
            water_results.begin_dead_reckoning(state, t_s), heading_rad[number], 100.0
        )
        found_rad, sd_rad = water_results.heading_from_track(state, t_s, 10.0 * north_m_s, 10.0 * east_m_s, 10.0)
        row = out[number]
        row[0], row[1], row[2], row[3] = water.speed_m_s, water.current_sd_m_s, water.leeway_rad, water.leeway_sd_rad
        row[4], row[5], row[6], row[7] = verdict.against_s, verdict.too_strong, north_m_s, east_m_s
        row[8], row[9], row[10] = water_results.dead_reckoning_sd(dead_reckoning, 100.0), found_rad, sd_rad
        row[11], row[12], row[13] = dead_reckoning_m_s, state.levels[0], state.levels[1]
        row[14], row[15] = state.levels[2], state.levels[3]


@pytest.mark.proof  # the suite compares the water filter in the closed loop (tests/process/test_twin.py)
def test_interpreted_and_compiled_results_are_equal_to_the_last_bit():
    rng, seconds = np.random.default_rng(3), 4000
    heading_rad = np.repeat(rng.uniform(-4.0, 4.0, seconds // 200 + 1), 200)[:seconds]
    heading_rad += 0.1 * rng.standard_normal(seconds)
    north_m = np.cumsum(0.5 * np.cos(heading_rad) + 0.4) + rng.standard_normal(seconds)
    east_m = np.cumsum(0.5 * np.sin(heading_rad) - 0.4) + rng.standard_normal(seconds)
    heading_rad[1000:1100], north_m[1500:2000], north_m[2500:], east_m[::97] = math.nan, math.nan, 900.0, 1e4
    compiled_rows, plain_rows = np.zeros((seconds, 16)), np.zeros((seconds, 16))
    follow(heading_rad, north_m, east_m, compiled_rows)
    follow.py_func(*(Column(column) for column in (heading_rad, north_m, east_m)), plain_rows)
    assert np.array_equal(compiled_rows, plain_rows, equal_nan=True)
    assert np.isfinite(compiled_rows).any()


class Column:
    """A column of numbers, each a float of Python."""

    def __init__(self, numbers):
        self.numbers, self.size = numbers.tolist(), numbers.size

    def __getitem__(self, number):
        return self.numbers[number]
