"""Gyroscope without north: comparison with the compass, drift, and use of its rate in the heading estimate."""

import math

import pytest

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.records import HeadingSample, NorthReference, Severity
from firmware_py.estimate import gyro

AGREES, DIFFERS = "Gyro agrees with compass: yaw rate used", "Gyro differs from compass: yaw rate not used"


class Boat:
    """A boat whose compass and gyroscope are read at 10 Hz; rates in deg/s, angles in degrees."""

    def __init__(self):
        self.state, self.t_s, self.heading_deg, self.turned_deg = gyro.START, 0.0, 350.0, 77.0
        self.events, self.has_compass = [], True

    def swing(self, **options):
        """Turn by 30 degrees and back within a minute, so that the rate is used."""
        return self.run(10.0, turn=3.0, **options).run(10.0, turn=-3.0, **options).run(40.0, **options)

    def run(self, seconds, turn=0.0, drift=0.0, factor=1.0, compass_error_deg=0.0, until_event=False):
        for _ in range(round(10 * seconds)):
            self.t_s += 0.1
            self.heading_deg += 0.1 * turn
            rate = factor * turn + drift
            self.turned_deg += 0.1 * rate
            sample = HeadingSample(
                self.t_s, wrap_two_pi(radians(self.turned_deg)), NorthReference.RELATIVE, yaw_rate_rad_s=radians(rate)
            )
            compass = (self.t_s, radians(self.heading_deg + compass_error_deg)) if self.has_compass else None
            self.state, events = gyro.update(self.state, (sample,), compass)
            self.events += [(event.severity, event.text) for event in events]
            if events and until_event:
                break
        return self

    def rate(self, age_s=0.0):
        return math.degrees(gyro.rate_at(self.state, self.t_s + age_s))


def test_rate_is_used_after_half_a_minute_of_agreement():
    boat = Boat().run(30.0, turn=2.0)
    assert not boat.state.is_used
    assert math.isnan(boat.rate())
    boat.run(0.3, turn=2.0)
    assert boat.events == [(Severity.INFO, AGREES)]
    assert boat.rate() == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize(("turn_deg", "is_used"), [(19.5, False), (20.5, True)])
def test_rate_is_used_after_a_turn_of_twenty_degrees(turn_deg, is_used, direction):
    boat = Boat().run(60.0).run(0.1, turn=10.0 * turn_deg * direction).run(1.0)
    assert boat.state.is_used is is_used


def test_slow_turn_is_no_evidence_of_the_direction():
    assert not Boat().run(600.0, turn=0.3).state.is_used
    assert Boat().run(600.0, turn=0.4).state.is_used


def test_drift_is_estimated_and_subtracted():
    boat = Boat().swing(drift=0.5).run(400.0, drift=0.5)
    assert boat.rate() == pytest.approx(0.0, abs=0.01)
    boat.run(20.0, turn=2.0, drift=0.5)
    assert boat.rate() == pytest.approx(2.0, abs=0.01)
    assert boat.events == [(Severity.INFO, AGREES)]


def test_drift_follows_with_the_time_constant():
    """The response of a double pole to a constant drift: 1 - (1 + t / T) exp(-t / T), with T = 60 s."""
    boat = Boat().run(10.0).run(60.0, drift=0.1)
    assert math.degrees(boat.state.drift_rad_s) == pytest.approx(0.1 * (1.0 - 2.0 * math.exp(-1.0)), rel=0.02)


@pytest.mark.parametrize(("drift", "is_used"), [(0.95, True), (1.1, False)])
def test_fast_drift_makes_the_rate_unusable(drift, is_used):
    boat = Boat().swing().run(900.0, drift=drift)
    assert boat.state.is_used is is_used


def test_gyroscope_that_turns_the_wrong_way_is_not_used_after_a_turn():
    boat = Boat().swing().run(20.0, turn=2.0, factor=-1.0, until_event=True)
    assert boat.events == [(Severity.INFO, AGREES), (Severity.WARNING, DIFFERS)]
    assert 3.5 < boat.t_s - 60.0 < 8.0  # 15 degrees of difference, and two seconds
    assert math.isnan(boat.rate())
    boat.run(600.0, factor=-1.0)
    for direction in (1.0, -1.0):
        boat.run(20.0, turn=2.0 * direction, factor=-1.0).run(120.0, factor=-1.0)
    assert len(boat.events) == 2  # it is not used again


