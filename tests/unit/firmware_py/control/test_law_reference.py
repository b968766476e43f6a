import math

import pytest

from firmware_py.common.angles import wrap_pi
from firmware_py.control.law import Reference, Ship, advance_reference, stopping_angle
from firmware_py.model.kt import OCEAN_RAMBLER

LEAD_RAD = math.radians(6.0)
REDUCED_TURN_S = 1.2

LIMIT_RAD = math.radians(30.0)


def ship_at(speed_m_s, bias_rad=0.0):
    model = OCEAN_RAMBLER.at_speed(speed_m_s)
    return Ship(model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, LIMIT_RAD, bias_rad)


def simulate_turn(ship, step_deg, seconds, step_s=0.1, gain_reduction=1.0):
    """Return headings and rudder angles [rad] of the reference for a boat that follows it exactly."""
    reference, goal = Reference(0.0, 0.0), math.radians(step_deg)
    headings, rudders, unwrapped = [], [], 0.0
    for _ in range(round(seconds / step_s)):
        previous_rad = reference.heading_rad
        reference = advance_reference(ship, reference, goal - unwrapped, reference.heading_rad, step_s, gain_reduction)
        unwrapped += wrap_pi(reference.heading_rad - previous_rad)
        headings.append(unwrapped)
        rudders.append(reference.feedforward_rad + ship.bias_rad)
    return headings, rudders


@pytest.mark.parametrize("speed_m_s", [0.2, 0.4, 0.9, 1.2])
@pytest.mark.parametrize("step_deg", [-170.0, -90.0, 10.0, 60.0])
@pytest.mark.parametrize("bias_deg", [0.0, 5.0])
def test_reference_reaches_the_goal_without_overshoot(speed_m_s, step_deg, bias_deg):
    ship = ship_at(speed_m_s, math.radians(bias_deg))
    headings, rudders = simulate_turn(ship, step_deg, 260.0)
    goal = math.radians(step_deg)
    assert headings[-1] == pytest.approx(goal, abs=math.radians(0.1))
    assert max(heading / goal for heading in headings) < 1.0 + 0.5 / abs(step_deg)
    assert max(abs(rudder) for rudder in rudders) <= LIMIT_RAD + 1e-12


def test_reference_of_a_60_deg_turn_in_the_tank_reaches_55_deg_in_less_than_43_5_s():
    headings, _ = simulate_turn(ship_at(0.4), 60.0, 60.0)
    ticks = next(index for index, heading in enumerate(headings) if heading >= math.radians(55.0))
    assert 0.1 * ticks < 43.5


@pytest.mark.parametrize("gain_reduction", [2.0, 4.0, 8.0])
def test_reference_with_reduced_gain_turns_with_less_rudder(gain_reduction):
    """It turns by at most LEAD_RAD in REDUCED_TURN_S per 1 of gain reduction above 1."""
    ship = ship_at(0.4)
    headings, rudders = simulate_turn(ship, 100.0, 400.0, gain_reduction=gain_reduction)
    assert headings[-1] == pytest.approx(math.radians(100.0), abs=math.radians(0.5))
    max_rate_rad_s = min(LEAD_RAD / ((gain_reduction - 1.0) * REDUCED_TURN_S), ship.turning_ability_1_s * LIMIT_RAD)
    assert ship.turning_ability_1_s * max(rudders) == pytest.approx(max_rate_rad_s, rel=1e-9)


@pytest.mark.parametrize("step_s", [0.02, 1.0])
def test_reference_is_stable_at_other_loop_rates(step_s):
    headings, _ = simulate_turn(ship_at(1.2), 60.0, 100.0, step_s)
    assert headings[-1] == pytest.approx(math.radians(60.0), abs=math.radians(0.5))
    assert max(headings) < math.radians(62.0)


def test_stopping_angle_solves_the_k_t_equation():
    ship, rate_rad_s, angle_rad, brake_rad = ship_at(0.4), 0.02, 0.0, 0.4
    expected_rad = stopping_angle(ship, rate_rad_s, brake_rad)
    while rate_rad_s > 0.0:
        angle_rad += rate_rad_s * 0.001
        rate_rad_s += 0.001 * (-ship.turning_ability_1_s * brake_rad - rate_rad_s) / ship.turning_lag_s
    assert angle_rad == pytest.approx(expected_rad, rel=1e-2)
    assert stopping_angle(ship, -0.02, brake_rad) == -expected_rad


def test_lead_over_a_boat_that_does_not_follow_is_limited():
    ship, reference = ship_at(0.4), Reference(0.0, 0.0)
    for gain_reduction in (1.0, 4.0):
        for _ in range(600):
            error_rad = 1.0 - reference.heading_rad
            reference = advance_reference(ship, reference, error_rad, 0.0, 0.1, gain_reduction)
        assert reference.heading_rad == pytest.approx(gain_reduction * LEAD_RAD)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_feedforward_is_at_least_5_deg_whatever_the_bias(sign):
    """With a bias of the whole rudder angle, a wrong one, the boat could otherwise not turn to this side."""
    reference = advance_reference(ship_at(0.4, sign * LIMIT_RAD), Reference(0.0, 0.0), sign * 1.0, 0.0, 0.1, 1.0)
    assert reference.feedforward_rad == pytest.approx(sign * math.radians(5.0))
    small_bias_rad = sign * math.radians(24.0)
    reference = advance_reference(ship_at(0.4, small_bias_rad), Reference(0.0, 0.0), sign * 1.0, 0.0, 0.1, 1.0)
    assert reference.feedforward_rad == pytest.approx(sign * math.radians(6.0))


@pytest.mark.parametrize("rate_rad_s", [0.01, -0.01])
def test_rudder_at_the_stopping_angle_brakes_with_a_share_of_the_yaw_rate(rate_rad_s):
    """The stopping angle is that of 80 % of the rudder against the turn; there, 55 % of the steady rudder brake."""
    bias_rad = math.radians(4.0)
    ship = ship_at(0.4, bias_rad)
    brake_rad = 0.8 * (LIMIT_RAD + math.copysign(bias_rad, rate_rad_s))
    error_rad = stopping_angle(ship, rate_rad_s, brake_rad)
    reference = advance_reference(ship, Reference(0.0, rate_rad_s), error_rad, 0.0, 0.1, 1.0)
    assert reference.feedforward_rad == pytest.approx(-0.55 * rate_rad_s / ship.turning_ability_1_s)


def test_rudder_is_proportional_below_a_remaining_angle_of_5_6_deg():
    reference = advance_reference(ship_at(0.4), Reference(0.0, 0.0), math.radians(2.8), 0.0, 0.1, 1.0)
    assert reference.feedforward_rad == pytest.approx(0.5 * LIMIT_RAD)
