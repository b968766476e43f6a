"""Filter of the compass swing on a simulated boat on straight legs without waves."""

import math
import random

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI, degrees, radians
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.estimate import deviation_filter
from firmware_py.estimate.deviation import deviation_rad
from firmware_py.estimate.deviation_filter import DeviationInput, DeviationSettings, DeviationState

NO_CORRECTION = DeviationSettings(0.0, (0.0,) * 5)
DEVIATION = tuple(radians(coefficient) for coefficient in (1.0, 4.0, -3.0, 1.5, 0.5))


def sail(
    courses_rad,
    leg_s=1200.0,
    current_m_s=(0.1, -0.05),
    declination_rad=0.0,
    settings=NO_CORRECTION,
    seed=1,
    has_velocity=True,
):
    """Sail the courses by a compass with the deviation DEVIATION; return the state."""
    rng, state, t_s, north_m, east_m = random.Random(seed), DeviationState(), 0.0, 0.0, 0.0
    for compass_rad in courses_rad:
        for _ in range(round(leg_s / 2.0)):
            t_s += 2.0
            sample_rad = compass_rad + radians(rng.gauss(0.0, 1.0))
            # The compass heading is the magnetic heading minus the deviation.
            course_rad = compass_rad + deviation_rad(DEVIATION, compass_rad) + declination_rad + settings.offset_rad
            north_m_s = current_m_s[0] + 0.6 * math.cos(course_rad)
            east_m_s = current_m_s[1] + 0.6 * math.sin(course_rad)
            north_m, east_m = north_m + 2.0 * north_m_s, east_m + 2.0 * east_m_s
            speed_and_course = (math.hypot(north_m_s, east_m_s), math.atan2(east_m_s, north_m_s) % TWO_PI)
            place = (north_m / 6371000.0, east_m / 6371000.0)
            fix = PositionSample(
                t_s, FixType.FIX_3D, *place, 0.0, *(speed_and_course if has_velocity else (None, None))
            )
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


@pytest.mark.parametrize("options", [{"declination_rad": 0.2}, {"has_velocity": False}])
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


START, SWING = DeviationState(), DeviationSettings(0.0, DEVIATION)


def sail_minute(
    state=START,
    *,
    heading_deg=40.0,
    headings=61,
    fixes=61,
    seconds=60,
    turn_deg=0.0,
    speed_m_s=0.5,
    course_rad=0.5,
    source=0,
    reference=NorthReference.MAGNETIC,
    moves_for_s=60,
    way_m_s=0.5,
    start_s=1000.0,
):
    """Return the state after ticks of 1 s; without a speed, the positions move by 0.5 m/s for a time."""
    for tick in range(seconds + 1):
        t_s, angle_rad = start_s + tick, math.radians(heading_deg + 3.0 * math.sin(tick))
        samples = (HeadingSample(t_s, angle_rad, reference, source=source),) if tick < headings else ()
        way_rad = way_m_s * tick / 6371000.0
        place = (0.7 + way_rad * math.cos(0.5), -3.1 + way_rad * math.sin(0.5) / math.cos(0.7))
        fix = PositionSample(t_s, FixType.FIX_3D, *place, 0.0, speed_m_s, course_rad)
        has_fix = tick < fixes if speed_m_s is not None else tick <= moves_for_s
        smoothed_rad = math.radians(heading_deg) + (math.radians(turn_deg) if tick == 30 else 0.0)
        inputs = DeviationInput(samples, 0.2, fix if has_fix else None, smoothed_rad, (0.05, -0.1, 0.5))
        state = deviation_filter.update(SWING, state, inputs, t_s)
    return state


