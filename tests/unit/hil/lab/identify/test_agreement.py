"""Columns that do not tell of one motion: what is frozen is left out, and what disagrees is told and allowed for."""

from dataclasses import replace

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.stretch import prepare

BOAT = (0.08, 6.0, 30.0, 0.02)
HALF = 4500


@pytest.fixture(scope="module")
def zigzag(yard):
    time = np.arange(2 * HALF) * 0.1
    rudder = yard.zigzag(time, np.radians(20.0), 20.0)
    return yard.recorded(time, rudder, *yard.boat(*BOAT).motion(time, rudder))


def frozen(values, rows):
    stuck = values.copy()
    stuck[rows] = stuck[rows.start]
    return stuck


def near(found):
    """Whether K and T are known, and the truth within three standard errors."""
    estimates = found.judgement.estimates
    return all(
        estimates[name].verdict == "identifiable" and abs(estimates[name].value - true) < 3.0 * estimates[name].se
        for name, true in (("K", BOAT[0]), ("T", BOAT[1]))
    )


@pytest.mark.parametrize("channels", ["h", "hr"])
def test_a_compass_that_is_frozen_for_half_of_the_log_is_told_and_left_out(zigzag, channels):
    """K was half of what it is, identifiable, without a word."""
    recording = replace(zigzag, heading_rad=frozen(zigzag.heading_rad, slice(HALF, 2 * HALF)))
    if channels == "h":
        recording = replace(recording, yaw_rate_rad_s=None)
    found = identify([recording])
    assert found.data.rows == HALF
    assert any("heading_rad stays exactly the same for 450 s" in text for text in found.judgement.warnings)
    assert near(found)


def test_a_gyroscope_that_is_frozen_meanwhile_is_told_and_left_out(zigzag):
    recording = replace(zigzag, yaw_rate_rad_s=frozen(zigzag.yaw_rate_rad_s, slice(3000, 6000)))
    data = prepare([recording])
    assert (data.rows, len(data.stretches)) == (6000, 2)
    assert "yaw_rate_rad_s stays exactly the same for 300 s (first from 300 s)" in data.warnings[0]


@pytest.mark.parametrize("name", ["heading_rad", "yaw_rate_rad_s"])
def test_a_column_that_never_changes_is_left_out(zigzag, name):
    data = prepare([replace(zigzag, **{name: np.zeros(2 * HALF)})])
    assert f"{name} never changes" in data.warnings[0]
    assert getattr(data.stretches[0], name) is None


def test_a_compass_that_is_frozen_for_most_of_the_log_is_left_out_beside_a_yaw_rate(zigzag):
    recording = replace(zigzag, heading_rad=frozen(zigzag.heading_rad, slice(24, 2 * HALF)))
    data = prepare([recording])
    assert (data.rows, data.stretches[0].heading_rad) == (2 * HALF, None)
    assert "the column is left out" in data.warnings[0]
    with pytest.raises(UsageError, match="frozen nearly throughout"):
        prepare([replace(recording, yaw_rate_rad_s=frozen(zigzag.yaw_rate_rad_s, slice(0, 2 * HALF - 15)))])


def test_a_coarse_compass_on_a_straight_course_is_not_frozen(yard):
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, np.radians(20.0), 20.0) * (time > 200.0)
    heading, rate = yard.boat(*BOAT[:3]).motion(time, rudder)
    recording = yard.recorded(time, rudder, heading, rate, noise=0.0)
    coarse = np.radians(np.round(np.degrees(recording.heading_rad)))
    for one in (recording.yaw_rate_rad_s, None):
        data = prepare([replace(recording, heading_rad=coarse, yaw_rate_rad_s=one)])
        assert (data.rows, data.warnings) == (6000, ())


def test_what_a_recording_to_be_predicted_disagrees_in_is_told(zigzag):
    other = replace(zigzag.rows(slice(0, 3000)), name="other")
    found = identify([zigzag], [replace(other, heading_rad=frozen(other.heading_rad, slice(1000, 2000)))])
    assert found.judgement.warnings == ()
    assert "warning: other: heading_rad stays exactly the same for 100 s" in report.as_text(found, None)


