"""Speed, current and leeway in a tick, from positions and the heading. The filter itself: test_water_filter.py."""

import math
import random

import pytest

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate import water, water_filter, water_results
from firmware_py.model.crab import heading_for_course
from firmware_py.model.kt import OCEAN_RAMBLER

STEP_S = 2.0


# `water_filter.begin`: time, position [m], speed and its standard deviation, current north and east and its standard
# deviation, sideways speed and its standard deviation [m/s].


class Passage:
    """A boat on a sequence of headings, with a position every 2 s with white noise."""

    def __init__(self, speed_m_s, north_m_s, east_m_s, seed=1, leeway_deg=0.0, fix_s=STEP_S, longitude_rad=2.0):
        self.speed_m_s, self.current, self.leeway_rad = speed_m_s, (north_m_s, east_m_s), math.radians(leeway_deg)
        self.rng, self.fix_s, self.longitude_rad = random.Random(seed), fix_s, longitude_rad
        self.t_s = self.north_m = self.east_m = self.deviation_m_s = 0.0
        self.state = water.START
        self.track_headings = []  # time, error and standard deviation of the headings from the track

    def sail(self, heading_deg, seconds, *, has_compass=True):
        heading_rad, decay = math.radians(heading_deg), math.exp(-STEP_S / 30.0)
        for _ in range(round(seconds / STEP_S)):
            self.deviation_m_s = decay * self.deviation_m_s + math.sqrt(1.0 - decay * decay) * self.rng.gauss(0.0, 0.05)
            speed_m_s, course_rad = max(self.speed_m_s + self.deviation_m_s, 0.0), heading_rad + self.leeway_rad
            self.north_m += STEP_S * (speed_m_s * math.cos(course_rad) + self.current[0])
            self.east_m += STEP_S * (speed_m_s * math.sin(course_rad) + self.current[1])
            self.t_s += STEP_S
            self.state = water.take_heading(self.state, heading_rad, has_compass, STEP_S)
            if self.t_s % self.fix_s == 0.0:
                self.fix(heading_rad)
            self.state = water.update(self.state, self.t_s)
        return water.estimate_at(self.state, self.t_s)

    def fix(self, heading_rad):
        north_m, east_m = (m + self.rng.gauss(0.0, 0.3) for m in (self.north_m, self.east_m))
        latitude_rad = 0.6 + north_m / EARTH_RADIUS_M
        longitude_rad = wrap_pi(self.longitude_rad + east_m / (EARTH_RADIUS_M * math.cos(0.6)))
        self.state, course_rad, sd_rad = water.take_position(self.state, self.t_s, latitude_rad, longitude_rad)
        if not math.isnan(course_rad):
            self.track_headings.append((self.t_s, wrap_pi(course_rad - heading_rad), sd_rad))

    def sail_square(self, leg_s=300.0):
        for heading_deg in (0.0, 90.0, 200.0, 310.0):
            estimate = self.sail(heading_deg, leg_s)
        return estimate

    def errors(self, estimate):
        return (
            estimate.current_north_m_s - self.current[0],
            estimate.current_east_m_s - self.current[1],
            estimate.mean_speed_m_s - self.speed_m_s,
        )


@pytest.mark.parametrize(
    ("true_speed_m_s", "current_m_s"), [(0.2, (0.1, -0.25)), (0.4, (-0.5, 0.3)), (0.9, (0.0, 0.0))]
)
def test_speed_and_current_are_estimated_after_four_legs(true_speed_m_s, current_m_s):
    passage = Passage(true_speed_m_s, *current_m_s)
    assert passage.errors(passage.sail_square()) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)
    north_m_s, east_m_s, speed_m_s, leeway_rad = water.guidance_values(passage.state)
    assert (north_m_s, east_m_s, speed_m_s) == pytest.approx((*current_m_s, true_speed_m_s), abs=0.06)
    assert abs(leeway_rad) < 0.3


def test_turns_separate_leeway_and_current():
    passage = Passage(0.7, 0.1, -0.2, leeway_deg=8.0)
    passage.sail_square()
    assert math.degrees(water.guidance_values(passage.state)[3]) == pytest.approx(8.0, abs=3.0)
    way_rad = math.radians(45.0 + 8.0)
    expected = (0.1 + 0.7 * math.cos(way_rad), -0.2 + 0.7 * math.sin(way_rad))
    assert water.over_ground_m_s(passage.state, math.radians(45.0)) == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("current_ratio", [0.0, 0.7, 0.9])