@pytest.mark.parametrize(
    ("options", "is_used"),
    [
        ({}, True),
        ({"seconds": 59}, False),
        ({"headings": 20}, True),
        ({"headings": 19}, False),
        ({"fixes": 5}, True),
        ({"fixes": 4}, False),
        ({"turn_deg": 19.9}, True),
        ({"turn_deg": 20.5}, False),
        ({"turn_deg": -20.5}, False),
        ({"source": 1}, False),
        ({"reference": NorthReference.RELATIVE}, False),
        ({"heading_deg": math.nan}, False),
        ({"speed_m_s": 0.0, "course_rad": None}, True),
        ({"speed_m_s": 10.0}, True),
        ({"speed_m_s": 10.1}, False),
        ({"speed_m_s": -0.1}, False),
        ({"speed_m_s": math.nan}, False),
        ({"course_rad": 4.0 * math.pi}, True),
        ({"course_rad": -12.6}, False),
        ({"course_rad": math.nan}, False),
        ({"speed_m_s": None}, True),
        ({"speed_m_s": None, "moves_for_s": 45}, True),
        ({"speed_m_s": None, "moves_for_s": 44}, False),
        ({"speed_m_s": None, "moves_for_s": -1}, False),
        ({"speed_m_s": None, "way_m_s": 9.9}, True),
        ({"speed_m_s": None, "way_m_s": 10.1}, False),
    ],
)
def test_minute_needs_headings_velocities_and_a_straight_course(options, is_used):
    assert sum(sail_minute(**options).sectors) == is_used


@pytest.mark.parametrize("speed_m_s", [0.5, None])
def test_minute_has_the_means_of_velocity_and_basis_functions(speed_m_s):
    state = sail_minute(speed_m_s=speed_m_s, heading_deg=359.0)
    angles = np.radians([359.0 + 3.0 * math.sin(tick) for tick in range(61)])
    basis = [np.mean(np.sin(angles)), np.mean(np.cos(angles)), np.mean(np.sin(2 * angles)), np.mean(np.cos(2 * angles))]
    time_s, compass_rad, *values = state.last_minute
    assert (time_s, math.remainder(compass_rad - np.mean(angles) - 0.2, TWO_PI)) == pytest.approx((1060.0, 0.0))
    assert values == pytest.approx([*basis, 0.5 * math.cos(0.5), 0.5 * math.sin(0.5)], rel=1e-5)
    assert state.sectors == (1, *(0,) * 11)
    true = sail_minute(reference=NorthReference.TRUE).last_minute[1]
    assert sail_minute().last_minute[1] - true == pytest.approx(0.2)


class PlainSwing:
    """The Kalman filter of the module's text, with matrices, from the minutes of another filter.

    `x`: coefficients A to E [rad], current north and east, speed [m/s].
    """

    def __init__(self):
        self.x = np.array([*DEVIATION, 0.05, -0.1, 0.5])
        self.p = np.diag(np.square([*np.radians([20.0, 12.0, 12.0, 6.0, 6.0]), 0.4, 0.4, 0.3]))
        self.noise, self.leg, self.t_s = np.full(2, 2.0 * math.log(0.05)), None, None

    def update(self, t_s, compass_rad, *values):
        if self.t_s is not None:
            rates = np.array([*[math.radians(0.1) ** 2 / 86400.0] * 5, 2e-7, 2e-7, 1e-6])
            self.p = self.p + np.diag(rates) * min(t_s - self.t_s, 6.0 * 3600.0)
        self.t_s, basis, velocity = t_s, np.array([1.0, *values[:4]]), np.array(values[4:])
        course_rad = compass_rad + basis @ self.x[:5]
        if self.leg is None or abs(math.remainder(course_rad - self.leg[0], TWO_PI)) > math.radians(12.0):
            self.leg = (course_rad, max(self.x[7], 0.1) * basis)
        axes = np.array(
            [[math.cos(self.leg[0]), math.sin(self.leg[0])], [-math.sin(self.leg[0]), math.cos(self.leg[0])]]
        )
        rows = np.zeros((2, 8))
        rows[:, 5:7], rows[0, 7], rows[1, :5] = axes, 1.0, self.leg[1]
        through_m_s = self.x[7] * np.array([math.cos(course_rad), math.sin(course_rad)])
        errors, before = axes @ (velocity - self.x[5:7] - through_m_s), self.x
        for axis, row in enumerate(rows):
            innovation, cross = errors[axis] - row @ (self.x - before), self.p @ row
            variance = row @ cross + math.exp(self.noise[axis])
            square = innovation**2 / variance
            self.noise[axis] = max(self.noise[axis] + 0.05 * (min(square, 9.0) - 1.0), 2.0 * math.log(0.003))
            variance *= max(1.0, square / 9.0)
            self.x = self.x + cross * innovation / variance
            self.p = self.p - np.outer(cross, cross) / variance


