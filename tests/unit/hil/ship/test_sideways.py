"""Sway in a turn equals that of the equations in hil/ship/manoeuvring.py."""

from dataclasses import replace

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.ship.disturbances import Slide
from hil.ship.manoeuvring import Manoeuvre, steady_turn
from hil.ship.regressions import FLOAT, sway_model
from hil.ship.sideways import Sideways

STEP_S = 0.02


@pytest.mark.parametrize("speed_m_s", [0.4, 0.9])
def test_sway_equals_the_planar_equations(speed_m_s):
    model = OCEAN_RAMBLER.at_speed(speed_m_s)
    boat = Manoeuvre(model, sway_model(FLOAT), STEP_S)
    sideways = Sideways(None, Slide(), STEP_S)
    for number in range(3000):
        previous = boat.motion
        motion = boat.step(radians(20.0 if number < 1500 else -20.0))
        rate_rad_s = 0.5 * (previous.yaw_rate_rad_s + motion.yaw_rate_rad_s)
        assert sideways.step(0.0, rate_rad_s, speed_m_s) == pytest.approx(motion.sway_m_s, abs=1e-4)


def test_sway_is_to_port_in_a_turn_to_starboard():
    turn = steady_turn(OCEAN_RAMBLER, radians(20.0), sway_model(FLOAT))
    assert turn.sway_m_s < -0.001
    for share in (0.5, 2.0):
        sideways = Sideways(None, replace(Slide(), share=share), STEP_S)
        for _ in range(10_000):
            sway_m_s = sideways.step(0.0, turn.yaw_rate_rad_s, 0.4)
        assert sway_m_s == pytest.approx(share * turn.sway_m_s, rel=1e-6)
