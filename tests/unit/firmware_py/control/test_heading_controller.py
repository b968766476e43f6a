import math

import pytest

from firmware_py.common.parameter_table import TABLE as PARAMETERS
from firmware_py.common.parameters import ParameterSet, index_of
from firmware_py.control.heading_controller import (
    TABLE,
    HeadingControllerInput,
    HeadingControllerSettings,
    update,
)
from firmware_py.control.law import IDLE, Gains, LawState, Reference, s_surface
from firmware_py.model.heading_estimate import HeadingEstimate

ESTIMATE = HeadingEstimate(1.0, math.radians(0.3) ** 2, 0.01, 0.05, 0.05, 0.4, 0.02)
UNDER_WAY = LawState(Reference(1.0, 0.0))


def settings(mode):
    return HeadingControllerSettings.of(ParameterSet().replaced("CTL_MODE", mode))


def steered(mode, error_rad, *, estimate=ESTIMATE, state=UNDER_WAY, command_rad=0.0):
    return update(settings(mode), state, HeadingControllerInput(error_rad, 0.01, estimate, command_rad, 0.1))


def test_every_choice_of_the_parameter_has_its_controller():
    assert TABLE.keys() == PARAMETERS[index_of("CTL_MODE")].choices.keys()


@pytest.mark.parametrize("mode", TABLE)
@pytest.mark.parametrize("estimate", [ESTIMATE, None])
def test_an_error_to_starboard_gives_rudder_to_starboard(mode, estimate):
    assert steered(mode, 0.5, estimate=estimate)[1] > 0.1
    assert steered(mode, -0.5, estimate=estimate)[1] < -0.1


@pytest.mark.parametrize("mode", TABLE)
def test_without_an_estimate_the_fixed_gains_are_used_and_no_state_is_kept(mode):
    expected_rad = s_surface(Gains.of(ParameterSet()), 0.1, 0.01)
    assert steered(mode, 0.1, estimate=None) == (IDLE, expected_rad)


def test_fixed_gains_use_error_and_yaw_rate_alone():
    assert steered(0, 0.1) == steered(0, 0.1, estimate=None, state=IDLE, command_rad=0.3)


def test_the_scheduled_controller_keeps_its_reference():
    state, _ = steered(1, 0.5)
    assert state.reference != UNDER_WAY.reference
    again, _ = steered(1, 0.5, state=state)
    assert again.reference.yaw_rate_rad_s > state.reference.yaw_rate_rad_s > 0.0


def test_the_scheduled_controller_keeps_the_rudder_in_the_deadband_and_without_steerage_way():
    low_rad, high_rad = (steered(1, 0.001, command_rad=command_rad)[1] for command_rad in (-0.5, 0.5))
    assert low_rad < high_rad
    near_rad = 0.4 * low_rad + 0.6 * high_rad
    assert steered(1, 0.001, command_rad=near_rad)[1] == near_rad
    drifting = HeadingEstimate(1.0, 1e-5, 0.01, 0.05, 0.05, 0.01, 0.0)
    assert steered(1, 0.04, estimate=drifting, command_rad=-0.2)[1] == -0.2
