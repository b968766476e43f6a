"""Planar motion with sway and current."""

import math

import pytest

from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.ship.kt_plant import KtPlant
from hil.ship.manoeuvring import Manoeuvre, Motion, planar_rates, steady_turn
from hil.ship.planar import PlanarMotion, Tide
from hil.ship.regressions import FLOAT, SwayModel, sway_model

SWAY = sway_model(FLOAT)
RUDDER_RAD = math.radians(30.0)


def simulate(manoeuvre, rudder_rad, steps):
    for _ in range(steps):
        manoeuvre.step(rudder_rad)
    return manoeuvre.motion


def test_rates_follow_the_equations_of_the_paper():
    state = (5.0, 6.0, 0.7, 0.02, -0.1)
    rates = planar_rates(state, (0.3, 0.5, 0.2, -0.3, 0.05, 4.0, 17.0, 0.1, -0.25, -0.12))
    assert rates[0] == pytest.approx(0.5 * math.cos(0.7) + 0.1 * math.sin(0.7) + 0.2)
    assert rates[1] == pytest.approx(0.5 * math.sin(0.7) - 0.1 * math.cos(0.7) - 0.3)
    assert rates[2] == 0.02
    assert rates[3] == pytest.approx((0.05 * 0.2 - 0.02 - 17.0 * 0.02**3) / 4.0)
    assert rates[4] == pytest.approx(-0.25 * 0.02 + 0.12 * 0.1)


def test_boat_with_rudder_amidships_moves_straight_in_a_current():
    motion = simulate(Manoeuvre(OCEAN_RAMBLER, SWAY, 0.1, (0.1, -0.2)), 0.0, 1000)
    assert (motion.north_m, motion.east_m) == pytest.approx((50.0, -20.0))
    assert (motion.heading_rad, motion.yaw_rate_rad_s, motion.sway_m_s) == (0.0, 0.0, 0.0)


def test_heading_and_yaw_rate_equal_the_plant_to_the_last_bit():
    plant, manoeuvre = KtPlant(OCEAN_RAMBLER, 0.02), Manoeuvre(OCEAN_RAMBLER, None, 0.02)
    for number in range(2000):
        rudder_rad = RUDDER_RAD if number // 500 % 2 else -RUDDER_RAD
        plant.step(rudder_rad)
        motion = manoeuvre.step(rudder_rad)
        assert (motion.heading_rad, motion.yaw_rate_rad_s) == (plant.heading_rad, plant.yaw_rate_rad_s)


def test_track_without_sway_equals_the_plant():
    plant, track = KtPlant(OCEAN_RAMBLER, 0.02), PlanarMotion(0.4, Tide(math.hypot(0.1, 0.2), math.atan2(0.2, 0.1)))
    manoeuvre = Manoeuvre(OCEAN_RAMBLER, None, 0.02, (0.1, 0.2))
    for _ in range(5000):
        previous_rad = plant.heading_rad
        plant.step(RUDDER_RAD)
        track.step(0.5 * (previous_rad + plant.heading_rad), 0.0, 0.02)
        motion = manoeuvre.step(RUDDER_RAD)
    assert motion.sway_m_s == 0.0
    assert (motion.north_m, motion.east_m) == pytest.approx((track.north_m, track.east_m), abs=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_turn_converges_to_the_steady_turn(side):
    manoeuvre = Manoeuvre(OCEAN_RAMBLER, SWAY, 0.1)
    steady = steady_turn(OCEAN_RAMBLER, side * RUDDER_RAD, SWAY)
    start = simulate(manoeuvre, side * RUDDER_RAD, 2000)
    assert start.yaw_rate_rad_s == pytest.approx(steady.yaw_rate_rad_s)
    assert start.sway_m_s == pytest.approx(steady.sway_m_s)
    # Sway is outward, and half a turn later the boat is one diameter away.
    assert math.copysign(1.0, start.sway_m_s) == -side
    half_turn_s = math.pi / abs(steady.yaw_rate_rad_s)
    other = Manoeuvre(OCEAN_RAMBLER, SWAY, half_turn_s / 1000, start=start)
    end = simulate(other, side * RUDDER_RAD, 1000)
    across_m = math.hypot(end.north_m - start.north_m, end.east_m - start.east_m)
    assert across_m == pytest.approx(2.0 * steady.radius_m, rel=1e-6)
    assert math.tan(steady.drift_rad) == pytest.approx(start.sway_m_s / 0.4)


def test_steady_sway_equals_its_equation():
    turn = steady_turn(OCEAN_RAMBLER, RUDDER_RAD, SwayModel(200.0, 400.0, -125.0, ()))
    assert turn.sway_m_s == pytest.approx(200.0 * 0.4 * turn.yaw_rate_rad_s / -50.0)
    assert turn.radius_m == pytest.approx(math.hypot(0.4, turn.sway_m_s) / turn.yaw_rate_rad_s)


def test_rudder_at_the_offset_has_infinite_radius():
    turn = steady_turn(KtModel(0.049, 4.0, 17.0, 0.1, 0.4), 0.1, SWAY)
    assert (turn.yaw_rate_rad_s, turn.sway_m_s, turn.radius_m) == (0.0, 0.0, math.inf)


def test_half_the_step_gives_the_same_motion():
    coarse = simulate(Manoeuvre(OCEAN_RAMBLER, SWAY, 0.1), RUDDER_RAD, 1000)
    fine = simulate(Manoeuvre(OCEAN_RAMBLER, SWAY, 0.05), RUDDER_RAD, 2000)
    assert coarse.north_m == pytest.approx(fine.north_m, abs=1e-6)
    assert coarse.sway_m_s == pytest.approx(fine.sway_m_s, abs=1e-9)


def test_fast_sway_takes_more_inner_steps():
    fast = SwayModel(200.0, 1.0, -1000.0, ())
    motion = simulate(Manoeuvre(OCEAN_RAMBLER, fast, 0.1), RUDDER_RAD, 1000)
    assert motion.sway_m_s == pytest.approx(steady_turn(OCEAN_RAMBLER, RUDDER_RAD, fast).sway_m_s)


def test_invalid_model_is_rejected():
    with pytest.raises(ValueError, match="invalid ship model"):
        Manoeuvre(KtModel(0.049, 0.0, 17.0, 0.0, 0.4), None, 0.1)
    with pytest.raises(ValueError, match="no damping"):
        steady_turn(OCEAN_RAMBLER, RUDDER_RAD, SwayModel(200.0, 400.0, 0.0, ()))


def test_motion_starts_at_the_given_state():
    start = Motion(1.0, 2.0, 0.5, 0.0, 0.0)
    motion = Manoeuvre(OCEAN_RAMBLER, None, 1.0, start=start).step(0.0)
    assert motion.north_m == pytest.approx(1.0 + 0.4 * math.cos(0.5))
    assert motion.east_m == pytest.approx(2.0 + 0.4 * math.sin(0.5))
