import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import (
    OCEAN_RAMBLER,
    KtModel,
    decay_over,
    exact_step,
    held_cubic,
    rk4_step,
    settled_yaw_rate,
    steady_yaw_rate,
    yaw_acceleration,
)


@pytest.mark.parametrize(
    ("rudder_deg", "yaw_rate_deg_s"), [(10.0, 0.4894), (20.0, 0.9752), (30.0, 1.4541), (35.0, 1.6900)]
)
def test_steady_yaw_rates_of_the_tank_model(rudder_deg, yaw_rate_deg_s):
    """docs/explanation/physics.md, section 1."""
    rate_rad_s = steady_yaw_rate(math.radians(rudder_deg), 0.049, 17.0)
    assert math.degrees(rate_rad_s) == pytest.approx(yaw_rate_deg_s, abs=6e-5)


def test_turning_radius_at_full_rudder():
    assert 0.4 / steady_yaw_rate(math.radians(30.0), 0.049, 17.0) == pytest.approx(15.76, abs=0.005)


@given(st.floats(-1.0, 1.0), st.floats(1e-4, 20.0), st.floats(0.0, 1e6))
def test_steady_yaw_rate_solves_its_equation(rudder_rad, ability_1_s, norrbin_s2):
    rate_rad_s = steady_yaw_rate(rudder_rad, ability_1_s, norrbin_s2)
    assert rate_rad_s + norrbin_s2 * rate_rad_s**3 == pytest.approx(ability_1_s * rudder_rad, rel=1e-9, abs=1e-15)


def test_similarity_is_that_of_the_paper():
    fast = OCEAN_RAMBLER.at_speed(0.8)
    assert (fast.turning_ability_1_s, fast.turning_lag_s, fast.norrbin_s2) == pytest.approx((0.098, 2.0, 4.25))
    assert fast[3:] == (0.0, 0.8)


def test_rk4_step_agrees_with_the_exact_linear_solution():
    heading_rad, rate_rad_s = 0.0, 0.0
    for _ in range(200):
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, 0.3, 0.05, 0.049, 4.0, 0.0, 0.02)
    drive_rad_s = 0.049 * 0.28
    decay = math.exp(-10.0 / 4.0)
    assert rate_rad_s == pytest.approx(drive_rad_s * (1.0 - decay), rel=1e-8)
    assert heading_rad == pytest.approx(drive_rad_s * (10.0 - 4.0 * (1.0 - decay)), rel=1e-8)


def test_default_parameters_are_those_of_the_tank():
    # Within the single precision of parameters.
    assert tuple(KtModel.of(ParameterSet())) == pytest.approx(tuple(OCEAN_RAMBLER), rel=1e-7)


def test_single_exact_step_equals_many_small_steps():
    steady, lag_s = 0.03, 4.0
    turned, rate = exact_step(-0.01, steady, decay_over(20.0, lag_s), 20.0, lag_s)
    heading, small_step_rate = 0.0, -0.01
    for _ in range(400):
        heading, small_step_rate = rk4_step(heading, small_step_rate, steady / 0.049, 0.05, 0.049, lag_s, 0.0, 0.0)
    assert (turned, rate) == pytest.approx((heading, small_step_rate), rel=1e-8)
    assert rate == settled_yaw_rate(-0.01, steady, decay_over(20.0, lag_s))


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.0, 1e9), st.floats(1e-3, 1e4))
def test_exact_step_of_any_length_ends_between_initial_and_steady_rate(rate, steady, step_s, lag_s):
    _, final = exact_step(rate, steady, decay_over(step_s, lag_s), step_s, lag_s)
    assert min(rate, steady) - 1e-16 <= final <= max(rate, steady) + 1e-16


def test_yaw_acceleration_has_the_terms_of_the_equation():
    expected_rad_s2 = (0.049 * 0.2 - 0.02 - 17.0 * 0.02**3) / 4.0
    assert yaw_acceleration(0.02, 0.3, 0.049, 4.0, 17.0, 0.1) == pytest.approx(expected_rad_s2)


@pytest.mark.parametrize("lag_s", [0.05, 4.0, 5000.0])
@pytest.mark.parametrize("norrbin_s2", [0.0, 17.0, 1e6, 1e12])
@pytest.mark.parametrize("step_s", [0.02, 0.1, 5.0, 600.0])
def test_step_with_constant_cubic_term_is_stable_and_converges_to_the_steady_rate(lag_s, norrbin_s2, step_s):
    ability_1_s, rudder_rad, rate, max_rate = 20.0, 0.5, 3.0, 0.0
    for _ in range(300):
        divisor, cubic, _ = held_cubic(lag_s, norrbin_s2, rate, step_s)
        drive, lag = (ability_1_s * rudder_rad - cubic * rate) / divisor, lag_s / divisor
        _, rate = exact_step(rate, drive, decay_over(step_s, lag), step_s, lag)
        max_rate = max(max_rate, abs(rate))
    assert max_rate <= ability_1_s * rudder_rad
    if 300 * step_s > 20.0 * lag_s:
        assert rate == pytest.approx(steady_yaw_rate(rudder_rad, ability_1_s, norrbin_s2), rel=1e-3)


def test_cubic_term_is_not_linearised_for_a_usual_boat():
    for rate_rad_s in (0.0, 0.02, 0.1, -0.3):
        cubic = 17.0 * rate_rad_s * rate_rad_s
        assert held_cubic(4.0, 17.0, rate_rad_s, 0.1) == (1.0, cubic, 3.0 * cubic)


def test_extreme_yaw_rate_is_reduced():
    divisor, cubic, slope = held_cubic(4.0, 17.0, 1e200, 0.1)
    assert (divisor, cubic, slope) == (1.0 + 3e9, -2e9, 0.0)
    assert 0.0 < -cubic * 1e200 / divisor < 1e200
