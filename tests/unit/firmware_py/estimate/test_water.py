"""Speed, current and leeway in a tick, from positions and the heading; the filter has test_water_filter.py."""

import math
import random

import pytest

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate import water, water_filter
from firmware_py.model.crab import heading_for_course
from firmware_py.model.kt import OCEAN_RAMBLER

STEP_S = 2.0


class Passage:
    """A boat on a sequence of headings, with a position every 2 s with white noise."""

    def __init__(self, speed_m_s, north_m_s, east_m_s, seed=1, leeway_deg=0.0, fix_s=STEP_S, longitude_rad=2.0):
        self.speed_m_s, self.current, self.leeway_rad = speed_m_s, (north_m_s, east_m_s), math.radians(leeway_deg)
        self.rng, self.fix_s, self.longitude_rad = random.Random(seed), fix_s, longitude_rad
        self.t_s = self.north_m = self.east_m = self.off_m_s = self.jump_m = 0.0
        self.state = water.START
        self.courses = []  # time, error and standard deviation of the headings from the track

    def sail(self, heading_deg, seconds, *, known=True):
        heading_rad, keep = math.radians(heading_deg), math.exp(-STEP_S / 30.0)
        for _ in range(round(seconds / STEP_S)):
            self.off_m_s = keep * self.off_m_s + math.sqrt(1.0 - keep * keep) * self.rng.gauss(0.0, 0.05)
            speed_m_s, way_rad = max(self.speed_m_s + self.off_m_s, 0.0), heading_rad + self.leeway_rad
            self.north_m += STEP_S * (speed_m_s * math.cos(way_rad) + self.current[0])
            self.east_m += STEP_S * (speed_m_s * math.sin(way_rad) + self.current[1])
            self.t_s += STEP_S
            self.state = water.take_heading(self.state, heading_rad, known, STEP_S)
            if self.t_s % self.fix_s == 0.0:
                self.fix(heading_rad)
            self.state = water.update(self.state, self.t_s)
        return water.estimated(self.state, self.t_s)

    def fix(self, heading_rad):
        north_m, east_m = (part + self.jump_m + self.rng.gauss(0.0, 0.3) for part in (self.north_m, self.east_m))
        latitude_rad = 0.6 + north_m / EARTH_RADIUS_M
        longitude_rad = wrap_pi(self.longitude_rad + east_m / (EARTH_RADIUS_M * math.cos(0.6)))
        self.state, course_rad, sd_rad = water.take_position(self.state, self.t_s, latitude_rad, longitude_rad)
        if not math.isnan(course_rad):
            self.courses.append((self.t_s, wrap_pi(course_rad - heading_rad), sd_rad))

    def square(self, leg_s=300.0):
        for heading_deg in (0.0, 90.0, 200.0, 310.0):
            estimate = self.sail(heading_deg, leg_s)
        return estimate

    def errors(self, estimate):
        return (
            estimate.current_north_m_s - self.current[0],
            estimate.current_east_m_s - self.current[1],
            estimate.mean_speed_m_s - self.speed_m_s,
        )


@pytest.mark.parametrize(("speed", "current"), [(0.2, (0.1, -0.25)), (0.4, (-0.5, 0.3)), (0.9, (0.0, 0.0))])
def test_after_a_few_legs_speed_and_current_are_known(speed, current):
    passage = Passage(speed, *current)
    assert passage.errors(passage.square()) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)
    north_m_s, east_m_s, speed_m_s, leeway_rad = water.guidance_values(passage.state)
    assert (north_m_s, east_m_s, speed_m_s) == pytest.approx((*current, speed), abs=0.06)
    assert abs(leeway_rad) < 0.3


def test_leeway_is_separated_from_a_current_across_by_turns():
    passage = Passage(0.7, 0.1, -0.2, leeway_deg=8.0)
    passage.square()
    assert math.degrees(water.guidance_values(passage.state)[3]) == pytest.approx(8.0, abs=3.0)
    way_rad = math.radians(45.0 + 8.0)
    expected = (0.1 + 0.7 * math.cos(way_rad), -0.2 + 0.7 * math.sin(way_rad))
    assert water.over_ground_m_s(passage.state, math.radians(45.0)) == pytest.approx(expected, abs=0.06)