def test_short_difference_has_no_effect():
    boat = Boat().swing().run(1.9, compass_error_deg=20.0).run(10.0)
    assert boat.events == [(Severity.INFO, AGREES)]
    boat.run(2.3, compass_error_deg=20.0)
    assert boat.events[1:] == [(Severity.WARNING, DIFFERS)]


@pytest.mark.parametrize(("error_deg", "agrees"), [(14.95, True), (15.05, False), (-14.95, True), (-15.05, False)])
def test_difference_of_up_to_15_deg_is_an_agreement(error_deg, agrees):
    boat = Boat().run(10.0).run(0.1, compass_error_deg=error_deg)
    assert (boat.state.agreed_s > 0.0, boat.state.disagreed_s > 0.0) == (agrees, not agrees)


def test_rate_is_used_again_after_agreement():
    boat = Boat().swing().run(5.0, compass_error_deg=90.0)
    assert not boat.state.is_used
    boat.run(300.0)
    assert not boat.state.is_used
    boat.swing()
    assert boat.state.is_used
    assert boat.events[2:] == [(Severity.INFO, AGREES)]


def test_rate_is_used_without_a_compass():
    boat = Boat().swing(drift=0.5).run(400.0, drift=0.5)
    boat.has_compass = False
    boat.run(600.0, turn=1.0, drift=0.5)
    assert boat.rate() == pytest.approx(1.0, abs=0.01)


def test_comparison_restarts_after_a_gap():
    """The boat has turned while the gyroscope or the compass was missing."""
    boat = Boat().swing()
    boat.t_s += 5.5
    boat.heading_deg += 100.0
    boat.run(10.0)
    assert boat.events == [(Severity.INFO, AGREES)]
    assert boat.state.is_used
    boat.t_s += 4.5
    boat.heading_deg += 100.0
    boat.run(10.0)
    assert not boat.state.is_used


def test_turn_before_a_gap_does_not_count():
    boat = Boat().run(10.0, turn=3.0)
    boat.t_s += 5.5
    assert not boat.run(60.0).state.is_used
    assert Boat().run(10.0, turn=3.0).run(60.0).state.is_used


def test_durations_begin_again_after_a_gap():
    for error_deg in (0.0, 50.0):
        boat = Boat().run(10.0).run(1.0, compass_error_deg=error_deg)
        boat.t_s += 5.5
        boat.run(0.1)
        assert (boat.state.agreed_s, boat.state.disagreed_s) == (0.0, 0.0)


def test_expected_drift_is_no_innovation():
    state = gyro.GyroState(t_s=1.0, offset_rad=0.5, drift_rad_s=0.01, agreed_s=3.0)
    sample = HeadingSample(5.0, 2.54, NorthReference.RELATIVE, yaw_rate_rad_s=0.0)
    state, _ = gyro.update(state, (sample,), (5.0, 2.0))
    assert (state.offset_rad, state.drift_rad_s) == pytest.approx((0.54, 0.01))
    assert state.agreed_s == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("state", "step_s", "off_deg", "expected"),
    [
        (gyro.GyroState(t_s=0.0, agreed_s=29.5, has_turned=True), 0.5, 0.0, (30.0, 0.0, True, True)),
        (gyro.GyroState(t_s=0.0, agreed_s=29.25, has_turned=True), 0.5, 0.0, (29.75, 0.0, True, False)),
        (gyro.GyroState(t_s=0.0, disagreed_s=1.5, is_used=True), 0.5, 30.0, (0.0, 2.0, False, True)),
        (gyro.GyroState(t_s=0.0, disagreed_s=1.75, is_used=True), 0.5, 30.0, (0.0, 2.25, False, False)),
        (gyro.GyroState(t_s=0.0, agreed_s=1.0), 5.0, 0.0, (6.0, 0.0, False, False)),
        (gyro.GyroState(t_s=0.0, agreed_s=1.0), 5.25, 0.0, (0.0, 0.0, False, False)),
        (gyro.GyroState(t_s=0.0, agreed_s=1.0, has_turned=True), 0.0, 0.0, (1.0, 0.0, True, False)),
        (gyro.GyroState(t_s=0.25, agreed_s=1.0, has_turned=True), 0.0, 0.0, (0.0, 0.0, False, False)),
        (gyro.GyroState(t_s=0.0, mean_rad=radians(-20.0)), 0.5, 0.0, (0.5, 0.0, True, False)),
        (gyro.GyroState(t_s=0.0), 0.5, 14.99, (0.5, 0.0, False, False)),
    ],
)
def test_durations_and_limits_of_a_comparison(state, step_s, off_deg, expected):
    sample = HeadingSample(step_s, radians(off_deg), NorthReference.RELATIVE, yaw_rate_rad_s=0.0)
    result, _ = gyro.update(state, (sample,), (step_s, 0.0))
    assert (result.agreed_s, result.disagreed_s, result.has_turned, result.is_used) == expected


