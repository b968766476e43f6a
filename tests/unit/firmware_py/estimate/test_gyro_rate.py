"""Heading estimate with the yaw rate of a gyroscope without north."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians, wrap_pi, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.estimate import delay_test, gyro, heading_estimator, heading_filter, heading_model, heading_tick
from firmware_py.estimate.heading_estimator import HeadingEstimatorSettings, HeadingEstimatorState, HeadingTimeouts
from firmware_py.estimate.heading_filter import PRIOR
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

PARAMETERS = ParameterSet()
SETTINGS = HeadingEstimatorSettings.of(PARAMETERS)
TIMEOUTS = HeadingTimeouts((2.0, 2.0), 5.0)


class Boat:
    """A boat whose rudder follows a sine, with a compass of 10 Hz and its noise, and a gyroscope or none.

    `speed_m_s`: it sends a position each second; None: it has no receiver.
    """

    def __init__(self, *, factor=None, drift_deg_s=0.0, noise_deg=1.0, kick_deg_s=0.0, speed_m_s=None, seed=1):
        self.rng, self.factor, self.drift_rad_s = np.random.default_rng(seed), factor, radians(drift_deg_s)
        self.kick_rad_s, self.speed_m_s, self.place = radians(kick_deg_s), speed_m_s, Place(0.6, 2.1)
        self.compass_error_rad = 0.0
        self.noise_rad, self.has_compass = radians(noise_deg), True
        self.state = HeadingEstimatorState.at_start(PARAMETERS)
        self.t_s, self.heading_rad, self.rate_rad_s, self.turned_rad = 0.0, 1.0, 0.0, 2.0
        self.rate_errors, self.heading_errors, self.texts = [], [], []

    def run(self, seconds, settings=SETTINGS):
        for _ in range(round(10 * seconds)):
            rudder_rad = radians(30.0) * math.sin(self.t_s / 20.0)
            before_rad = self.heading_rad
            self.heading_rad, self.rate_rad_s = rk4_step(
                self.heading_rad, self.rate_rad_s, rudder_rad, 0.1,
                OCEAN_RAMBLER.turning_ability_1_s, OCEAN_RAMBLER.turning_lag_s, OCEAN_RAMBLER.norrbin_s2, radians(3.0),
            )  # fmt: skip
            self.rate_rad_s += self.kick_rad_s * float(self.rng.standard_normal())
            self.t_s += 0.1
            error_rad = self.compass_error_rad + self.noise_rad * float(self.rng.standard_normal())
            measured_rad = wrap_two_pi(self.heading_rad + error_rad)
            samples = [HeadingSample(self.t_s, measured_rad, NorthReference.TRUE)] if self.has_compass else []
            if self.factor is not None:
                rate_rad_s = self.factor * (self.heading_rad - before_rad) / 0.1 + self.drift_rad_s
                self.turned_rad += 0.1 * rate_rad_s
                samples.append(
                    HeadingSample(
                        self.t_s, wrap_two_pi(self.turned_rad), NorthReference.RELATIVE, yaw_rate_rad_s=rate_rad_s,
                        roll_rad=0.3, source=1,
                    )
                )  # fmt: skip
            self.state, events = heading_estimator.update(
                settings, self.state, samples, self.positions(), rudder_rad, TIMEOUTS, self.t_s
            )
            self.texts += [event.text for event in events]
            motion = self.state.tick.filter.motion
            self.rate_errors.append(motion.yaw_rate_rad_s + motion.wave_rate_rad_s - self.rate_rad_s)
            self.heading_errors.append(wrap_pi(self.state.heading.heading_rad - self.heading_rad))
        return self

    def positions(self):
        if self.speed_m_s is None:
            return ()
        step_m = 0.1 * self.speed_m_s
        self.place = self.place.at_offset(step_m * math.cos(self.heading_rad), step_m * math.sin(self.heading_rad))
        if round(10 * self.t_s) % 10:
            return ()
        return (PositionSample(self.t_s, FixType.FIX_3D, self.place.latitude_rad, self.place.longitude_rad),)

    def rms_deg(self, errors, seconds):
        return math.degrees(math.sqrt(np.mean(np.square(errors[-round(10 * seconds) :]))))


def test_gyroscope_halves_the_error_of_the_yaw_rate_with_waves():
    without, with_gyro = (Boat(factor=factor, kick_deg_s=0.3).run(300.0) for factor in (None, 1.0))
    assert with_gyro.rms_deg(with_gyro.rate_errors, 120.0) < 0.5 * without.rms_deg(without.rate_errors, 120.0)
    assert with_gyro.rms_deg(with_gyro.heading_errors, 120.0) < without.rms_deg(without.heading_errors, 120.0)


def test_drift_of_the_gyroscope_does_not_reach_the_heading():
    boat = Boat(factor=1.0, drift_deg_s=0.3).run(600.0)
    assert boat.state.gyro.is_used
    assert abs(math.degrees(np.mean(boat.heading_errors[-1200:]))) < 0.3
    assert math.degrees(boat.state.gyro.drift_rad_s) == pytest.approx(0.3, abs=0.05)


def test_gyroscope_that_turns_the_wrong_way_is_reported_and_has_no_effect():
    without, wrong = Boat().run(300.0), Boat(factor=-1.0).run(300.0)
    assert wrong.texts == without.texts
    assert not wrong.state.gyro.is_used
    assert wrong.state.heading == without.state.heading


def test_gyroscope_alone_gives_no_heading():
    boat = Boat(factor=1.0)
    boat.has_compass = False
    boat.run(60.0)
    assert not heading_filter.has_started(boat.state.tick.filter)
    assert boat.state.heading.sample_t_s is None


def test_gyroscope_without_compass_does_not_keep_the_heading_fresh():
    boat = Boat(factor=1.0).run(60.0)
    boat.has_compass = False
    boat.run(10.0)
    assert boat.t_s - boat.state.heading.sample_t_s == pytest.approx(10.0, abs=0.2)
    assert boat.texts[-1] == "Heading lost: compass A failed"


def test_gyroscope_halves_the_error_of_the_course_over_ground_after_the_compass_is_lost():
    errors_deg = {}
    for factor in (None, 1.0):
        boat = Boat(factor=factor, kick_deg_s=0.3, speed_m_s=0.5, drift_deg_s=0.1).run(300.0)
        boat.has_compass = False
        boat.run(300.0)
        assert boat.texts[-1] == "Heading source: course over ground (was compass A)"
        errors_deg[factor] = boat.rms_deg(boat.heading_errors, 250.0)
    assert errors_deg[1.0] < 0.6 * errors_deg[None]


def test_jump_of_the_compass_does_not_end_the_use_of_the_gyroscope():
    """The course replaces the compass before the gyroscope is suspected."""
    boat = Boat(factor=1.0, speed_m_s=0.5).run(300.0)
    boat.compass_error_rad = math.radians(90.0)
    boat.run(60.0)
    assert boat.texts[-1] == "Heading source: course over ground (was compass A)"
    assert boat.state.gyro.is_used
    assert boat.rms_deg(boat.heading_errors, 30.0) < 10.0


def test_rate_is_used_once_for_each_heading_of_a_slow_compass(monkeypatch):
    used_sds, take_rate = [], heading_tick.take_rate
    boat = Boat(factor=1.0).run(120.0)
    monkeypatch.setattr(heading_tick, "take_rate", lambda *args: used_sds.append(args[2]) or take_rate(*args))
    for _ in range(50):
        boat.has_compass = not boat.has_compass
        boat.run(0.1)
    assert len(used_sds) == 25
    levels = boat.state.tick.filter.levels
    expected_rad_s = gyro.rate_sd_rad_s(math.exp(levels.wave_sd), math.exp(levels.wave_period))
    assert used_sds[-1] == pytest.approx(expected_rad_s, rel=0.2)
    assert expected_rad_s > 1.01 * gyro.rate_sd_rad_s(0.0, 1.0)


def test_gyroscope_is_not_used_by_the_observer_and_gives_no_attitude():
    settings = HeadingEstimatorSettings.of(PARAMETERS.replaced("EST_MODE", 0.0))
    headings = [Boat(factor=factor).run(60.0, settings).state.heading for factor in (None, 1.0)]
    assert headings[0] == headings[1]
    assert headings[0].roll_rad is None


def started(boat):
    tick = boat.state.tick
    return tick._replace(delay=tick.delay._replace(log_ratio=0.0))


def test_update_with_a_rate_is_that_of_the_filter_and_of_the_delayed_filter():
    tick = started(Boat().run(120.0))
    updated = heading_tick.take_rate(tick, 0.02, 0.005)
    motion, innovation, variance = heading_model.correct_rate(tick.filter.motion, 0.02, 0.005**2)
    delayed, delayed_innovation, delayed_variance = heading_model.correct_rate(tick.delay.motion, 0.02, 0.005**2)
    assert updated.filter.motion == motion
    assert updated.filter._replace(motion=tick.filter.motion) == tick.filter
    assert updated.delay.motion == delayed
    ratio = heading_model.log_likelihood(delayed_innovation, delayed_variance)
    ratio -= heading_model.log_likelihood(innovation, variance)
    assert updated.delay.log_ratio == pytest.approx(ratio)
    assert updated.delay.log_ratio != 0.0
    unchanged = {"filter": tick.filter, "delay": tick.delay}
    assert updated._replace(**unchanged) == tick


def test_rate_adds_to_the_ratio_of_the_tick():
    motion = heading_model.begin(0.0, PRIOR)
    test = delay_test.DelayTest(motion, log_ratio=2.0)
    _, innovation, variance = heading_model.correct_rate(motion, 0.01, 1e-4)
    assert delay_test.take_rate(test, 0.01, 1e-4, innovation, variance).log_ratio == pytest.approx(2.0)