def test_a_short_jump_changes_nothing_and_a_lasting_change_of_the_current_is_followed():
    passage = Passage(0.5, 0.0, 0.0)
    before = passage.square()
    passage.jump_m = 60.0
    after = passage.sail(310.0, 20.0)
    passage.jump_m = 0.0
    assert after.mean_speed_m_s == pytest.approx(before.mean_speed_m_s, abs=0.03)
    passage.current = (-0.4, 0.3)
    for _ in range(3):
        estimate = passage.square(400.0)
    assert passage.errors(estimate) == pytest.approx((0.0, 0.0, 0.0), abs=0.08)


@pytest.mark.parametrize("drift", [0.0, 0.7, 0.9])
def test_a_weaker_current_is_never_reported(drift):
    passage, verdicts = Passage(0.5, 0.5 * drift, 0.0), []
    for heading_deg in (0.0, 180.0, 90.0, 180.0):
        for _ in range(8):
            passage.sail(heading_deg, 50.0)
            verdicts.append(passage.state.verdict.too_strong)
    assert max(verdicts) == 0.0


def test_a_moved_origin_over_the_date_line_does_not_change_the_estimate():
    passage, moves = Passage(2.0, 0.1, -0.1, fix_s=10.0, longitude_rad=math.pi - 2000.0 / EARTH_RADIUS_M), 0
    for leg in range(20):
        before = passage.state.origin
        passage.sail((60.0, 100.0)[leg % 2], 400.0)
        north_m, east_m = passage.state.filter.means[0, water_filter.NORTH :]
        assert math.hypot(north_m, east_m) < math.sqrt(2.0) * water.MAX_ORIGIN_DISTANCE_M + 100.0
        assert math.isnan(passage.state.filter.refused_t_s)
        moves += leg > 0 and passage.state.origin != before
    assert moves >= 2
    estimate = water.estimated(passage.state, passage.t_s)
    assert abs(passage.errors(estimate)[2]) < 3.0 * estimate.mean_speed_sd_m_s < 0.3


def test_the_track_gives_a_heading_within_its_standard_deviation_where_the_water_is_known():
    passage = Passage(0.6, 0.1, -0.2)
    passage.square()
    passage.sail(310.0, 30.0)
    passage.courses.clear()
    for heading_deg in (310.0, 30.0, 120.0):
        passage.courses.clear()
        passage.sail(heading_deg, 200.0, known=False)
        errors, sds = [error for _, error, _ in passage.courses], [sd for _, _, sd in passage.courses]
        assert len(errors) >= 15
        assert sum((error / sd) ** 2 for error, sd in zip(errors, sds, strict=True)) / len(errors) < 3.0
        assert max(sds) < 0.5


def test_the_heading_from_the_track_is_that_at_the_end_of_a_turn():
    passage = Passage(0.6, 0.1, -0.2)
    passage.square()
    passage.courses.clear()
    for number in range(300):
        passage.sail(310.0 + 3.0 * number, STEP_S, known=False)
    errors = [error for _, error, _ in passage.courses]
    assert len(errors) > 40
    assert abs(sum(errors) / len(errors)) < math.radians(3.0)  # the mean heading of a stretch is 7.5 degrees behind


def test_the_track_gives_no_heading_after_a_gap_nor_at_the_first_position():
    passage = Passage(0.6, 0.0, 0.0)
    passage.sail(0.0, STEP_S)
    assert passage.courses == []
    passage.square()
    passage.courses.clear()
    passage.fix_s = math.inf
    passage.sail(0.0, 60.0)
    passage.fix_s = STEP_S
    passage.sail(0.0, 5.0)
    assert passage.courses == []


def test_the_slow_values_start_at_the_estimate_and_stay_within_its_standard_deviation():
    passage = Passage(0.4, 0.0, 0.33)
    passage.sail(300.0, STEP_S)
    now = water.estimated(passage.state, passage.t_s)
    assert water.guidance_values(passage.state)[:3] == (now.current_north_m_s, now.current_east_m_s, now.mean_speed_m_s)
    for heading_deg in (300.0, 200.0, 240.0):
        for _ in range(40):
            now = passage.sail(heading_deg, 5.0)
            slow, sds = passage.state.slow, (now.covariance[0], now.covariance[4], now.covariance[7])
            values = (now.current_north_m_s, now.current_east_m_s, now.mean_speed_m_s)
            for one, value, variance in zip(slow, values, sds, strict=True):
                assert abs(one - value) <= math.sqrt(variance) + 1e-12 or one == water_filter.MIN_SPEED_M_S


