import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import Gains, s_surface
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

PAPER_GAINS = Gains.of(ParameterSet())
LIMIT_RAD = math.radians(30.0)


def test_default_gains_are_those_of_the_paper():
    assert (PAPER_GAINS.k1, PAPER_GAINS.k2) == (40.0, pytest.approx(0.3))
    assert PAPER_GAINS.rudder_limit_rad == pytest.approx(LIMIT_RAD)
    assert math.degrees(PAPER_GAINS.yaw_rate_max_rad_s) == pytest.approx(1.4541, abs=2e-4)


def test_s_surface_equals_the_logistic_form_of_the_paper():
    error_rad, rate_rad_s = 0.1, 0.01
    exponent = 40.0 * error_rad / math.pi - PAPER_GAINS.k2 * rate_rad_s / PAPER_GAINS.yaw_rate_max_rad_s
    expected = LIMIT_RAD * (2.0 / (1.0 + math.exp(-exponent)) - 1.0)
    assert s_surface(PAPER_GAINS, error_rad, rate_rad_s) == pytest.approx(expected, rel=1e-12)


@given(st.floats(-math.pi, math.pi), st.floats(-10.0, 10.0))
def test_s_surface_is_odd_and_limited(error_rad, rate_rad_s):
    demand_rad = s_surface(PAPER_GAINS, error_rad, rate_rad_s)
    assert abs(demand_rad) <= PAPER_GAINS.rudder_limit_rad
    assert s_surface(PAPER_GAINS, -error_rad, -rate_rad_s) == -demand_rad


@given(st.floats(-3.0, 3.0), st.floats(0.0, 0.1), st.floats(-0.05, 0.05))
def test_larger_error_never_gives_less_rudder(error_rad, more_rad, rate_rad_s):
    assert s_surface(PAPER_GAINS, error_rad + more_rad, rate_rad_s) >= s_surface(PAPER_GAINS, error_rad, rate_rad_s)


@pytest.mark.parametrize(("step_deg", "overshoot_percent"), [(30.0, 1.6), (90.0, 0.6)])
def test_overshoot_without_noise_is_that_of_the_paper(step_deg, overshoot_percent):
    """docs/explanation/physics.md, section 4: 1.6 % for a step of 30 deg, 0.6 % for 90 deg."""
    model, goal_rad = OCEAN_RAMBLER[:3], math.radians(step_deg)
    heading_rad = rate_rad_s = max_rad = 0.0
    for _ in range(30_000):
        rudder_rad = s_surface(PAPER_GAINS, goal_rad - heading_rad, rate_rad_s)
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, rudder_rad, 0.01, *model, 0.0)
        max_rad = max(max_rad, heading_rad)
    assert 100.0 * (max_rad / goal_rad - 1.0) == pytest.approx(overshoot_percent, abs=0.1)
