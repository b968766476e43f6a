import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.rudder_limit import Linkage, RudderLimits, limit_command

LIMITS = RudderLimits(limit_rad=0.5, slew_rad_s=0.5, deadband_rad=0.02)


@given(st.floats(-0.5, 0.5), st.floats(), st.floats(0.0, 1.0))
def test_command_stays_within_angle_and_rate_limit(command_rad, demand_rad, step_s):
    next_rad = limit_command(LIMITS, command_rad, demand_rad, step_s)
    assert abs(next_rad) <= LIMITS.limit_rad + 1e-12
    assert abs(next_rad - command_rad) <= LIMITS.slew_rad_s * step_s + 1e-12


@pytest.mark.parametrize(
    ("command_rad", "demand_rad", "next_rad"),
    [
        pytest.param(0.1, 0.119, 0.1, id="within the deadband"),
        pytest.param(0.1, 0.121, 0.121, id="outside the deadband"),
        pytest.param(0.1, math.nan, 0.1, id="NaN"),
        pytest.param(0.0, -0.02, -0.02, id="at the deadband"),
        pytest.param(0.7, 0.7, 0.5, id="beyond the limit"),
        pytest.param(-0.7, -0.7, -0.5, id="beyond the limit to port"),
        pytest.param(-0.2, -0.9, -0.5, id="demand beyond the limit"),
        pytest.param(-0.4, 0.4, 0.1, id="rate limit"),
        pytest.param(0.4, -0.4, -0.1, id="rate limit to port"),
    ],
)
def test_next_command(command_rad, demand_rad, next_rad):
    assert limit_command(LIMITS, command_rad, demand_rad, 1.0) == pytest.approx(next_rad, abs=1e-15)


def test_linkage_without_reversal_has_equal_angles():
    linkage = Linkage.of(ParameterSet())
    assert (linkage.to_shaft(0.1), linkage.to_rudder(0.1)) == (0.1, 0.1)


@given(st.floats(-1.0, 1.0))
def test_linkage_converts_in_both_directions(rudder_rad):
    linkage = Linkage.of(ParameterSet().replaced("RUD_CENTRE_DEG", 7.5).replaced("RUD_REVERSE", 1))
    assert linkage.to_rudder(linkage.to_shaft(rudder_rad)) == pytest.approx(rudder_rad, abs=1e-12)
    assert linkage.to_shaft(0.0) == pytest.approx(math.radians(7.5))
    assert linkage.to_shaft(0.1) < linkage.to_shaft(0.0)