def test_current_weaker_than_the_speed_is_never_too_strong(current_ratio):
    passage, verdicts = Passage(0.5, 0.5 * current_ratio, 0.0), []
    for heading_deg in (0.0, 180.0, 90.0, 180.0):
        for _ in range(8):
            passage.sail(heading_deg, 50.0)
            verdicts.append(passage.state.verdict.too_strong)
    assert max(verdicts) == 0.0


def test_moved_origin_at_the_date_line_does_not_change_the_estimate():
    passage, moves = Passage(2.0, 0.1, -0.1, fix_s=10.0, longitude_rad=math.pi - 2000.0 / EARTH_RADIUS_M), 0
    for leg in range(20):
        previous = passage.state.origin
        passage.sail((60.0, 100.0)[leg % 2], 400.0)
        north_m, east_m = passage.state.filter.means[0, water_filter.NORTH :]
        assert math.hypot(north_m, east_m) < math.sqrt(2.0) * water.MAX_ORIGIN_DISTANCE_M + 100.0
        assert math.isnan(passage.state.filter.refused_t_s)
        moves += leg > 0 and passage.state.origin != previous
    assert moves >= 2
    estimate = water.estimate_at(passage.state, passage.t_s)
    assert abs(passage.errors(estimate)[2]) < 3.0 * estimate.mean_speed_sd_m_s < 0.3


def test_heading_from_the_track_matches_its_standard_deviation():
    passage = Passage(0.6, 0.1, -0.2)
    passage.sail_square()
    passage.sail(310.0, 30.0)
    passage.track_headings.clear()
    for heading_deg in (310.0, 30.0, 120.0):
        passage.track_headings.clear()
        passage.sail(heading_deg, 200.0, has_compass=False)
        errors, sds = [error for _, error, _ in passage.track_headings], [sd for _, _, sd in passage.track_headings]
        assert len(errors) >= 15
        assert sum((error / sd) ** 2 for error, sd in zip(errors, sds, strict=True)) / len(errors) < 3.0
        assert max(sds) < 0.5


def test_heading_from_the_track_is_that_at_the_end_of_a_turn():
    passage = Passage(0.6, 0.1, -0.2)
    passage.sail_square()
    passage.track_headings.clear()
    for number in range(300):
        passage.sail(310.0 + 3.0 * number, STEP_S, has_compass=False)
    errors = [error for _, error, _ in passage.track_headings]
    assert len(errors) > 40
    assert abs(sum(errors) / len(errors)) < math.radians(3.0)  # the mean heading of a stretch lags by 7.5 deg


def test_slow_values_start_at_the_estimate_and_stay_within_its_standard_deviation():
    passage = Passage(0.4, 0.0, 0.33)
    passage.sail(300.0, STEP_S)
    estimate = water.estimate_at(passage.state, passage.t_s)
    assert water.guidance_values(passage.state)[:3] == (
        estimate.current_north_m_s,
        estimate.current_east_m_s,
        estimate.mean_speed_m_s,
    )
    for heading_deg in (300.0, 200.0, 240.0):
        for _ in range(40):
            estimate = passage.sail(heading_deg, 5.0)
            slow, variances = (
                passage.state.slow,
                (estimate.covariance[0], estimate.covariance[4], estimate.covariance[7]),
            )
            values = (estimate.current_north_m_s, estimate.current_east_m_s, estimate.mean_speed_m_s)
            for slow_value, value, variance in zip(slow, values, variances, strict=True):
                assert (
                    abs(slow_value - value) <= math.sqrt(variance) + 1e-12 or slow_value == water_filter.MIN_SPEED_M_S
                )


def test_heading_for_a_course_across_a_strong_current_varies_less_with_slow_values():
    passage = Passage(0.4, 0.0, 0.33)
    passage.sail_square(200.0)
    changes_rad, previous = [0.0, 0.0], None
    for _ in range(300):
        estimate = passage.sail(240.0, STEP_S)
        north_m_s, east_m_s, speed_m_s, _ = water.guidance_values(passage.state)
        slow_rad = heading_for_course(math.pi, speed_m_s, north_m_s, east_m_s)
        estimate_rad = heading_for_course(
            math.pi, estimate.mean_speed_m_s, estimate.current_north_m_s, estimate.current_east_m_s
        )
        if previous is not None:
            changes_rad[0] += abs(wrap_pi(slow_rad - previous[0]))
            changes_rad[1] += abs(wrap_pi(estimate_rad - previous[1]))
        previous = slow_rad, estimate_rad
    assert changes_rad[0] < 0.7 * changes_rad[1]


