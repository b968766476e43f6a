"""Heading estimation in a tick: sources, filter, constant compass, prediction check and fallback."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate import heading_filter, heading_tick, prediction_check, water
from firmware_py.estimate.heading_tick import HeadingSettings
from firmware_py.estimate.prediction_check import PredictionCheck
from firmware_py.estimate.sources import Source, TrueHeadingSample
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step
from hil.ship.noise import NormalNumbers
from hil.ship.waves import WaveYaw

SETTINGS = HeadingSettings.of(ParameterSet())
TIMEOUTS_S = (2.0, 2.0)
NO_HEADING = math.nan


class Boat:
    """A boat with two compasses and the heading estimate; `compass_rad` is the heading of A (0) or B (1)."""

    def __init__(self, wave_deg=0.0, period_s=6.0, seed=1, step_s=0.1, bias_deg=0.0, resolution_deg=0.1, noise_deg=0.1):
        self.rng = np.random.default_rng(seed)
        self.waves = WaveYaw(radians(wave_deg), period_s, step_s, NormalNumbers(np.random.default_rng(seed + 100)))
        self.step_s, self.bias_rad, self.noise_rad = step_s, radians(bias_deg), radians(noise_deg)
        self.resolution_rad = radians(resolution_deg)
        self.state, self.t_s, self.heading_rad, self.rate_rad_s = heading_tick.START, 0.0, 1.0, 0.0
        self.is_rudder_known, self.settings, self.speed_m_s = True, SETTINGS, OCEAN_RAMBLER.speed_m_s
        self.sources, self.estimates_rad = [], []

    def compass_rad(self, source):
        return self.heading_rad + self.waves.angle_rad(0.0) if source == 0 else NO_HEADING

    def water(self):
        return water.initial_state(0.0, 0.0, self.speed_m_s)._replace(fix_t_s=self.t_s)

    def samples(self):
        for source in (0, 1):
            reading_rad = self.compass_rad(source)
            if not math.isnan(reading_rad):
                reading_rad += self.noise_rad * float(self.rng.standard_normal())
                raw_rad = round(reading_rad / self.resolution_rad) * self.resolution_rad
                yield TrueHeadingSample(self.t_s, raw_rad, raw_rad, source)

    def tick(self, rudder_rad=0.0, course=None):
        s, model = self.state, OCEAN_RAMBLER
        s = heading_tick.begin_tick(s, self.t_s, self.step_s, TIMEOUTS_S)
        samples = tuple(self.samples())
        for sample in samples:
            s = heading_tick.add_sample(s, model, sample)
        s = heading_tick.select(s, self.settings, model, self.t_s, TIMEOUTS_S, self.water(), 2.0)
        for sample in samples:
            if sample.source == s.sources.in_use:
                s = heading_tick.take_heading(s, self.settings, model, sample.t_s, sample.heading_rad, 2.0)
        if course is not None:
            s = heading_tick.take_course(s, self.settings, self.t_s, course, radians(10.0))
        self.state = heading_tick.end_tick(s, rudder_rad if self.is_rudder_known else math.nan)
        self.sources.append(s.sources.in_use)
        if heading_filter.has_started(s.filter):
            self.estimates_rad.append(heading_tick.heading_at(self.state, model, self.t_s)[0])
        self.heading_rad, self.rate_rad_s = rk4_step(
            self.heading_rad, self.rate_rad_s, rudder_rad, self.step_s,
            model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, self.bias_rad,
        )  # fmt: skip
        self.waves.step()
        self.t_s += self.step_s

    def run(self, seconds, rudder_rad=0.0, until=lambda _: False):
        for _ in range(round(seconds / self.step_s)):
            self.tick(rudder_rad)
            if until(self):
                break
        return self

    @property
    def in_use(self):
        return self.state.sources.in_use

    @property
    def error_deg(self):
        return math.degrees(abs(wrap_pi(self.estimates_rad[-1] - self.heading_rad)))


def constant_compass(boat):
    """Return a function for `compass_rad` that is constant at the present heading."""
    reading_rad, boat.noise_rad = boat.heading_rad, 0.0
    return lambda source: reading_rad if source == 0 else NO_HEADING


def uses_compass(boat):
    return boat.in_use in {Source.COMPASS_A, Source.COMPASS_B}


# ---------------------------------------------------------------------------------- constant compass


def test_compass_frozen_in_a_turn_is_contradicted_and_the_estimate_continues():
    boat = Boat().run(90.0)
    boat.run(3.0, radians(25.0))
    boat.compass_rad, since_s = constant_compass(boat), boat.t_s
    boat.run(30.0, radians(25.0), until=lambda boat: not uses_compass(boat))
    assert boat.t_s - since_s < 15.0
    assert boat.error_deg < 5.0
    boat.run(10.0, radians(25.0))
    assert boat.error_deg < 8.0


@pytest.mark.parametrize("resolution_deg", [0.1, 1.0])
def test_constant_compass_on_a_straight_course_in_calm_water_is_not_contradicted(resolution_deg):
    boat = Boat(resolution_deg=resolution_deg, noise_deg=0.0).run(90.0)
    boat.compass_rad = constant_compass(boat)
    assert uses_compass(boat.run(10.0 * SETTINGS.frozen_s))


def test_compass_of_whole_degrees_may_be_constant_after_the_waves_have_ended():
    boat = Boat(wave_deg=4.0, resolution_deg=1.0).run(200.0)
    waves, begun_s = boat.waves.angle_rad, boat.t_s
    boat.waves.angle_rad = lambda since_s: max(0.0, 1.0 - (boat.t_s - begun_s) / 60.0) * waves(since_s)
    boat.run(120.0)
    assert set(boat.sources) == {Source.COMPASS_A}


@pytest.mark.parametrize(
    ("wave_deg", "period_s", "run_s", "limits_s"),
    [
        pytest.param(
            1.0, 3.0, 30.0, (SETTINGS.frozen_s - 1.0, SETTINGS.frozen_s + 1.0), id="small waves: CMP_FROZEN_S"
        ),
        pytest.param(10.0, 6.0, 150.0, (0.0, 12.0), id="large waves: about a period"),
    ],
)
def test_compass_frozen_in_waves_is_contradicted(wave_deg, period_s, run_s, limits_s):
    boat = Boat(wave_deg=wave_deg, period_s=period_s).run(run_s)
    boat.compass_rad, since_s = constant_compass(boat), boat.t_s
    boat.run(60.0, until=lambda boat: not uses_compass(boat))
    assert limits_s[0] <= boat.t_s - since_s <= limits_s[1]


def test_compass_that_measures_again_is_used_after_its_probation():
    boat = Boat().run(90.0)
    boat.run(3.0, radians(25.0))
    measures, noise_rad = boat.compass_rad, boat.noise_rad
    boat.compass_rad = constant_compass(boat)
    boat.run(30.0, radians(25.0), until=lambda boat: not uses_compass(boat))
    boat.compass_rad, boat.noise_rad = measures, noise_rad
    boat.run(30.0)
    assert boat.in_use == Source.COMPASS_A
    assert boat.error_deg < 2.0


# ---------------------------------------------------------------------------------- choice of the source


@pytest.mark.parametrize("seed", range(1, 3))
def test_swell_is_no_jump_from_the_first_heading_on(seed):
    boat = Boat(wave_deg=20.0, period_s=8.0, seed=seed, noise_deg=0.3).run(90.0)
    assert set(boat.sources) == {Source.COMPASS_A}
    assert math.isnan(boat.state.sources.compasses[0].plateau.since_s)


@pytest.mark.parametrize("seed", range(1, 4))
def test_compass_of_1_hz_and_whole_degrees_jumps_only_by_a_jump_and_not_in_swell(seed):
    boat = Boat(wave_deg=20.0, period_s=8.0, seed=seed, step_s=1.0, resolution_deg=1.0, noise_deg=0.3).run(600.0)
    assert set(boat.sources[120:]) == {Source.COMPASS_A}  # the waves are learned in the first two minutes
    boat.compass_rad = lambda _: boat.heading_rad + boat.waves.angle_rad(0.0) + math.pi
    assert not uses_compass(boat.run(4.0))


def test_jump_of_the_compass_is_not_followed():
    boat = Boat(wave_deg=3.0).run(90.0)
    boat.compass_rad = lambda source: boat.heading_rad + 1.5 if source == 0 else NO_HEADING
    boat.run(3.0)
    assert not uses_compass(boat)
    assert boat.error_deg < 20.0
    boat.run(2.0)
    assert boat.error_deg < 20.0


def test_change_of_compass_causes_no_step_and_its_offset_decays():
    boat, off_rad = Boat(), radians(10.0)
    boat.compass_rad = lambda source: boat.heading_rad + (off_rad if source == 1 else 0.0)
    boat.run(90.0)
    assert boat.in_use == Source.COMPASS_A
    boat.compass_rad = lambda source: boat.heading_rad + off_rad if source == 1 else NO_HEADING
    boat.run(3.0)
    assert boat.in_use == Source.COMPASS_B
    assert np.abs(np.diff(np.unwrap(boat.estimates_rad[-40:]))).max() < radians(0.6)
    assert boat.error_deg < 2.0
    boat.run(40.0)
    assert boat.error_deg == pytest.approx(10.0, abs=1.0)


def test_compass_that_settles_elsewhere_restarts_the_estimate_without_a_source():
    boat = Boat().run(90.0)
    begun_s, smoothed = boat.state.filter.begun_s, boat.state.smoothed
    boat.compass_rad, boat.speed_m_s = lambda _: NO_HEADING, 0.0
    boat.run(5.0)
    assert boat.in_use == Source.NONE
    boat.state = boat.state._replace(bias_mean_rad=0.3)
    boat.heading_rad += 2.0
    boat.compass_rad = lambda source: boat.heading_rad if source == 0 else NO_HEADING
    boat.run(90.0, until=lambda boat: boat.state.filter.begun_s > begun_s)
    assert boat.state.filter.begun_s > begun_s
    assert boat.state.check.comparisons == 0.0
    assert boat.state.bias_mean_rad != 0.3
    assert smoothed.t_s < boat.state.smoothed.t_s
    assert boat.run(5.0).error_deg < 2.0


def test_course_gives_the_heading_without_a_compass():
    boat = Boat(bias_deg=2.0).run(90.0)
    boat.compass_rad = lambda _: NO_HEADING
    boat.run(3.0)
    assert boat.in_use == Source.COURSE
    for tick in range(1200):
        boat.tick(course=boat.heading_rad if tick % 100 == 0 else None)
    assert boat.in_use == Source.COURSE
    assert boat.error_deg < 15.0
    assert boat.state.check.comparisons <= 3.0  # headings from the track are not compared


# ---------------------------------------------------------------------------------- check and fallback


def with_rejected_filter(boat):
    return boat.state._replace(check=PredictionCheck(boat.state.filter.motion, boat.t_s, 0.0, 9.0, 20.0, True))


def test_rejected_filter_is_replaced_by_the_fixed_gain_observer():
    boat = Boat(wave_deg=4.0).run(60.0)
    sd_rad = heading_tick.heading_sd(boat.state)
    assert heading_tick.is_trusted(boat.state)
    state = with_rejected_filter(boat)
    assert not heading_tick.is_trusted(state)
    assert heading_tick.heading_sd(state) == pytest.approx(3.0 * sd_rad)
    heading_rad, yaw_rate_rad_s = heading_tick.heading_at(state, OCEAN_RAMBLER, state.smoothed.t_s)
    assert heading_rad == pytest.approx(state.smoothed.heading_rad)
    assert yaw_rate_rad_s == state.smoothed.yaw_rate_rad_s
    assert heading_rad != heading_tick.heading_at(boat.state, OCEAN_RAMBLER, state.smoothed.t_s)[0]
    assert abs(wrap_pi(heading_rad - boat.heading_rad)) < radians(12.0)  # with the wave yaw


def test_rejected_filter_is_still_used_without_a_compass():
    boat = Boat().run(60.0)
    state = with_rejected_filter(boat)
    without_compass = state._replace(sources=state.sources._replace(in_use=Source.COURSE))
    expected = heading_tick.heading_at(boat.state, OCEAN_RAMBLER, boat.t_s)
    assert heading_tick.heading_at(without_compass, OCEAN_RAMBLER, boat.t_s) == expected


def test_fixed_gain_observer_restarts_after_a_gap():
    start = heading_tick.update_smoothed(heading_tick.NO_SMOOTHED, SETTINGS, 0.0, 1.0, 0.0, 2.0)
    assert start == heading_tick.Smoothed(0.0, 1.0, 0.0)
    updated = heading_tick.update_smoothed(start, SETTINGS, 0.1, 1.1, 0.0, 2.0)
    assert 1.0 < updated.heading_rad < 1.1
    assert heading_tick.update_smoothed(start, SETTINGS, 2.0, 1.5, 0.0, 2.0).yaw_rate_rad_s > 0.0
    assert heading_tick.update_smoothed(start, SETTINGS, 0.0, 1.5, 0.0, 2.0) == start
    assert heading_tick.update_smoothed(updated, SETTINGS, 5.0, 2.0, 0.0, 2.0) == heading_tick.Smoothed(5.0, 2.0, 0.0)


def test_filter_of_a_boat_that_moves_like_its_model_is_never_rejected():
    boat = Boat(wave_deg=4.0, step_s=0.5)
    for number in range(60):
        boat.run(20.0, radians(15.0) * (-1.0) ** number)
        assert not boat.state.check.is_rejected
    assert boat.state.check.comparisons == prediction_check.MEMORY_COMPARISONS


# ---------------------------------------------------------------------------------- input of the control law


def test_mean_bias_follows_the_bias_over_minutes():
    boat, means, biases = Boat(step_s=0.5, bias_deg=6.0), [], []
    for number in range(60):
        boat.run(20.0, radians(6.0) + radians(5.0) * (-1.0) ** number)
        means.append(math.degrees(boat.state.bias_mean_rad))
        biases.append(math.degrees(boat.state.filter.motion.bias_rad))
    assert np.mean(means[-20:]) == pytest.approx(6.0, abs=1.0)
    assert np.abs(np.diff(means[-20:])).max() < 0.5 * np.abs(np.diff(biases)).max()
    boat.bias_rad = radians(-4.0)
    boat.run(30.0, radians(-4.0))
    estimate = heading_tick.estimate_of(boat.state, 1.0, 0.0, water.START)
    assert estimate.bias_rad == boat.state.filter.motion.bias_rad
    assert estimate.bias_mean_rad > estimate.bias_rad  # the mean follows more slowly
    assert estimate.correction_rad2_s > 0.0


def test_heading_is_estimated_without_a_measured_rudder():
    boat = Boat(wave_deg=4.0, step_s=0.2)
    boat.is_rudder_known = False
    boat.run(90.0)
    for number in range(4):
        boat.run(30.0, radians(20.0) * (-1.0) ** number)
        assert boat.error_deg < 12.0
    assert all(math.isfinite(value) for value in boat.state.filter.motion)


def test_late_heading_is_ignored():
    boat = Boat().run(60.0)
    late_s = boat.state.filter.t_s - heading_filter.MAX_SAMPLE_DELAY_S - 0.5
    after = heading_tick.take_heading(boat.state, SETTINGS, OCEAN_RAMBLER, late_s, 3.0, 2.0)
    assert after.filter == boat.state.filter
    assert after.bias_mean_rad == boat.state.bias_mean_rad
    assert after.check == boat.state.check


def test_filters_of_the_delay_test_agree_after_a_motion_without_a_compass():
    boat = Boat(wave_deg=5.0).run(70.0).run(20.0, radians(20.0))
    s, motion = boat.state, boat.state.filter.motion._replace(heading_rad=2.0)
    assert s.delay.motion != s.filter.motion
    for function in (heading_tick.with_motion, heading_tick.without_compass):
        result = function(s, boat.t_s, motion)
        assert result.delay.motion == result.filter.motion == motion
        assert result.delay.log_ratio == s.delay.log_ratio
