import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.rudder_limit import Linkage, RudderLimits, limited_command

LIMITS = RudderLimits(limit_rad=0.5, slew_rad_s=0.5, deadband_rad=0.02)


@given(st.floats(-0.5, 0.5), st.floats(), st.floats(0.0, 1.0))
def test_the_command_stays_within_limit_and_slew(command_rad, demand_rad, step_s):
    next_rad = limited_command(LIMITS, command_rad, demand_rad, step_s)
    assert abs(next_rad) <= LIMITS.limit_rad + 1e-12
    assert abs(next_rad - command_rad) <= LIMITS.slew_rad_s * step_s + 1e-12


def test_a_demand_within_the_deadband_does_not_move_the_command():
    assert limited_command(LIMITS, 0.1, 0.119, 1.0) == 0.1
    assert limited_command(LIMITS, 0.1, 0.121, 1.0) == pytest.approx(0.121)


def test_nan_does_not_move_the_command():
    assert limited_command(LIMITS, 0.1, math.nan, 1.0) == 0.1


def test_a_smaller_limit_reduces_the_command():
    assert limited_command(LIMITS, 0.7, 0.7, 1.0) == pytest.approx(0.5)


def test_without_reversal_shaft_and_rudder_turn_alike():
    linkage = Linkage.of(ParameterSet())
    assert (linkage.to_shaft(0.1), linkage.to_rudder(0.1)) == (0.1, 0.1)


@given(st.floats(-1.0, 1.0))
def test_the_linkage_converts_both_ways(rudder_rad):
    parameters = ParameterSet().replaced("RUD_CENTRE_DEG", 7.5).replaced("RUD_REVERSE", 1)
    linkage = Linkage.of(parameters)
    assert linkage.to_rudder(linkage.to_shaft(rudder_rad)) == pytest.approx(rudder_rad, abs=1e-12)
    assert linkage.to_shaft(0.0) == pytest.approx(math.radians(7.5))
    assert linkage.to_shaft(0.1) < linkage.to_shaft(0.0)