def test_low_speed_is_used_for_guidance_as_soon_as_it_is_estimated():
    passage = Passage(0.4, 0.0, 0.1)
    passage.sail_square(200.0)
    passage.speed_m_s = 0.02
    for heading_deg in (200.0, 20.0, 200.0):
        estimate = passage.sail(heading_deg, 300.0)
    speed_m_s = water.guidance_values(passage.state)[2]
    assert abs(speed_m_s - estimate.mean_speed_m_s) <= estimate.mean_speed_sd_m_s
    assert speed_m_s < 0.2


def test_expected_values_apply_before_the_first_position():
    state = water.initial_state(0.1, -0.2, 0.6)
    assert water.guidance_values(state) == (0.1, -0.2, 0.6, 0.0)
    assert water.over_ground_m_s(state, math.nan) == (0.1, -0.2)
    assert water.over_ground_m_s(state, 0.0) == pytest.approx((0.7, -0.2))
    assert water.speed_sd(state) == pytest.approx(math.hypot(water.FIRST_SPEED_SD_M_S, water.EDDY_SD_M_S))
    assert water.update(state, 5.0) == state
    assert water.take_heading(state, 1.0, True, 0.1) is state
    estimate = water.estimate_at(state, 1000.0)
    assert (estimate.current_north_m_s, estimate.current_east_m_s, estimate.mean_speed_m_s) == (0.1, -0.2, 0.6)


@pytest.mark.parametrize(("speed_ratio", "ratio"), [(0.5, 0.5), (0.0, 0.1), (1e3, 10.0)])
def test_model_follows_the_speed_within_limits(speed_ratio, ratio):
    state = water.initial_state(0.0, 0.0, speed_ratio * OCEAN_RAMBLER.speed_m_s)
    model = water.model_at_speed(OCEAN_RAMBLER, state)
    assert model.turning_ability_1_s == pytest.approx(ratio * OCEAN_RAMBLER.turning_ability_1_s)
    assert model.turning_lag_s == pytest.approx(OCEAN_RAMBLER.turning_lag_s / ratio)


TRACK = (0.6, math.pi - 1e-4)  # near the date line


def moved(north_m, east_m):
    """Return the coordinates at an offset from TRACK, by the mid-latitude."""
    latitude_rad = 0.6 + north_m / 6371000.0
    return latitude_rad, wrap_pi(TRACK[1] + east_m / (6371000.0 * math.cos(0.5 * (0.6 + latitude_rad))))


@pytest.mark.parametrize(
    ("north_m", "east_m", "is_moved"),
    [(4990, 4990, False), (-4990, -4990, False), (5010, 0, True), (-5010, 0, True), (0, 5010, True), (0, -5010, True)],
)
def test_origin_moves_to_a_boat_5_km_away_on_an_axis(north_m, east_m, is_moved):
    state, _, _ = water.take_position(water.initial_state(0.1, 0.2, 0.5), 100.0, *TRACK)
    state = state._replace(stretch=water.Stretch(104.0, 3.0, 4.0, 1.0, 2.0, 3.0))
    f = state.filter
    moved_state, *result = water.take_position(state, 102.0, *moved(north_m, east_m))
    assert (moved_state.fix_t_s, moved_state.origin) == (102.0, moved(north_m, east_m) if is_moved else TRACK)
    assert all(map(math.isnan, result))
    expected = (f.means[0, 5] - north_m, f.means[0, 6] - east_m) if is_moved else (f.means[0, 5], f.means[0, 6])
    assert tuple(moved_state.filter.means[0, 5:]) == pytest.approx(expected, abs=0.01)
    # Without a stretch in progress another one begins.
    assert moved_state.stretch.t_s == 102.0
    assert moved_state.stretch[1:3] == pytest.approx((0.0, 0.0) if is_moved else (north_m, east_m), abs=0.01)


@pytest.mark.parametrize(
    ("duration_s", "begins", "gives_heading"),
    [
        (0.0, False, False),
        (9.9, False, False),
        (10.0, True, True),
        (30.0, True, True),
        (30.1, True, False),
        (-0.1, True, False),
    ],
)
def test_track_of_10_to_30_s_gives_the_heading_at_its_end(duration_s, begins, gives_heading):
    """The heading at the end is 2.0 rad, that of the mean vector 1.5 rad."""
    state, _, _ = water.take_position(water.initial_state(0.1, -0.2, 0.5), 70.0, *TRACK)
    stretch = water.Stretch(100.0 - duration_s, 20.0, -10.0, 2.0, 9.0 * math.cos(1.5), 9.0 * math.sin(1.5))
    way_m = (duration_s * (0.1 + 0.5 * math.cos(0.4)), duration_s * (-0.2 + 0.5 * math.sin(0.4)))
    place = moved(20.0 + way_m[0], -10.0 + way_m[1])
    taken, heading_rad, sd_rad = water.take_position(state._replace(stretch=stretch), 100.0, *place)
    if gives_heading:
        expected = water_results.heading_from_track(taken.filter, 100.0, *way_m, duration_s)
        assert (wrap_pi(heading_rad), sd_rad) == pytest.approx((wrap_pi(expected[0] + 0.5), expected[1]), rel=1e-3)
    else:
        assert math.isnan(heading_rad)
    if begins:
        assert taken.stretch == pytest.approx((100.0, 20.0 + way_m[0], -10.0 + way_m[1], 2.0, 0.0, 0.0), abs=0.01)
    else:
        assert taken.stretch == stretch