@pytest.mark.parametrize(
    ("scale", "offset"), [(0.9, 0.0), (1.1, 0.005), pytest.param(1.03, 0.0, marks=pytest.mark.proof)]
)
def test_a_yaw_rate_of_another_scale_is_told_and_allowed_for(zigzag, scale, offset):
    """K was 10 % off, known to 1 %, without a word."""
    found = identify([replace(zigzag, yaw_rate_rad_s=scale * zigzag.yaw_rate_rad_s + offset)])
    assert any("times as far as yaw_rate_rad_s adds up to" in text for text in found.judgement.warnings)
    assert found.data.rate_scale == pytest.approx(1.0 / scale, rel=0.03)
    gain = found.judgement.estimates["K"]
    assert gain.verdict == "identifiable"
    assert abs(gain.value - BOAT[0]) < 1.96 * gain.se


@pytest.mark.proof
def test_a_yaw_rate_of_quite_another_scale_tells_no_k(zigzag):
    found = identify([replace(zigzag, yaw_rate_rad_s=1.5 * zigzag.yaw_rate_rad_s)])
    assert found.judgement.estimates["K"].verdict == "not identifiable"


def test_a_constant_error_of_the_yaw_rate_is_taken_away(zigzag):
    """It adds up to a turn the other way, and was refused as a wrong sign."""
    data = prepare([replace(zigzag, yaw_rate_rad_s=zigzag.yaw_rate_rad_s + 0.005)])
    assert any("+0.005" in note and "taken away" in note for note in data.notes)
    assert (data.warnings, data.rate_scale) == ((), 1.0)


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_a_yaw_rate_of_the_other_sign_is_refused(zigzag, offset):
    with pytest.raises(UsageError, match="turn against each other"):
        prepare([replace(zigzag, yaw_rate_rad_s=offset - zigzag.yaw_rate_rad_s)])


def test_waves_and_a_slow_compass_are_no_disagreement(yard, zigzag):
    waves = yard.wave_yaw(2 * HALF, 0.1, 0.05, 2.53, np.random.default_rng(1))
    swing, heading, rate = np.gradient(waves, 0.1), zigzag.heading_rad, zigzag.yaw_rate_rad_s
    tail = np.exp(-np.arange(200) / 20.0)
    late = np.convolve(heading, tail / tail.sum())[: 2 * HALF]
    for one, other in ((heading + waves, rate), (heading + waves, rate + swing), (heading, rate + swing), (late, rate)):
        assert prepare([replace(zigzag, heading_rad=one, yaw_rate_rad_s=other)]).warnings == ()


def test_a_coarse_compass_that_stands_still_between_two_turns_is_not_called_frozen(yard):
    """At whole degrees it says the same for some seconds while her turning ends and begins the other way."""
    time = np.arange(3000) * 0.2
    plan = np.radians([20.0, -20.0, 20.0, 0.0, -10.0, 10.0, -20.0, 30.0, -30.0])
    target, rudder = plan[(time // 25.0).astype(int) % plan.size], np.zeros(time.size)
    for n in range(1, time.size):
        rudder[n] = rudder[n - 1] + np.clip(target[n] - rudder[n - 1], -0.035, 0.035)
    heading, rate = yard.boat(0.1, 6.0, 20.0, 0.01).motion(time, rudder)
    data = prepare([yard.recorded(time, rudder, heading, rate, noise=0.0, resolution=1.0, channels="h")])
    assert not data.warnings
    assert data.rows == time.size


def test_a_heading_of_three_digits_that_goes_on_by_its_own_step_is_not_called_frozen(yard):
    """As published model tests are written: above 10 deg they stood still for seconds at each turn of a zigzag."""
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, np.radians(10.0), 60.0)
    heading, rate = yard.boat(0.06, 30.0).motion(time, rudder)
    degrees = np.degrees(heading)
    cut = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(degrees), 0.01))) - 2.0)
    coarse = np.radians(np.round(degrees / cut) * cut)
    assert np.max(np.abs(degrees)) > 15.0
    data = prepare([yard.recorded(time, rudder, coarse, rate, noise=0.0, channels="h")])
    assert (data.rows, data.warnings) == (time.size, ())


def test_a_yaw_rate_of_three_digits_in_a_steady_turn_is_not_called_frozen(yard):
    """As published model tests are written: where a turn was steadiest its rows were left out, the log cut there."""
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, np.radians(20.0), 120.0)
    heading, rate = yard.boat(0.026, 20.0).motion(time, rudder)
    degrees = np.degrees(rate)
    cut = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(degrees), 1e-4))) - 2.0)
    coarse = np.radians(np.round(degrees / cut) * cut)
    data = prepare([yard.recorded(time, rudder, heading, coarse, noise=0.002, rate_noise=0.0)])
    assert (data.rows, data.warnings) == (time.size, ())
