"""Facts of the K-T equation and its scaling from docs/explanation/physics.md."""

import math

import pytest

from firmware_py.model.kt import OCEAN_RAMBLER, KtModel, rk4_step, steady_yaw_rate
from hil.ship.manoeuvring import steady_turn


def test_turning_radius_in_the_tank_is_less_than_in_the_sea_trial():
    assert KtModel(0.049, 4.0, 17.0, 0.0, 0.4) == OCEAN_RAMBLER
    turn = steady_turn(OCEAN_RAMBLER, math.radians(30.0))
    assert turn.radius_m == pytest.approx(15.76, abs=0.005)
    # The paper reports 20 to 30 m from a GPS track in waves.
    assert turn.radius_m < 20.0


def test_alpha_changes_the_turn_by_one_percent():
    rate = steady_yaw_rate(math.radians(30.0), 0.049, 17.0)
    assert 17.0 * rate**3 / rate == pytest.approx(0.011, abs=0.001)


@pytest.mark.parametrize("speed_m_s", [0.1, 0.2, 0.7, 1.5, 3.0])
def test_dimensionless_numbers_and_paths_do_not_depend_on_the_speed(speed_m_s):
    scaled, length_m = OCEAN_RAMBLER.at_speed(speed_m_s), 3.05
    for name, power in (("turning_ability_1_s", 1), ("turning_lag_s", -1), ("norrbin_s2", -2)):
        number = getattr(scaled, name) * (length_m / speed_m_s) ** power
        nominal = getattr(OCEAN_RAMBLER, name) * (length_m / 0.4) ** power
        assert number == pytest.approx(nominal)
    # As a function of the distance run, the heading is that in the tank.
    nominal_state, state = (0.0, 0.0), (0.0, 0.0)
    ratio = speed_m_s / 0.4
    model = (scaled.turning_ability_1_s, scaled.turning_lag_s, scaled.norrbin_s2, 0.0)
    for _ in range(500):
        nominal_state = rk4_step(*nominal_state, 0.5, 0.1, 0.049, 4.0, 17.0, 0.0)
        state = rk4_step(*state, 0.5, 0.1 / ratio, *model)
    assert state == pytest.approx((nominal_state[0], nominal_state[1] * ratio))


@pytest.mark.parametrize(
    ("speed_m_s", "ability_1_s", "lag_s"), [(0.5, 0.027, 6.0), (1.0, 0.107, 5.0), (1.5, 0.238, 1.5)]
)
def test_scaled_parameters_are_near_those_of_another_wave_glider(speed_m_s, ability_1_s, lag_s):
    scaled = OCEAN_RAMBLER.at_speed(speed_m_s)
    assert 0.4 < scaled.turning_ability_1_s / ability_1_s < 2.5
    assert 0.3 < scaled.turning_lag_s / lag_s < 1.0
