"""Facts of the K-T equation and its scaling from docs/explanation/physics.md."""

import math

import pytest

from firmware_py.model.kt import OCEAN_RAMBLER, KtModel, rk4_step, steady_yaw_rate
from hil.ship.manoeuvring import steady_turn


def test_parameters_of_the_paper():
    assert KtModel(0.049, 4.0, 17.0, 0.0, 0.4) == OCEAN_RAMBLER


@pytest.mark.parametrize(("rudder_deg", "rate_deg_s"), [(10.0, 0.4894), (20.0, 0.9752), (30.0, 1.4541), (35.0, 1.6900)])
def test_steady_turns(rudder_deg, rate_deg_s):
    rate = math.degrees(steady_yaw_rate(math.radians(rudder_deg), 0.049, 17.0))
    assert rate == pytest.approx(rate_deg_s, abs=5e-5)


def test_turning_radius_in_the_tank():
    turn = steady_turn(OCEAN_RAMBLER, math.radians(30.0))
    assert turn.radius_m == pytest.approx(15.76, abs=0.005)
    # The paper's 20 to 30 m from a GPS track in waves is not met, and not to be tuned away.
    assert turn.radius_m < 20.0


def test_alpha_changes_the_turn_by_one_percent():
    rate = steady_yaw_rate(math.radians(30.0), 0.049, 17.0)
    assert 17.0 * rate**3 / rate == pytest.approx(0.011, abs=0.001)


def test_similarity_at_twice_the_speed():
    fast = OCEAN_RAMBLER.at_speed(0.8)
    assert (fast.turning_ability_1_s, fast.turning_lag_s, fast.norrbin_s2) == pytest.approx((0.098, 2.0, 4.25))


@pytest.mark.parametrize("speed_m_s", [0.1, 0.2, 0.7, 1.5, 3.0])
def test_dimensionless_numbers_and_paths_are_the_same_at_all_speeds(speed_m_s):
    scaled, length_m = OCEAN_RAMBLER.at_speed(speed_m_s), 3.05
    for name, power in (("turning_ability_1_s", 1), ("turning_lag_s", -1), ("norrbin_s2", -2)):
        ours = getattr(scaled, name) * (length_m / speed_m_s) ** power
        theirs = getattr(OCEAN_RAMBLER, name) * (length_m / 0.4) ** power
        assert ours == pytest.approx(theirs)
    # In metres run instead of seconds it turns as in the tank: so does the simulation.
    tank, here = (0.0, 0.0), (0.0, 0.0)
    ratio = speed_m_s / 0.4
    model = (scaled.turning_ability_1_s, scaled.turning_lag_s, scaled.norrbin_s2, 0.0)
    for _ in range(500):
        tank = rk4_step(*tank, 0.5, 0.1, 0.049, 4.0, 17.0, 0.0)
        here = rk4_step(*here, 0.5, 0.1 / ratio, *model)
    assert here == pytest.approx((tank[0], tank[1] * ratio))


@pytest.mark.parametrize(
    ("speed_m_s", "ability_1_s", "lag_s"), [(0.5, 0.027, 6.0), (1.0, 0.107, 5.0), (1.5, 0.238, 1.5)]
)
def test_published_parameters_of_another_wave_glider(speed_m_s, ability_1_s, lag_s):
    scaled = OCEAN_RAMBLER.at_speed(speed_m_s)
    assert 0.4 < scaled.turning_ability_1_s / ability_1_s < 2.5
    assert 0.3 < scaled.turning_lag_s / lag_s < 1.0
