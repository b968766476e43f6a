import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.control import law
from firmware_py.control.law import DEFAULT_CONSTANTS, IDLE, LawSettings, Reference, gains_of, s_surface, ship_at_speed
from firmware_py.model.heading_estimate import HeadingEstimate
from firmware_py.model.kt import scaled

REDUCED_BIAS_S = 25.0

SETTINGS = LawSettings.of(ParameterSet())
ESTIMATE = HeadingEstimate(
    heading_rad=1.0,
    correction_rad2_s=math.radians(0.3) ** 2,
    yaw_rate_rad_s=0.0,
    bias_rad=0.05,
    bias_mean_rad=0.05,
    speed_m_s=0.4,
    speed_sd_m_s=0.02,
)
LIMIT_RAD = math.radians(30.0)


def demand_of(reference, estimate, error_rad, step_s=0.1, gain_reduction=1.0):
    return law.demand(SETTINGS, reference, estimate, estimate.bias_rad, error_rad, step_s, gain_reduction)


def reference_at(estimate):
    return Reference(estimate.heading_rad, estimate.yaw_rate_rad_s)


def test_demand_at_the_goal_is_the_bias():
    _, demand_rad, _ = demand_of(reference_at(ESTIMATE), ESTIMATE, 0.0)
    assert demand_rad == pytest.approx(0.05, abs=1e-9)


def test_model_is_scaled_to_the_estimated_speed():
    model = SETTINGS.model
    ship = ship_at_speed(SETTINGS, ESTIMATE._replace(speed_m_s=2.0 * model.speed_m_s), 0.05)
    assert ship.turning_ability_1_s == pytest.approx(2.0 * model.turning_ability_1_s)
    assert ship.turning_lag_s == pytest.approx(0.5 * model.turning_lag_s)


def test_law_is_the_optimal_regulator_for_small_errors():
    ship, gain = ship_at_speed(SETTINGS, ESTIMATE, 0.05), 1.7
    gains = gains_of(ship, gain)
    error_gain = s_surface(gains, 1e-5, 0.0) / 1e-5
    rate_gain = -s_surface(gains, 0.0, 1e-6) / 1e-6
    k, t = ship.turning_ability_1_s, ship.turning_lag_s
    assert error_gain == pytest.approx(gain, rel=1e-6)
    # Algebraic Riccati equation for the minimum of the integral of error^2 + (rudder / gain)^2.
    assert k * rate_gain**2 + 2.0 * rate_gain == pytest.approx(2.0 * t * gain, rel=1e-6)


def test_reduced_gain_gives_less_rudder_and_a_narrower_deadband():
    on_goal = Reference(ESTIMATE.heading_rad + 0.02, 0.0)
    _, full_rad, full_deadband_rad = demand_of(on_goal, ESTIMATE, 0.02)
    _, reduced_rad, reduced_deadband_rad = demand_of(on_goal, ESTIMATE, 0.02, gain_reduction=4.0)
    bias_rad = ESTIMATE.bias_rad
    assert 0.0 < reduced_rad - bias_rad < 0.4 * (full_rad - bias_rad)
    assert reduced_deadband_rad <= full_deadband_rad


def test_gain_of_a_slow_boat_is_limited_by_the_nominal_ability_only_while_it_is_reduced():
    slow = ESTIMATE._replace(speed_m_s=0.2, correction_rad2_s=math.radians(1.5) ** 2)
    demands_rad = [
        demand_of(Reference(slow.heading_rad + 1e-3, 0.0), slow, 1e-3, gain_reduction=reduction)[1] - slow.bias_rad
        for reduction in (1.0, 1.0 + 1e-9)
    ]
    assert demands_rad[0] > 1.2 * demands_rad[1] > 0.0


