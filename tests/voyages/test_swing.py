"""Estimation of the deviation of an uncorrected compass from the sensor data of a day of courses."""

import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import TWO_PI, clamp, degrees, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, HeadingSample, Inputs, NorthReference, PositionSample, Tick
from firmware_py.estimate.deviation_estimator import DeviationEstimator
from hil.ship.noise import NormalNumbers, Stream, generator
from support import rig
from support.plans import placed

LEG_S = 900.0
RESOLUTION_RAD = radians(0.1)


def estimate_after(name, seed, hours, leg_s=LEG_S):
    """Sail random courses with a controller that knows the true heading; return the estimator after all sensor data."""
    scenario, rng = rig.sea(name), random.Random(seed)
    hull, estimator = rig.FineHull(scenario, seed), DeviationEstimator(ParameterSet())
    noise, goal_rad, rudder_rad = NormalNumbers(generator(seed, Stream.COMPASS)), 0.0, 0.0
    for tick in range(round(hours * 36000)):
        t_s = 0.1 * tick
        if tick % round(10 * leg_s) == 0:
            goal_rad = rng.uniform(-math.pi, math.pi)
        error_rad = wrap_pi(goal_rad - hull.heading_low_rad(0.0))
        demand_rad = clamp(0.8 * error_rad - 6.0 * hull.yaw_rate_low_rad_s(0.0), -radians(30.0), radians(30.0))
        rudder_rad += clamp(demand_rad - rudder_rad, -radians(3.0), radians(3.0))
        compass_rad = hull.compass_heading_rad(0.0) + radians(0.3) * noise.draw()
        compass_rad = round(compass_rad / RESOLUTION_RAD) * RESOLUTION_RAD % TWO_PI
        fixes = ()
        if tick % 10 == 0:
            north, east = (speed_m_s + 0.03 * noise.draw() for speed_m_s in hull.velocity_in_waves_m_s(0.0))
            position = placed(*hull.position_in_waves_m(0.0))
            course_rad = math.atan2(east, north) % TWO_PI
            fixes = (PositionSample(t_s, FixType.FIX_3D, *position, 0.0, math.hypot(north, east), course_rad),)
        headings = (HeadingSample(t_s, compass_rad, NorthReference.TRUE),)
        estimator.take(Inputs(Tick(tick, t_s, 0.0, 0, 10.0), headings, fixes))
        hull.step(rudder_rad)
    return estimator


def truth_of(name):
    """Return A to E [deg] as a function of the compass heading; the scenario defines them by the true heading."""
    compass = rig.sea(name).disturbances.compass
    true_rad = np.linspace(0.0, TWO_PI, 720, endpoint=False)

    def terms(heading_rad):
        sines = (np.sin(heading_rad), np.cos(heading_rad), np.sin(2.0 * heading_rad), np.cos(2.0 * heading_rad))
        return np.stack([np.ones_like(heading_rad), *sines], axis=1)

    deviation = terms(true_rad) @ np.radians(
        [compass.a_deg, compass.b_deg, compass.c_deg, compass.d_deg, compass.e_deg]
    )
    return np.degrees(np.linalg.lstsq(terms(true_rad - deviation), deviation, rcond=None)[0])


def errors_of(estimator, name):
    return np.array([degrees(coefficient) for coefficient in estimator.result().coefficients_rad]) - truth_of(name)


def test_two_courses_are_not_enough_for_a_proposal():
    estimator = estimate_after("ocean-2", 1, 0.2, leg_s=360.0)
    assert sum(estimator.state.sectors) >= 5
    assert not estimator.result().ready


@pytest.mark.proof
@pytest.mark.timeout(7200)
def test_deviation_within_half_a_degree_after_a_day(figures):
    runs = [estimate_after("ocean-2", seed, 24.0) for seed in range(1, 6)]
    errors_deg = np.abs([errors_of(run, "ocean-2") for run in runs])
    print(np.round(errors_deg, 2), [np.round(np.degrees(run.result().sds_rad), 2) for run in runs])
    figures.keep("swing_error_95", float(np.quantile(errors_deg, 0.95)), "deg")
    figures.keep("swing_error_worst", float(errors_deg.max()), "deg")
    assert all(run.result().ready for run in runs)
    assert np.quantile(errors_deg, 0.95) <= 0.5