def test_the_heading_of_a_course_across_a_strong_current_does_not_move_with_each_position():
    passage = Passage(0.4, 0.0, 0.33)
    passage.square(200.0)
    moved_rad, before = [0.0, 0.0], None
    for _ in range(300):
        now = passage.sail(240.0, STEP_S)
        north_m_s, east_m_s, speed_m_s, _ = water.guidance_values(passage.state)
        slow_rad = heading_for_course(math.pi, speed_m_s, north_m_s, east_m_s)
        own_rad = heading_for_course(math.pi, now.mean_speed_m_s, now.current_north_m_s, now.current_east_m_s)
        if before is not None:
            moved_rad[0] += abs(wrap_pi(slow_rad - before[0]))
            moved_rad[1] += abs(wrap_pi(own_rad - before[1]))
        before = slow_rad, own_rad
    assert moved_rad[0] < 0.7 * moved_rad[1]


def test_a_calm_is_used_for_guidance_as_soon_as_it_is_estimated():
    passage = Passage(0.4, 0.0, 0.1)
    passage.square(200.0)
    passage.speed_m_s = 0.02
    for heading_deg in (200.0, 20.0, 200.0):
        now = passage.sail(heading_deg, 300.0)
    speed_m_s = water.guidance_values(passage.state)[2]
    assert abs(speed_m_s - now.mean_speed_m_s) <= now.mean_speed_sd_m_s
    assert speed_m_s < 0.2


def test_before_the_first_position_the_expected_values_apply():
    state = water.initial_state(0.1, -0.2, 0.6)
    assert water.guidance_values(state) == (0.1, -0.2, 0.6, 0.0)
    assert water.over_ground_m_s(state, math.nan) == (0.1, -0.2)
    assert water.over_ground_m_s(state, 0.0) == pytest.approx((0.7, -0.2))
    assert water.speed_sd(state) == pytest.approx(math.hypot(water.FIRST_SPEED_SD_M_S, water.EDDY_SD_M_S))
    assert water.update(state, 5.0) == state
    assert water.take_heading(state, 1.0, True, 0.1) is state
    now = water.estimated(state, 1000.0)
    assert (now.current_north_m_s, now.current_east_m_s, now.mean_speed_m_s) == (0.1, -0.2, 0.6)


def test_the_model_follows_the_speed_within_bounds():
    at_half = water.model_at_speed(OCEAN_RAMBLER, water.initial_state(0.0, 0.0, 0.5 * OCEAN_RAMBLER.speed_m_s))
    assert at_half.turning_ability_1_s == pytest.approx(0.5 * OCEAN_RAMBLER.turning_ability_1_s)
    assert at_half.turning_lag_s == pytest.approx(2.0 * OCEAN_RAMBLER.turning_lag_s)
    for speed_m_s, ratio in ((0.0, 0.1), (1e3, 10.0)):
        model = water.model_at_speed(OCEAN_RAMBLER, water.initial_state(0.0, 0.0, speed_m_s))
        assert model.turning_ability_1_s == pytest.approx(ratio * OCEAN_RAMBLER.turning_ability_1_s)


def test_the_model_keeps_the_expected_speed_until_the_estimate_is_certain():
    """In swell the estimated speed fell to 0 before the first turn, K and T with it: the heading was 20 deg off."""
    state = water.initial_state(0.0, 0.0, 0.5)
    filter_ = water_filter.begin(0.0, 0.0, 0.0, 0.05, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    unsure = water.update(state._replace(fix_t_s=0.0, filter=filter_), 1.0)
    assert water.model_speed(unsure) > 0.45
    sure = water_filter.begin(0.0, 0.0, 0.0, 0.05, 0.005, 0.0, 0.0, 0.3, 0.0, 0.1)
    assert water.model_speed(water.update(state._replace(fix_t_s=0.0, filter=sure), 1.0)) == pytest.approx(
        0.05, abs=0.01
    )