def test_filter_agrees_with_the_plain_filter():
    """Legs differ by 2 to 50 deg; there are outliers, a gap of a day, and at last a speed of 0."""
    state, plain, rng, heading_deg, start_s = DeviationState(), PlainSwing(), random.Random(3), 10.0, 0.0
    minutes, sectors, legs = 220, [0] * 12, set()
    for number in range(minutes):
        if number == 200:  # nearly at the lowest noise, 3 mm/s
            plain.noise[:] = 2.0 * math.log(0.00301)
            state = replace(state, log_noise=tuple(plain.noise))
        heading_deg += rng.uniform(2.0, 14.0) * (number % 4 == 0) + 50.0 * (number % 20 == 0)
        start_s += 60.0 if number != 60 else 86400.0
        course_rad = math.radians(heading_deg) + 0.25 + 0.05 * rng.gauss(0.0, 1.0)
        speed_m_s = (0.6 if number % 11 else 1.6) + 0.03 * rng.gauss(0.0, 1.0) if number < 150 else 1e-3
        state = sail_minute(
            state, heading_deg=heading_deg, start_s=start_s, seconds=61, headings=60, speed_m_s=speed_m_s,
            course_rad=course_rad % TWO_PI,
        )  # fmt: skip
        plain.update(*state.last_minute)
        sectors[int(state.last_minute[1] % TWO_PI / TWO_PI * 12.0)] += 1
        legs.add(state.leg)
        assert state.x == pytest.approx(plain.x, rel=1e-6, abs=1e-9)
        assert np.frombuffer(state.p).reshape(8, 8) == pytest.approx(plain.p, rel=1e-6, abs=1e-12)
        assert state.log_noise == pytest.approx(plain.noise, rel=1e-9)
        assert state.leg[1:] == pytest.approx(plain.leg[1])
        assert state.sectors == tuple(sectors)
    assert min(state.log_noise) == pytest.approx(2.0 * math.log(0.003))
    assert len(legs) > 20
    assert state.x[7] < 0.1


@pytest.mark.parametrize("changes", [{"x": (math.nan, *(0.1,) * 7)}, {"p": (-1e-3 * np.eye(8)).tobytes()}])
def test_impossible_state_restarts_the_filter(changes):
    state = replace(sail_minute(), **changes)
    assert sail_minute(state, start_s=2000.0) == START


@pytest.mark.parametrize(("sd_deg", "is_ready"), [(0.75, True), (0.751, False)])
def test_proposal_with_a_standard_deviation_of_three_quarters_of_a_degree(sd_deg, is_ready):
    p = np.diag([math.radians(sd_deg) ** 2, *[0.0] * 7])
    estimate = deviation_filter.result(SWING, replace(START, x=(0.1,) * 8, p=p.tobytes(), sectors=(1,) * 12))
    assert (estimate.sd_rad, estimate.ready) == (pytest.approx(math.radians(sd_deg)), is_ready)
    assert estimate.sds_rad == pytest.approx((math.radians(sd_deg), 0.0, 0.0, 0.0, 0.0))


def test_uncertainty_and_change_are_those_of_the_worst_of_36_headings():
    rng = np.random.default_rng(8)
    root = 0.01 * rng.standard_normal((8, 9))
    x = tuple(map(float, rng.uniform(-0.1, 0.1, 8)))
    estimate = deviation_filter.result(SWING, replace(START, x=x, p=(root @ root.T).tobytes()))
    headings = np.radians(np.arange(0.0, 360.0, 10.0))
    basis = np.stack([headings**0, np.sin(headings), np.cos(headings), np.sin(2 * headings), np.cos(2 * headings)])
    assert estimate.sd_rad == pytest.approx(np.sqrt(np.max(np.sum((root[:5].T @ basis) ** 2, axis=0))))
    assert estimate.off_rad == pytest.approx(np.max(np.abs((np.array(x[:5]) - DEVIATION) @ basis)))
    assert estimate.coefficients_rad == x[:5]
