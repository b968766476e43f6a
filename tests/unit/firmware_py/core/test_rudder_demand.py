"""Rudder demand by mode, stick, bench command and faults."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import IDLE
from firmware_py.core.rudder_demand import compute_rudder_demand
from firmware_py.core.state import State, settings_of
from firmware_py.faults.table import Fault
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.modes import ModeState

START = State.at_start(ParameterSet())
SETTINGS = settings_of(START.parameters)  # maximum rudder angle 30 deg, constant for 10 s without a heading
LIMIT_RAD, NOW_S = math.radians(30.0), 100.0
GUIDED, MANUAL = ModeState(Mode.GUIDED, armed=True), ModeState(Mode.MANUAL, armed=True)


def demand(modes, error_rad=None, lost_s=None):
    since_s = list(START.fault_latch.since_s)
    since_s[Fault.COMPASS_LOST] = lost_s
    state = replace(
        START,
        modes=modes,
        rudder=replace(START.rudder, command_rad=0.2),
        fault_latch=replace(START.fault_latch, since_s=tuple(since_s)),
    )
    return compute_rudder_demand(SETTINGS, state, SteeringTarget(1.0, error_rad), 1.0, NOW_S, 0.1)


@pytest.mark.parametrize(
    ("modes", "error_rad", "lost_s", "expected_rad"),
    [
        (replace(GUIDED, armed=False), 1.0, None, 0.0),
        (ModeState(Mode.HOLD, armed=True), 1.0, None, 0.0),
        (ModeState(bench=-0.5, bench_until_s=101.0), 1.0, None, -0.5 * LIMIT_RAD),
        (ModeState(bench=-0.5, bench_until_s=100.0), 1.0, None, 0.0),
        (replace(MANUAL, stick=0.5, stick_t_s=97.0), 1.0, None, 0.5 * LIMIT_RAD),
        (replace(MANUAL, stick=0.5, stick_t_s=96.9), 1.0, None, 0.0),
        (MANUAL, 1.0, None, 0.0),
        (GUIDED, None, None, 0.2),
        (GUIDED, None, 90.0, 0.2),
        (GUIDED, None, 89.9, 0.0),
    ],
)
def test_demand_without_the_heading_controller(modes, error_rad, lost_s, expected_rad):
    assert demand(modes, error_rad, lost_s) == (pytest.approx(expected_rad, rel=1e-6), IDLE)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_heading_controller_steers_with_a_heading_error(side):
    assert side * demand(GUIDED, side * 1.0, lost_s=0.0)[0] > 0.2