def simulate_turn(gain_reduction, delay_s=0.0, lag_ratio=1.0, seconds=300.0):
    """Return the headings [deg] of a boat in a turn of 100 deg, with a delay and a multiple of the model's lag."""
    heading_rad = rate_rad_s = command_rad = 0.0
    delayed_rad, headings, state = [0.0] * round(10.0 * delay_s), [], IDLE
    k, lag_s, _ = scaled(SETTINGS.model, 0.4 / SETTINGS.model.speed_m_s)
    for _ in range(round(10.0 * seconds)):
        estimate = ESTIMATE._replace(
            heading_rad=heading_rad, yaw_rate_rad_s=rate_rad_s, bias_rad=0.0, bias_mean_rad=0.0
        )
        error_rad = math.radians(100.0) - heading_rad
        state, command_rad = law.steer(SETTINGS, state, estimate, error_rad, command_rad, 0.1, gain_reduction)
        delayed_rad.append(command_rad)
        rate_rad_s += 0.1 * (k * delayed_rad.pop(0) - rate_rad_s) / (lag_ratio * lag_s)
        heading_rad += 0.1 * rate_rad_s
        headings.append(math.degrees(heading_rad))
    return headings


def test_turn_with_reduced_gain_takes_at_most_2_2_times_as_long():
    """With the feedforward rudder also divided by the gain reduction, it took five times as long."""
    reduced, full = simulate_turn(8.0), simulate_turn(1.0)
    assert sum(heading < 95.0 for heading in reduced) <= 2.2 * sum(heading < 95.0 for heading in full)
    assert max(reduced) < 102.0


@pytest.mark.parametrize(("delay_s", "lag_ratio"), [(12.0, 1.0), (8.0, 3.0)])
def test_reduced_gain_turns_a_delayed_boat_without_oscillation(delay_s, lag_ratio):
    assert max(simulate_turn(1.0, delay_s, lag_ratio)) > 112.0
    headings = simulate_turn(8.0, delay_s, lag_ratio)
    assert max(headings) < 108.0
    assert headings[-1] == pytest.approx(100.0, abs=1.5)


def test_bias_with_reduced_gain_starts_at_the_mean_and_follows_slowly():
    """From the estimated bias of an oscillating boat, the heading error would be 14 deg for ten minutes."""
    state, _ = law.steer(SETTINGS, IDLE, ESTIMATE._replace(bias_rad=-0.24), 0.0, 0.0, step_s=1.0, gain_reduction=3.0)
    assert state.bias_rad == ESTIMATE.bias_mean_rad
    other = ESTIMATE._replace(bias_rad=0.15)
    for _ in range(100):
        state, _ = law.steer(SETTINGS, state, other, 0.0, 0.0, step_s=1.0, gain_reduction=3.0)
    assert state.bias_rad == pytest.approx(0.15 - 0.1 * math.exp(-100.0 / (2.0 * REDUCED_BIAS_S)), abs=1e-3)
    assert math.isnan(law.steer(SETTINGS, state, other, 0.0, 0.0, step_s=1.0, gain_reduction=1.0)[0].bias_rad)


SLOW = ESTIMATE._replace(speed_m_s=0.05, speed_sd_m_s=0.02)


def test_command_stays_the_same_at_the_goal_without_steerage_way():
    assert law.is_too_slow(SETTINGS, SLOW, 0.04)
    state, command_rad = law.steer(SETTINGS, IDLE, SLOW, 0.04, 0.3, 0.1, 1.0)
    assert (state.reference, command_rad) == (reference_at(SLOW), 0.3)
    assert math.isnan(state.bias_rad)
    at_minimum = SLOW._replace(speed_m_s=SETTINGS.min_speed_m_s, speed_sd_m_s=0.0)
    assert not law.is_too_slow(SETTINGS, at_minimum, 0.04)
    # With an uncertain speed the boat may be fast enough.
    assert not law.is_too_slow(SETTINGS, SLOW._replace(speed_sd_m_s=0.3), 0.04)


@pytest.mark.parametrize("error_rad", [0.5, -0.5, math.pi, -math.pi])
def test_turn_is_commanded_without_steerage_way(error_rad):
    """Otherwise the rudder would stay the same, even against the turn, until the estimated speed rises."""
    assert not law.is_too_slow(SETTINGS, SLOW, error_rad)
    reference = reference_at(SLOW)
    for _ in range(51):
        reference, demand_rad, _ = demand_of(reference, SLOW, error_rad)
    assert demand_rad == pytest.approx(math.copysign(LIMIT_RAD, error_rad), abs=0.05)


