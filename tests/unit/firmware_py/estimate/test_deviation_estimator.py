"""Compass swing: inputs of ticks, residual angle and progress. The filter itself: test_deviation_filter.py."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    CalibrationState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    Tick,
)
from firmware_py.estimate import deviation_filter
from firmware_py.estimate.declination import declination_rad
from firmware_py.estimate.deviation_estimator import DeviationEstimator, residual_rad

UTC_S = 1_767_225_600.0
WEST = ParameterSet().replaced("CMP_DECL_DEG", -7.0)


def minutes_of(times_s, current_m_s, speed_m_s=0.5, deviation=(0.0,) * 5, across_m_s=0.0, seed=1):
    """Return minutes on all headings with this deviation and current, and a velocity error across the course."""
    rows, rng = [], np.random.default_rng(seed)
    for number, t_s in enumerate(times_s):
        heading = float(rng.uniform(0.0, 2.0 * math.pi))
        basis = (math.sin(heading), math.cos(heading), math.sin(2.0 * heading), math.cos(2.0 * heading))
        course = np.exp(1j * (heading + deviation[0] + np.dot(deviation[1:], basis)))
        velocity = course * (speed_m_s + across_m_s * 1j * (-1) ** number) + complex(*current_m_s)
        rows.append((t_s, heading, *basis, velocity.real, velocity.imag))
    return rows


def residual_of(rows, deviation):
    """Return the sum of the squared angles of a segment, by complex least squares."""
    rows = np.array(rows)
    course = np.exp(1j * (rows[:, 1] + deviation[0] + rows[:, 2:6] @ np.array(deviation[1:])))
    velocity, ones, zeros = rows[:, 6] + 1j * rows[:, 7], np.ones(len(rows)), np.zeros(len(rows))
    design = np.vstack([np.stack([course.real, ones, zeros], 1), np.stack([course.imag, zeros, ones], 1)])
    (speed, north, east), *_ = np.linalg.lstsq(design, np.concatenate([velocity.real, velocity.imag]), rcond=None)
    return np.sum((((velocity - north - 1j * east) / course).imag / max(speed, 0.1)) ** 2)


DEVIATION = (0.02, 0.05, -0.03, 0.01, -0.02)


@pytest.mark.parametrize(("speed_m_s", "deviation"), [(0.5, DEVIATION), (0.5, (0.0,) * 5), (0.05, DEVIATION)])
def test_residual_is_that_of_current_and_speed_fitted_to_two_hours(speed_m_s, deviation):
    first = minutes_of(range(60, 7200, 600), (0.2, -0.1), speed_m_s, DEVIATION, 0.03)
    second = minutes_of(range(7200, 14400, 600), (-0.1, 0.3), speed_m_s, DEVIATION, 0.02, seed=2)
    expected = math.sqrt((residual_of(first, deviation) + residual_of(second, deviation)) / 24.0)
    assert residual_rad(first + second, deviation) == pytest.approx(expected, rel=1e-9)
    # Nine minutes in two hours are too few.
    rest = minutes_of(range(14400, 14940, 60), (0.5, 0.5), seed=3)
    assert residual_rad(first + second + rest, deviation) == pytest.approx(expected, rel=1e-9)
    assert math.isnan(residual_rad(rest, deviation))
    assert math.isfinite(residual_rad([*rest, (14990.0, *rest[0][1:])], deviation))


def take(
    estimator,
    t_s,
    heading_rad=1.0,
    speed_m_s=0.5,
    course_rad=1.0,
    source=0,
    reference=NorthReference.MAGNETIC,
    variation_rad=None,
):
    headings = (HeadingSample(t_s, heading_rad % (2.0 * math.pi), reference, variation_rad, source=source),)
    fix = PositionSample(t_s, FixType.FIX_3D, 0.6, 2.1, 0.0, speed_m_s, course_rad, utc_s=UTC_S)
    estimator.take(Inputs(Tick(0, t_s, 0.0, 0, 1.0), headings, (fix,)))


def test_minute_begins_with_the_parameters_and_at_the_smoothed_heading():
    estimator = DeviationEstimator(WEST)
    for t_s in range(61):
        take(estimator, float(t_s))
    assert estimator.state.last_minute[1] == pytest.approx(1.0 - math.radians(7.0))
    assert estimator.state.x[deviation_filter.SPEED] == pytest.approx(0.5, abs=0.01)
    estimator.set_parameters(ParameterSet().replaced("CMP_DECL_AUTO", 1).replaced("CMP_OFFSET_DEG", 10))
    for t_s in range(61, 123):
        take(estimator, float(t_s))
    expected_rad = 1.0 + math.radians(10.0) + declination_rad(0.6, 2.1, UTC_S)
    assert estimator.state.last_minute[1] == pytest.approx(expected_rad)
    assert sum(estimator.state.sectors) == 1


@pytest.mark.parametrize(
    ("times_s", "turn_deg", "is_used"),
    [
        (range(1, 16), 30.5, True),
        (range(1, 16), 32.5, False),
        (range(9, 46, 9), 40.0, True),
        (range(9, 46, 9), 42.0, False),
    ],
)
def test_turn_is_that_of_a_heading_smoothed_over_15_s(times_s, turn_deg, is_used):
    """The limit is 20 deg of the smoothed heading; a gap counts as 2 s."""
    estimator = DeviationEstimator(WEST)
    take(estimator, 0.0)
    for t_s in times_s:
        take(estimator, float(t_s), 1.0 + math.radians(turn_deg))
        take(estimator, float(t_s), 3.0, source=1)
        take(estimator, float(t_s), math.nan)
    assert (estimator.state.minute is not None) is is_used


def test_another_run_begins_another_minute_and_continues_the_time():
    estimator = DeviationEstimator(WEST)
    for t_s in (*range(40), *range(61)):
        take(estimator, float(t_s))
    assert estimator.state.t_s == 39.0 + 60.0
    assert sum(estimator.state.sectors) == 1


def test_implausible_variation_of_the_compass_is_replaced_by_the_declination():
    estimator = DeviationEstimator(WEST)
    for t_s in range(61):
        take(estimator, float(t_s), reference=NorthReference.TRUE, variation_rad=math.radians(12.0))
    assert estimator.state.last_minute[1] == pytest.approx(1.0 - math.radians(12.0 + 7.0))


def test_report_has_the_progress_and_the_sectors_with_data():
    estimator = DeviationEstimator(ParameterSet().replaced("CMP_DEV_B", 2.0))
    assert estimator.report().state is CalibrationState.RUNNING
    for t_s in range(61):
        take(estimator, float(t_s), 2.0)
    report, estimate = estimator.report(), estimator.result()
    assert (report.minutes, report.sectors, report.percent) == (1, 0b1000, int(75.0 / math.degrees(estimate.sd_rad)))
    assert report.present_rad == pytest.approx((0.0, math.radians(2.0), 0.0, 0.0, 0.0))
    assert (report.sd_rad, report.max_change_rad) == (estimate.sd_rad, estimate.off_rad)
    assert report.residual_before_rad is None
    # A certain estimate needs eight sectors.
    estimator.state = replace(estimator.state, p=(1e-9 * np.eye(8)).tobytes(), sectors=(1, 2, *(0,) * 10))
    assert (estimator.report().percent, estimator.report().minutes) == (25, 3)


@pytest.mark.parametrize(("minutes", "has_residual"), [(9, False), (10, True)])
def test_report_has_the_residual_of_ten_minutes_or_more(minutes, has_residual):
    estimator = DeviationEstimator(WEST)
    for t_s in range(61 * minutes + 40):
        take(estimator, float(t_s), 1.0 + 0.2 * (t_s // 61))
    estimator.state = replace(estimator.state, p=(1e-9 * np.eye(8)).tobytes(), sectors=(1,) * 12)
    report = estimator.report()
    assert (report.state, report.percent, report.minutes) == (CalibrationState.DONE, 100, 12)
    assert (report.residual_before_rad is not None) is has_residual
    assert (report.residual_after_rad is not None) is has_residual
