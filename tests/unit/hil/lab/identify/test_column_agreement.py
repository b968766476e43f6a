"""Columns that disagree: frozen values are ignored, and disagreements are reported."""

from dataclasses import replace

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.stretches import prepare

BOAT = (0.08, 6.0, 30.0, 0.02)
HALF = 2000


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


@pytest.mark.parametrize("channels", [pytest.param("h", marks=pytest.mark.proof), "hr"])
def test_a_compass_that_is_frozen_for_half_of_the_log_is_reported_and_ignored(zigzag, channels):
    """K was half of what it is, identifiable, without a word."""
    recording = replace(zigzag, heading_rad=frozen(zigzag.heading_rad, slice(HALF, 2 * HALF)))
    if channels == "h":
        recording = replace(recording, yaw_rate_rad_s=None)
    found = identify([recording])
    assert found.data.rows == HALF
    assert any("heading_rad is constant for 200 s" in text for text in found.judgement.warnings)
    assert near(found)


def test_a_gyroscope_that_is_frozen_meanwhile_is_reported_and_ignored(zigzag):
    recording = replace(zigzag, yaw_rate_rad_s=frozen(zigzag.yaw_rate_rad_s, slice(1000, 2500)))
    data = prepare([recording])
    assert (data.rows, len(data.stretches)) == (2500, 2)
    assert "yaw_rate_rad_s is constant for 150 s (first from 100 s)" in data.warnings[0]


@pytest.mark.parametrize("name", ["heading_rad", "yaw_rate_rad_s"])
def test_a_column_that_never_changes_is_left_out(zigzag, name):
    data = prepare([replace(zigzag, **{name: np.zeros(2 * HALF)})])
    assert f"{name} is constant: dead sensor" in data.warnings[0]
    assert getattr(data.stretches[0], name) is None


def test_a_compass_that_is_frozen_for_most_of_the_log_is_left_out_beside_a_yaw_rate(zigzag):
    recording = replace(zigzag, heading_rad=frozen(zigzag.heading_rad, slice(24, 2 * HALF)))
    data = prepare([recording])
    assert (data.rows, data.stretches[0].heading_rad) == (2 * HALF, None)
    assert "column ignored" in data.warnings[0]
    with pytest.raises(UsageError, match="frozen in almost all rows"):
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


def test_what_a_recording_to_be_predicted_disagrees_in_is_reported(zigzag):
    other = replace(zigzag.rows(slice(0, 3000)), name="other")
    found = identify([zigzag], [replace(other, heading_rad=frozen(other.heading_rad, slice(1000, 2000)))])
    assert found.judgement.warnings == ()
    assert "warning: other: heading_rad is constant for 100 s" in report.as_text(found)


@pytest.mark.parametrize(
    ("scale", "texts"),
    [
        (0.9, "turns 1.1"),
        pytest.param(-1.0, "turns against yaw_rate_rad_s", marks=pytest.mark.proof),
        pytest.param(57.3, "in degrees?", marks=pytest.mark.proof),
    ],
)
def test_a_yaw_rate_of_another_measure_is_a_warning_and_the_heading_is_taken(zigzag, scale, texts):
    found = identify([replace(zigzag, yaw_rate_rad_s=scale * zigzag.yaw_rate_rad_s).rows(slice(0, 2000))])
    assert any(texts in text for text in found.judgement.warnings)
    assert near(found)
