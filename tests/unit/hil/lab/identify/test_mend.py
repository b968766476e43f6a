"""Noise of a measured speed, and columns that are frozen or disagree."""

from dataclasses import replace

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.mend import smooth_speed_noise
from hil.lab.identify.recording import Recording
from hil.lab.identify.stretches import prepare

ROWS, STEP = 6000, 0.1
BOAT = (0.08, 6.0, 30.0, 0.02)
HALF = 2000


def varying_speed(seed):
    """Return a speed around 0.4 m/s that changes by a third within a minute."""
    from scipy.signal import lfilter  # noqa: PLC0415 - takes a second to import

    keep = np.exp(-STEP / 60.0)
    steps = np.sqrt(1.0 - keep**2) * np.random.default_rng(seed).standard_normal(ROWS)
    return 0.4 * np.exp(0.3 * lfilter([1.0], [1.0, -keep], steps))


def with_speed(speed):
    time = np.arange(speed.size) * STEP
    return Recording("boat", time, np.zeros(time.size), np.sin(time), None, speed)


def test_speed_noise_is_smoothed():
    for seed in range(4):
        true, notes = varying_speed(seed), []
        noise = 0.1 * np.random.default_rng(100 + seed).standard_normal(ROWS)
        smoothed = smooth_speed_noise(with_speed(true + noise), notes).speed_m_s
        assert np.std(smoothed - true) < 0.25 * np.std(noise)
        assert len(notes) == 1
        assert "has noise of 0." in notes[0]


def test_speed_without_noise_is_not_changed():
    for speed in (varying_speed(1), np.full(ROWS, 0.4), 0.4 + np.arange(ROWS) * 1e-4):
        notes = []
        recording = with_speed(speed)
        assert smooth_speed_noise(recording, notes) is recording
        assert not notes


def test_speed_noise_does_not_bias_k(simulation):
    """Without smoothing, K was 3 % too small on average."""
    time = np.arange(ROWS) * STEP
    rudder = simulation.steps(time, 0.6, 30.0, 0.5)
    ratio = varying_speed(0) / 0.4
    fine = np.linspace(0.0, time[-1], 10 * (ROWS - 1) + 1)
    angle, speed = np.interp(fine, time, rudder), np.interp(fine, time, ratio)
    rate, step = np.zeros(fine.size), fine[1]
    for n in range(fine.size - 1):
        u, r = speed[n], rate[n]
        rate[n + 1] = r + step * (0.049 * u * angle[n] - r - 17.0 / u**2 * r**3) / (4.0 / u)
    heading = np.cumsum(rate) * step
    recording = simulation.recorded(time, rudder, heading[::10], rate[::10])
    noise = 0.1 * np.random.default_rng(0).standard_normal(ROWS)
    result = identify([replace(recording, speed_m_s=0.4 * ratio + noise)])
    gain = result.judgement.estimates["K"]
    assert abs(gain.value - 0.049 * result.data.speed_m_s / 0.4) < 3.0 * gain.se


@pytest.fixture(scope="module")
def zigzag(simulation):
    time = np.arange(2 * HALF) * 0.1
    rudder = simulation.zigzag(time, np.radians(20.0), 20.0)
    return simulation.recorded(time, rudder, *simulation.boat(*BOAT).motion(time, rudder))


def freeze(values, rows):
    frozen = values.copy()
    frozen[rows] = frozen[rows.start]
    return frozen


def assert_k_and_t_are_found(result):
    for name, true in (("K", BOAT[0]), ("T", BOAT[1])):
        estimate = result.judgement.estimates[name]
        assert estimate.verdict == "identifiable"
        assert abs(estimate.value - true) < 3.0 * estimate.se


@pytest.mark.parametrize("has_yaw_rate", [pytest.param(False, marks=pytest.mark.proof), True])
def test_rows_with_a_frozen_compass_are_ignored_with_a_warning(zigzag, has_yaw_rate):
    """Without this, K was half of the true value and called identifiable."""
    recording = replace(zigzag, heading_rad=freeze(zigzag.heading_rad, slice(HALF, 2 * HALF)))
    result = identify([recording if has_yaw_rate else replace(recording, yaw_rate_rad_s=None)])
    assert result.data.rows == HALF
    assert any("heading_rad is constant for 200 s" in text for text in result.judgement.warnings)
    assert_k_and_t_are_found(result)


def test_rows_with_a_frozen_gyroscope_are_ignored_with_a_warning(zigzag):
    data = prepare([replace(zigzag, yaw_rate_rad_s=freeze(zigzag.yaw_rate_rad_s, slice(1000, 2500)))])
    assert (data.rows, len(data.stretches)) == (2500, 2)
    assert "yaw_rate_rad_s is constant for 150 s (first from 100 s)" in data.warnings[0]


@pytest.mark.parametrize("name", ["heading_rad", "yaw_rate_rad_s"])
def test_constant_column_is_ignored(zigzag, name):
    data = prepare([replace(zigzag, **{name: np.zeros(2 * HALF)})])
    assert f"{name} is constant: dead sensor" in data.warnings[0]
    assert getattr(data.stretches[0], name) is None


def test_compass_frozen_in_most_rows_is_ignored_or_refused_without_yaw_rate(zigzag):
    recording = replace(zigzag, heading_rad=freeze(zigzag.heading_rad, slice(24, 2 * HALF)))
    data = prepare([recording])
    assert (data.rows, data.stretches[0].heading_rad) == (2 * HALF, None)
    assert "column ignored" in data.warnings[0]
    with pytest.raises(UsageError, match="frozen in almost all rows"):
        prepare([replace(recording, yaw_rate_rad_s=freeze(zigzag.yaw_rate_rad_s, slice(0, 2 * HALF - 15)))])


def test_coarse_compass_on_a_straight_course_is_not_frozen(simulation):
    time = np.arange(6000) * 0.1
    rudder = simulation.zigzag(time, np.radians(20.0), 20.0) * (time > 200.0)
    heading, rate = simulation.boat(*BOAT[:3]).motion(time, rudder)
    recording = simulation.recorded(time, rudder, heading, rate, noise=0.0)
    coarse = np.radians(np.round(np.degrees(recording.heading_rad)))
    for yaw_rate in (recording.yaw_rate_rad_s, None):
        data = prepare([replace(recording, heading_rad=coarse, yaw_rate_rad_s=yaw_rate)])
        assert (data.rows, data.warnings) == (6000, ())


def test_frozen_rows_of_a_validation_recording_are_reported(zigzag):
    other = replace(zigzag.rows(slice(0, 3000)), name="other")
    result = identify([zigzag], [replace(other, heading_rad=freeze(other.heading_rad, slice(1000, 2000)))])
    assert result.judgement.warnings == ()
    assert "warning: other: heading_rad is constant for 100 s" in report.as_text(result)


@pytest.mark.parametrize(
    ("scale", "text"),
    [
        (0.9, "turns 1.1"),
        pytest.param(-1.0, "turns against yaw_rate_rad_s", marks=pytest.mark.proof),
        pytest.param(57.3, "in degrees?", marks=pytest.mark.proof),
    ],
)
def test_yaw_rate_that_disagrees_with_the_heading_is_ignored_with_a_warning(zigzag, scale, text):
    result = identify([replace(zigzag, yaw_rate_rad_s=scale * zigzag.yaw_rate_rad_s).rows(slice(0, 2000))])
    assert any(text in warning for warning in result.judgement.warnings)
    assert_k_and_t_are_found(result)