@pytest.mark.parametrize(
    ("age_s", "is_used"), [(0.15, True), (-0.15, True), (0.16, False), (-0.16, False), (math.nan, False)]
)
def test_age_of_a_rate_is_at_most_0_15_s(age_s, is_used):
    state = gyro.GyroState(is_used=True, rate_t_s=0.0, rate_rad_s=0.25)
    assert math.isnan(gyro.rate_at(state, age_s)) is not is_used
    sample = HeadingSample(0.0, 0.5, NorthReference.RELATIVE, yaw_rate_rad_s=0.0)
    assert (gyro.update(gyro.START, (sample,), (age_s, 0.0))[0].t_s is not None) is is_used


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_estimated_drift_is_limited(direction):
    state = gyro.GyroState(t_s=1.0, drift_rad_s=direction * radians(1.99))
    sample = HeadingSample(5.0, wrap_two_pi(direction), NorthReference.RELATIVE, yaw_rate_rad_s=0.0)
    state, _ = gyro.update(state, (sample,), (5.0, 0.0))
    assert math.degrees(state.drift_rad_s) == pytest.approx(direction * 2.0)


def test_newest_sample_of_a_tick_counts():
    samples = [HeadingSample(t_s, 0.1 * t_s, NorthReference.RELATIVE, yaw_rate_rad_s=0.1 * t_s) for t_s in (4.9, 5.0)]
    state, _ = gyro.update(gyro.START, samples, (5.0, 0.0))
    assert (state.t_s, state.rate_t_s, state.rate_rad_s, state.offset_rad) == (5.0, 5.0, 0.5, 0.5)


@pytest.mark.parametrize(
    ("wave_deg", "period_s", "sd_deg_s"),
    # 30 degrees with a period of 7 s have an acceleration of 24.2 deg/s2, and 0.03 s later another rate by 0.725 deg/s.
    [(0.0, 7.0, 0.2), (30.0, 7.0, math.hypot(0.2, 0.03 * 30.0 * (math.tau / 7.0) ** 2)), (30.0, 3.5, 2.908)],
)
def test_standard_deviation_of_the_rate_includes_its_delay_in_waves(wave_deg, period_s, sd_deg_s):
    assert math.degrees(gyro.rate_sd_rad_s(radians(wave_deg), period_s)) == pytest.approx(sd_deg_s, rel=1e-3)


@pytest.mark.parametrize("values", [(math.nan, 0.0), (0.0, math.inf), (0.0, None)])
def test_sample_without_a_finite_rate_is_ignored(values):
    heading_rad, rate_rad_s = values
    sample = HeadingSample(1.0, heading_rad, NorthReference.RELATIVE, yaw_rate_rad_s=rate_rad_s)
    assert gyro.update(gyro.START, (sample,), (1.0, 0.0)) == (gyro.START, ())
    assert gyro.update(gyro.START, (), (1.0, 0.0)) == (gyro.START, ())
