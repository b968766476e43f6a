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

ESTIMATE = HeadingEstimate(
    heading_rad=1.0,
    correction_rad2_s=math.radians(0.3) ** 2,
    yaw_rate_rad_s=0.01,
    bias_rad=0.05,
    bias_mean_rad=0.05,
    speed_m_s=0.4,
    speed_sd_m_s=0.02,
)
INITIAL_STATE = LawState(Reference(1.0, 0.0))


def settings(mode):
    return HeadingControllerSettings.of(ParameterSet().replaced("CTL_MODE", mode))


def steer(mode, error_rad, *, estimate=ESTIMATE, state=INITIAL_STATE, command_rad=0.0):
    inputs = HeadingControllerInput(error_rad, 0.01, estimate, command_rad, step_s=0.1, gain_reduction=1.0)
    return update(settings(mode), state, inputs)


def test_each_choice_of_ctl_mode_has_a_controller():
    assert TABLE.keys() == PARAMETERS[index_of("CTL_MODE")].choices.keys()


@pytest.mark.parametrize("mode", TABLE)
@pytest.mark.parametrize("estimate", [ESTIMATE, None])
def test_rudder_has_the_sign_of_the_error(mode, estimate):
    assert steer(mode, 0.5, estimate=estimate)[1] > 0.1
    assert steer(mode, -0.5, estimate=estimate)[1] < -0.1


@pytest.mark.parametrize("mode", TABLE)
def test_fixed_gains_without_a_state_are_used_without_an_estimate(mode):
    expected_rad = s_surface(Gains.of(ParameterSet()), 0.1, 0.01)
    assert steer(mode, 0.1, estimate=None) == (IDLE, expected_rad)


def test_fixed_gains_depend_on_error_and_yaw_rate_only():
    assert steer(0, 0.1) == steer(0, 0.1, estimate=None, state=IDLE, command_rad=0.3)


def test_scheduled_controller_advances_its_reference():
    state, _ = steer(1, 0.5)
    assert state.reference != INITIAL_STATE.reference
    later, _ = steer(1, 0.5, state=state)
    assert later.reference.yaw_rate_rad_s > state.reference.yaw_rate_rad_s > 0.0


def test_scheduled_controller_keeps_the_command_in_the_deadband_and_at_low_speed():
    low_rad, high_rad = (steer(1, 0.001, command_rad=command_rad)[1] for command_rad in (-0.5, 0.5))
    assert low_rad < high_rad
    inside_rad = 0.4 * low_rad + 0.6 * high_rad
    assert steer(1, 0.001, command_rad=inside_rad)[1] == inside_rad
    slow = ESTIMATE._replace(correction_rad2_s=1e-5, speed_m_s=0.01, speed_sd_m_s=0.0)
    assert steer(1, 0.04, estimate=slow, command_rad=-0.2)[1] == -0.2
