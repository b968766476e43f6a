"""The current and her speed through the water, told from heading and fixes."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import clamp, wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate import kalman, wave_filter
from firmware_py.estimate import over_ground as over_ground_of
from firmware_py.estimate.heading_estimator import over_ground
from firmware_py.estimate.learning import NoiseModel
from firmware_py.estimate.water import CHANGES_M_S, WaterState, known, over_ground_m_s, report, update
from firmware_py.estimate.wave_filter import Heading
from firmware_py.estimate.wave_filter_state import WaveFilterSettings, WaveFilterState
from firmware_py.model.crab import heading_for_course
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

SETTINGS = WaveFilterSettings.of(ParameterSet())
STEP_S = 0.5


class Passage:
    """A boat that turns as her model does: headings twice a second and fixes every few seconds, with noise."""

    def __init__(self, speed_m_s, north_m_s, east_m_s, seed=1, leeway_deg=0.0):
        self.speed_m_s, self.current = speed_m_s, (north_m_s, east_m_s)
        self.ship = OCEAN_RAMBLER.at_speed(speed_m_s)
        self.leeway_rad = math.radians(leeway_deg)
        self.rng = random.Random(seed)
        self.tick = 0
        self.heading_rad = self.rate_rad_s = 0.0
        self.north_m = self.east_m = 0.0
        self.filter = WaveFilterState()
        self.stretch = None
        self.state = WaterState()
        self.velocities = True
        self.odd = None

    @property
    def t_s(self):
        return STEP_S * self.tick

    def steer(self, heading_deg, seconds, *, wave_deg=4.0, fix_s=1):
        ship = self.ship
        for _ in range(round(seconds / STEP_S)):
            off_rad = wrap_pi(math.radians(heading_deg) - self.heading_rad)
            rudder_rad = clamp(0.5 * off_rad - 2.0 * self.rate_rad_s, -0.5, 0.5)
            for _ in range(5):
                self.heading_rad, self.rate_rad_s = rk4_step(
                    self.heading_rad, self.rate_rad_s, rudder_rad, STEP_S / 5,
                    ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2, 0.0,
                )  # fmt: skip
            way_rad = self.heading_rad + self.leeway_rad
            v_north = self.speed_m_s * math.cos(way_rad) + self.current[0]
            v_east = self.speed_m_s * math.sin(way_rad) + self.current[1]
            self.north_m, self.east_m = self.north_m + STEP_S * v_north, self.east_m + STEP_S * v_east
            self.tick += 1
            fixes = [self.fix(v_north, v_east)] if self.t_s % fix_s == 0 else []
            seen_rad = (self.heading_rad + math.radians(self.rng.gauss(0.0, wave_deg))) % (2 * math.pi)
            self.stretch, stated = over_ground(self.stretch, fixes, self.filter.x[0] if self.filter.x else 0.0)
            self.filter = wave_filter.update(SETTINGS, self.filter, [Heading(self.t_s, seen_rad)], stated, rudder_rad)
            self.state = update(self.state, self.filter, self.t_s)
        return report(self.state, self.filter)

    def fix(self, v_north, v_east):
        v_north, v_east = self.odd or (v_north + self.rng.gauss(0.0, 0.03), v_east + self.rng.gauss(0.0, 0.03))
        place = (0.6 + self.north_m / EARTH_RADIUS_M, 2.0 + self.east_m / (EARTH_RADIUS_M * math.cos(0.6)))
        speed, course = math.hypot(v_north, v_east), math.atan2(v_east, v_north)
        return PositionSample(
            self.t_s, FixType.FIX_3D, *place,
            speed_over_ground_m_s=speed if self.velocities else None,
            course_over_ground_rad=course if self.velocities else None,
        )  # fmt: skip


def errors(water, passage):
    return (
        water.current_north_m_s - passage.current[0],
        water.current_east_m_s - passage.current[1],
        water.speed_m_s - passage.speed_m_s,
    )


@pytest.mark.parametrize(("speed", "current"), [(0.2, (0.1, -0.25)), (0.4, (-0.5, 0.3)), (0.9, (0.0, 0.0))])
def test_after_a_few_legs_both_are_known(speed, current):
    passage = Passage(speed, *current)
    for heading_deg in (0.0, 90.0, 200.0, 310.0):
        water = passage.steer(heading_deg, 300)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.04)
    assert water.speed_sd_m_s < 0.08


@pytest.mark.proof
def test_the_standard_deviations_are_honest():
    squares = []
    for seed in range(12):
        rng = random.Random(seed)
        passage = Passage(rng.uniform(0.2, 0.9), rng.gauss(0, 0.2), rng.gauss(0, 0.2), seed)
        for _ in range(6):
            water = passage.steer(rng.uniform(0, 360), rng.uniform(60, 600))
        squares.append(((water.speed_m_s - passage.speed_m_s) / water.speed_sd_m_s) ** 2)
    assert sum(squares) / len(squares) < 1.5
    assert sum(square > 9.0 for square in squares) <= 1


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.proof) for seed in (2, 3))])
def test_the_standard_deviations_are_honest_where_eddies_change_the_current(seed):
    rng = random.Random(100 + seed)
    keep, eddy_m_s, squares, by_filter = math.exp(-60.0 / 1800.0), 0.08, [], []
    passage = Passage(0.6, 0.0, 0.2, seed)
    for minute in range(50):
        passage.current = tuple(
            mean_m_s + keep * (now_m_s - mean_m_s) + math.sqrt(1.0 - keep * keep) * rng.gauss(0.0, eddy_m_s)
            for mean_m_s, now_m_s in zip((0.0, 0.2), passage.current, strict=True)
        )
        water = passage.steer(90.0 * (minute // 2), 60.0)
        if minute >= 15:
            off_m_s = errors(water, passage)[:2]
            own_sd_m_s = math.sqrt(water.current_sd_m_s**2 - CHANGES_M_S**2)
            squares += [(one / water.current_sd_m_s) ** 2 for one in off_m_s]
            by_filter += [(one / own_sd_m_s) ** 2 for one in off_m_s]
    assert 0.2 < sum(squares) / len(squares) < 2.0
    assert sum(by_filter) / len(by_filter) > 3.0  # what it would be without


@pytest.mark.proof
def test_the_filter_is_honest_where_a_tide_turns_while_she_keeps_a_heading():
    passage, squares = Passage(0.6, 0.0, 0.0), []
    for minute in range(150):
        phase = 2.0 * math.pi * 60.0 * minute / 44_712.0
        passage.current = (0.4 * math.cos(phase), 0.4 * math.sin(phase))
        water = passage.steer(137.0 * (minute // 30), 60.0)
        if minute >= 60:
            waves, off_m_s = passage.filter, errors(water, passage)[:2]
            spreads_m_s = (waves.spread(kalman.NORTH), waves.spread(kalman.EAST))
            squares += [(one / spread) ** 2 for one, spread in zip(off_m_s, spreads_m_s, strict=True)]
    assert 0.1 < sum(squares) / len(squares) < 2.0


@pytest.mark.parametrize("leg_deg", [0.0, 37.0, 200.0])
def test_how_a_change_of_the_water_is_shared_out_is_not_seen_on_the_way(leg_deg):
    x, way_rad = [0.0] * kalman.STATES, math.radians(leg_deg)
    x[kalman.HEADING], x[kalman.SPEED] = way_rad, 0.6
    gains = np.zeros((kalman.STATES, kalman.COLUMNS))
    gains.put(over_ground_of.OPEN, over_ground_of.open_shares(tuple(x), way_rad, 1800.0, 1.0))
    gained, parts = gains[:, : kalman.STATES], (kalman.NORTH, kalman.EAST, kalman.SPEED, kalman.LEEWAY)
    assert np.array_equal(gained, gained.T)
    assert min(np.linalg.eigvalsh(gained[np.ix_(parts, parts)])) > -1e-18
    # Along the way by 3e-5 m/s^2: what a second adds to its square.
    assert gained[kalman.SPEED, kalman.SPEED] == pytest.approx(2.0 * 3e-5**2 * 1800.0)
    for axis in range(2):
        shown = np.zeros(kalman.STATES)
        for place, part in over_ground_of.expect(tuple(x), axis, way_rad, NoiseModel(), None).parts:
            shown[place] += part
        assert np.abs(gained @ shown).max() < 1e-18


def test_of_what_nobody_saw_nothing_is_taken_for_something_else():
    x = (0.0,) * kalman.SPEED + (0.6,) + (0.0,) * (kalman.STATES - kalman.SPEED - 1)
    longest = over_ground_of.open_shares(x, 1.0, 9000.0, 60.0)
    assert over_ground_of.open_shares(x, 1.0, 3600.0, 7200.0) == longest
    assert not any(over_ground_of.open_shares(x, 1.0, -1.0, 1.0))
    assert not any(over_ground_of.open_shares(x, 1.0, 100.0, -1.0))


def test_on_one_heading_the_sum_is_known_and_the_doubt_remains():
    passage = Passage(0.7, 0.0, 0.3)
    water = passage.steer(0.0, 3600)
    assert water.speed_m_s + water.current_north_m_s == pytest.approx(0.7, abs=0.03)
    # Across, current and leeway are not told apart either.
    across_m_s = water.current_east_m_s + water.speed_m_s * math.sin(water.leeway_rad)
    assert across_m_s == pytest.approx(0.3, abs=0.03)
    assert water.speed_sd_m_s > 0.15
    assert abs(water.speed_m_s - 0.7) < 0.25


def test_small_swings_of_the_compass_do_not_make_her_slower():
    passage = Passage(0.9, 0.0, 0.3)
    passage.steer(0.0, 600)
    passage.steer(120.0, 600)
    water = passage.steer(230.0, 2400, wave_deg=15.0)
    assert water.speed_m_s == pytest.approx(0.9, abs=0.12)


@pytest.mark.proof
def test_a_current_that_turns_is_followed():
    passage = Passage(0.5, 0.0, 0.3)
    for leg in range(40):
        angle = leg * math.pi / 40
        passage.current = (0.3 * math.sin(angle), 0.3 * math.cos(angle))
        water = passage.steer(137.0 * leg, 180)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.08)


def test_positions_alone_will_do():
    passage = Passage(0.6, 0.1, -0.2)
    passage.velocities = False
    for heading_deg in (0.0, 90.0, 200.0, 310.0):
        water = passage.steer(heading_deg, 400, fix_s=10)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)


def test_rare_fixes_will_do():
    passage = Passage(0.6, 0.1, -0.2)
    for heading_deg in (0.0, 90.0, 200.0, 310.0):
        water = passage.steer(heading_deg, 900, fix_s=7)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)


def test_an_outlier_changes_nothing_and_a_lasting_change_is_believed():
    passage = Passage(0.5, 0.0, 0.0)
    for heading_deg in (0.0, 120.0, 240.0):
        before = passage.steer(heading_deg, 400)
    passage.odd = (3.0, 3.0)
    after = passage.steer(240.0, 20)
    passage.odd = None
    assert after.speed_m_s == pytest.approx(before.speed_m_s, abs=0.03)
    passage.current = (-0.6, 0.4)
    for heading_deg in (60.0, 180.0, 300.0, 60.0):
        water = passage.steer(heading_deg, 600)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)


def test_a_current_stronger_than_she_is_is_recognised_and_a_weaker_one_is_not():
    passage = Passage(0.4, 0.0, 0.48)
    passage.steer(0.0, 120)
    for _ in range(30):
        water = passage.steer(270.0, 60)
    assert water.too_strong
    passage.current = (0.0, 0.2)
    for heading_deg in (200.0, 270.0, 340.0):
        water = passage.steer(heading_deg, 400)
    assert not water.too_strong
    for drift in (0.0, 0.7, 0.9):
        weaker = Passage(0.5, 0.5 * drift, 0.0)
        for heading_deg in (0.0, 180.0, 90.0, 180.0):
            assert not weaker.steer(heading_deg, 400).too_strong


def test_leeway_is_told_from_a_current_across_by_turning():
    passage = Passage(0.7, 0.1, -0.2, leeway_deg=8.0)
    for heading_deg in (0.0, 100.0, 200.0, 310.0):
        water = passage.steer(heading_deg, 300)
    assert errors(water, passage) == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert math.degrees(water.leeway_rad) == pytest.approx(8.0, abs=2.0)
    assert math.degrees(water.leeway_sd_rad) < 2.0
    # On another heading she goes where her leeway takes her from it.
    way_rad = math.radians(45.0 + 8.0)
    told = over_ground_m_s(passage.filter, math.radians(45.0))
    assert told == pytest.approx((0.1 + 0.7 * math.cos(way_rad), -0.2 + 0.7 * math.sin(way_rad)), abs=0.03)


def test_the_doubt_about_the_current_is_that_of_its_worst_direction():
    passage = Passage(0.7, 0.0, 0.3)
    water = passage.steer(30.0, 1200)  # along which current and speed are not told apart
    waves = passage.filter
    nn, ee = (waves.covariance(axis, axis) for axis in (kalman.NORTH, kalman.EAST))
    ne = waves.covariance(kalman.NORTH, kalman.EAST)
    worst = max(np.linalg.eigvalsh([[nn, ne], [ne, ee]]))
    assert water.current_sd_m_s == pytest.approx(math.sqrt(worst + CHANGES_M_S**2))
    assert water.current_sd_m_s > 1.02 * math.sqrt(max(nn, ee))


def test_before_the_first_heading_the_water_is_what_was_expected():
    expecting = WaveFilterState(expected_water=(0.1, -0.2, 0.6))
    water = report(WaterState(), expecting)
    assert (water.current_north_m_s, water.current_east_m_s, water.speed_m_s) == (0.1, -0.2, 0.6)
    assert water.speed_sd_m_s == pytest.approx(0.4)
    assert over_ground_m_s(expecting, None) == (0.1, -0.2)
    assert update(WaterState(), expecting, 5.0) == WaterState()


def test_the_heading_of_a_course_across_a_strong_current_does_not_swing_with_each_fix():
    passage = Passage(0.4, 0.0, 0.33)
    for heading_deg in (300.0, 200.0, 240.0):
        passage.steer(heading_deg, 200.0)
    swung_rad, before_rad = [], None
    for _ in range(300):
        water = passage.steer(240.0, 1.0)
        values = (water.speed_m_s, water.current_north_m_s, water.current_east_m_s)
        north_m_s, east_m_s, speed_m_s, _ = known(passage.filter)
        for now, own, place in zip(
            values, (speed_m_s, north_m_s, east_m_s), (kalman.SPEED, kalman.NORTH, kalman.EAST), strict=True
        ):
            assert abs(now - own) <= passage.filter.spread(place) + 1e-12
        slow_rad = heading_for_course(math.pi, *values)
        own_rad = heading_for_course(math.pi, speed_m_s, north_m_s, east_m_s)
        if before_rad is not None:
            swung_rad.append((abs(wrap_pi(slow_rad - before_rad[0])), abs(wrap_pi(own_rad - before_rad[1]))))
        before_rad = slow_rad, own_rad
    slow_rad, own_rad = (sum(column) for column in zip(*swung_rad, strict=True))
    assert slow_rad < 0.4 * own_rad


def test_a_calm_is_steered_by_as_soon_as_it_is_known():
    passage = Passage(0.4, 0.0, 0.1)
    passage.steer(60.0, 200.0)
    passage.steer(200.0, 200.0)
    passage.speed_m_s = 0.02
    water = passage.steer(200.0, 300.0)
    assert water.speed_m_s == pytest.approx(known(passage.filter)[2], abs=passage.filter.spread(kalman.SPEED))
    assert water.speed_m_s < 0.15