def test_turn_of_half_a_circle_has_the_commanded_direction():
    for sign in (1.0, -1.0):
        reference = reference_at(ESTIMATE)
        for _ in range(51):
            reference, demand_rad, _ = demand_of(reference, ESTIMATE, sign * math.pi)
        assert math.copysign(1.0, demand_rad) == sign
        assert abs(demand_rad) == pytest.approx(LIMIT_RAD, abs=0.01)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_command_changes_only_at_the_edge_of_the_deadband(command_rad, error_rad):
    _, demand_rad, deadband_rad = demand_of(reference_at(ESTIMATE), ESTIMATE, error_rad)
    _, next_rad = law.steer(SETTINGS, IDLE, ESTIMATE, error_rad, command_rad, step_s=0.1, gain_reduction=1.0)
    assert abs(next_rad - demand_rad) <= deadband_rad + 1e-12
    if abs(command_rad - demand_rad) <= deadband_rad:
        assert next_rad == pytest.approx(command_rad, abs=1e-12)
    else:
        assert abs(next_rad - demand_rad) == pytest.approx(deadband_rad, abs=1e-12)
        assert min(command_rad, demand_rad) - 1e-12 <= next_rad <= max(command_rad, demand_rad) + 1e-12


@given(
    st.floats(-math.pi, math.pi),
    st.floats(-0.2, 0.2),
    st.floats(-0.4, 0.4),
    st.floats(0.08, 2.5),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_demand_stays_within_the_limits_with_any_estimate(
    error_rad, yaw_rate_rad_s, bias_rad, speed_m_s, correction_rad_sqrt_s, step_s
):
    correction_rad2_s = correction_rad_sqrt_s * correction_rad_sqrt_s
    estimate = HeadingEstimate(2.0, correction_rad2_s, yaw_rate_rad_s, bias_rad, bias_rad, speed_m_s, 0.1)
    reference = reference_at(estimate)
    for _ in range(4):
        reference, demand_rad, deadband_rad = demand_of(reference, estimate, error_rad, step_s)
        # The deadband is at most 3.3 deg of heading error times the proportional gain, which grows as the speed falls.
        ability_1_s = scaled(SETTINGS.model, speed_m_s / SETTINGS.model.speed_m_s)[0]
        max_deadband_rad = math.radians(3.3) * DEFAULT_CONSTANTS.crossover_rad_s / ability_1_s
        assert abs(demand_rad) <= LIMIT_RAD
        assert 0.0 < deadband_rad < max_deadband_rad
        assert math.isfinite(reference.heading_rad)
        assert math.isfinite(reference.yaw_rate_rad_s)


@pytest.mark.parametrize(("error_deg", "share"), [(3.0, 1.0), (-3.0, 1.0), (3.01, 0.1), (-3.01, 0.1)])
def test_deadband_is_a_tenth_in_a_turn_of_more_than_3_deg(error_deg, share):
    _, _, deadband_at_goal_rad = demand_of(reference_at(ESTIMATE), ESTIMATE, 0.0)
    _, _, deadband_rad = demand_of(reference_at(ESTIMATE), ESTIMATE, math.radians(error_deg))
    assert deadband_rad == pytest.approx(share * deadband_at_goal_rad)


def test_boat_without_steerage_way_has_a_demand_from_an_error_of_3_deg():
    assert law.is_too_slow(SETTINGS, SLOW, math.radians(-3.0))
    assert not law.is_too_slow(SETTINGS, SLOW, math.radians(3.01))


@pytest.mark.parametrize(("mean_rad", "start_rad"), [(0.2, 0.2), (-0.2, -0.2), (0.24, -0.24), (0.25, -0.24)])
def test_reduced_bias_starts_at_the_smaller_of_mean_and_estimate(mean_rad, start_rad):
    estimate = ESTIMATE._replace(bias_rad=-0.24, bias_mean_rad=mean_rad)
    assert law.update_reduced_bias(math.nan, estimate, step_s=1.0, gain_reduction=3.0) == start_rad
    assert math.isnan(law.update_reduced_bias(0.1, estimate, step_s=1.0, gain_reduction=1.0))


def test_turn_beyond_half_a_circle_is_not_wrapped():
    """An error of pi is that of a commanded turn by more; the reference is ahead of the boat already."""
    ahead = Reference(ESTIMATE.heading_rad - 0.05, 0.0)
    _, long_turn_rad, _ = demand_of(ahead, ESTIMATE, math.pi)
    _, short_turn_rad, _ = demand_of(ahead, ESTIMATE, math.pi - 0.01)
    assert long_turn_rad > 0.1
    assert short_turn_rad < 0.0