def test_stretch_sums_the_estimated_headings_of_any_source():
    state, _, _ = water.take_position(water.initial_state(0.1, -0.2, 0.5), 70.0, *TRACK)
    for is_compass_used in (True, False):
        state = water.take_heading(state, 1.2, is_compass_used, 0.5)
    vector = (math.cos(1.2), math.sin(1.2))
    assert state.stretch[3:] == pytest.approx((1.2, *vector))
    assert state.filter[1:4] == pytest.approx((0.5 * vector[0], 0.5 * vector[1], 0.5))


@pytest.mark.parametrize(("step_s", "gain"), [(3.0, 0.1), (60.0, 1.0), (-1.0, 0.0)])
@pytest.mark.parametrize("off_sds", [0.5, -0.5, 3.0, -3.0])
def test_slow_values_follow_within_30_s_and_a_standard_deviation(step_s, gain, off_sds):
    f = water_filter.begin(100.0, 0.0, 0.0, 0.5, 0.05, 0.3, -0.2, 0.04, 0.0, 0.1)
    estimate = water_filter.water_at(f, 100.0)
    means = (0.3, -0.2, 0.5)
    sds = (math.sqrt(estimate.covariance[0]), math.sqrt(estimate.covariance[4]), estimate.mean_speed_sd_m_s)
    slow = water.Expected(*(mean + off_sds * sd for mean, sd in zip(means, sds, strict=True)))
    state = water.initial_state(0.0, 0.0, 0.5)._replace(fix_t_s=100.0, filter=f, slow=slow, slow_t_s=100.0 - step_s)
    updated = water.update(state, 100.0)
    shift = (1.0 - gain) * off_sds
    limited = max(-1.0, min(1.0, shift))
    assert updated.slow == pytest.approx(tuple(mean + limited * sd for mean, sd in zip(means, sds, strict=True)))
    assert updated.slow_t_s == 100.0


@pytest.mark.parametrize(("sd_m_s", "share"), [(0.05, 0.5), (0.1, 0.2), (0.0, 1.0)])
def test_speed_of_the_model_is_the_mean_weighted_with_a_standard_deviation_of_5_cm_s(sd_m_s, share):
    f = water_filter.begin(0.0, 0.0, 0.0, 0.4, sd_m_s, 0.0, 0.0, 0.3, 0.03, 0.1)
    state = water.initial_state(0.0, 0.0, 0.5)._replace(filter=f, slow=water.Expected(0.1, 0.2, 0.8), slow_t_s=0.0)
    assert water.model_speed(state) == pytest.approx(0.5 + 0.3 * share)
    assert water.guidance_values(state) == pytest.approx((0.1, 0.2, 0.8, math.atan2(0.03, 0.4)))
    assert water.speed_sd(state) == pytest.approx(math.hypot(sd_m_s, 0.03))


def test_first_position_has_the_expected_values_and_their_standard_deviations():
    state, heading_rad, sd_rad = water.take_position(water.initial_state(0.1, -0.2, 0.6), 7.0, *TRACK)
    assert math.isnan(heading_rad + sd_rad)
    assert (state.fix_t_s, state.origin, state.filter.t_s) == (7.0, TRACK, 7.0)
    assert tuple(state.filter.means[0]) == pytest.approx((0.0, 0.6, 0.0, 0.1, -0.2, 0.0, 0.0))
    sds = (0.1, 0.3, 0.1, 0.3, 0.3, 0.3, 0.3)
    assert tuple(state.filter.covariances[0].diagonal()) == pytest.approx(tuple(sd * sd for sd in sds))


def test_leeway_of_a_slow_boat_is_that_at_2_cm_s():
    f = water_filter.begin(0.0, 0.0, 0.0, 0.01, 0.1, 0.0, 0.0, 0.3, 0.03, 0.1)
    state = water.initial_state(0.0, 0.0, 0.5)._replace(fix_t_s=0.0, filter=f)
    updated = water.update(state, 1.0)
    assert water.guidance_values(updated)[2:] == pytest.approx((0.02, math.atan2(0.03, 0.02)))
