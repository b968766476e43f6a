"""Snapshot of the boat for log and link."""

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DepthSample, FixType, Inputs, PositionSample, RudderFeedback, RudderStatus, Tick
from firmware_py.common.reports import Home, Water, Wind
from firmware_py.core.snapshot import snapshot_of
from firmware_py.core.state import State, settings_of
from firmware_py.core.tick_timing import TickTiming
from firmware_py.estimate import dead_reckoning
from firmware_py.estimate.observer import HeadingState
from firmware_py.faults.fault import Fault
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.guidance.task_follower import TaskStatus
from firmware_py.modes import ModeState, Situation

NOW_S = 100.0
START = State.at_start(ParameterSet())
WATER = Water(0.4, 0.1, 0.2, 0.3, 0.1)
FIX, HOME, FEEDBACK = PositionSample(99.5, FixType.FIX_3D, 0.6, 2.0), Home(0.6, 2.0, 1.0), RudderFeedback(99.9, 0.3)
HEADING = HeadingState(NOW_S, 0.5, 0.01, 99.0, 0.02, 0.03)
STATE = replace(
    START,
    modes=ModeState(Mode.LOITER, armed=True),
    home=HOME,
    timing=TickTiming(0.0, NOW_S, 7, 50.0),
    rudder=replace(START.rudder, command_rad=0.25, feedback=FEEDBACK),
    heading_estimator=replace(START.heading_estimator, heading=HEADING),
    position=replace(START.position, t_s=NOW_S, latitude_rad=0.6, longitude_rad=2.0, fix=FIX),
    fault_latch=replace(START.fault_latch, active=1 << Fault.BATTERY_LOW),
    guidance=replace(START.guidance, status=TaskStatus(bearing_rad=0.7, distance_m=30.0)),
    instruments=replace(
        START.instruments,
        wind=replace(START.instruments.wind, report=Wind(85.0, 5.0)),
        depth=DepthSample(85.0, 20.0),
    ),
)
SITUATION = Situation(0.5, WATER, position_ok=True, rudder_ok=True)
MEASURED = RudderStatus(NOW_S, 0.25, 0.2, measured=True)
EXPECTED = {
    "t_s": NOW_S, "tick": 9, "mode": Mode.LOITER, "armed": True, "heading_rad": 0.5, "heading_ok": True,
    "yaw_rate_rad_s": 0.01, "roll_rad": 0.02, "pitch_rad": 0.03, "goal_heading_rad": 1.0, "heading_error_rad": 0.4,
    "bearing_rad": 0.7, "distance_m": 30.0, "rudder_rad": 0.2, "rudder_command_rad": 0.25, "rudder_ok": True,
    "servo": FEEDBACK, "position": FIX, "position_ok": True, "faults": 1 << Fault.BATTERY_LOW, "rate_hz": 10.0,
    "skipped_total": 7, "late_s": 0.02, "home": HOME, "prearm_refusal": "", "water": WATER, "gain_reduction": 1.0,
    "power": None, "power_saving_level": 1, "traffic": None, "dead_reckoning": None, "heading_age_s": 1.0,
    "rudder_estimate_rad": None, "wind": Wind(85.0, 5.0), "wind_ok": True, "depth": DepthSample(85.0, 20.0),
    "depth_ok": True,
}  # fmt: skip


def snapshot(state=STATE, situation=SITUATION, rudder=MEASURED, t_s=NOW_S):
    inputs = Inputs(Tick(9, t_s, 0.02, 0, 10.0))
    return snapshot_of(settings_of(state.parameters), state, situation, rudder, SteeringTarget(1.0, 0.4), inputs)


@pytest.mark.parametrize(
    ("arguments", "changes"),
    [
        ({}, {}),
        (
            {"situation": replace(SITUATION, heading_rad=None)},
            {"heading_ok": False, "yaw_rate_rad_s": None, "prearm_refusal": "no valid heading"},
        ),
        (
            {"state": replace(STATE, heading_estimator=START.heading_estimator)},
            {"heading_rad": None, "heading_age_s": None, "yaw_rate_rad_s": 0.0, "roll_rad": None, "pitch_rad": None},
        ),
        ({"rudder": RudderStatus(NOW_S, 0.25, 0.2)}, {"rudder_rad": None}),
        (
            {"rudder": RudderStatus(NOW_S, 0.25, 0.2, estimated=True)},
            {"rudder_rad": None, "rudder_estimate_rad": 0.2},
        ),
        ({"t_s": 100.1}, {"t_s": 100.1, "wind_ok": False, "depth_ok": False, "heading_age_s": pytest.approx(1.1)}),
        (
            {"situation": replace(SITUATION, position_ok=False, rudder_ok=False, water=None)},
            {"position_ok": False, "rudder_ok": False, "water": None, "prearm_refusal": "rudder servo not responding"},
        ),
    ],
)
def test_snapshot_has_the_values_of_the_state(arguments, changes):
    present = snapshot(**arguments)
    assert {name: getattr(present, name) for name in EXPECTED} == EXPECTED | changes


@pytest.mark.parametrize(("sd_m", "is_used"), [(12.0, True), (None, False)])
def test_position_of_dead_reckoning_is_reported_while_it_is_used(sd_m, is_used):
    begun = dead_reckoning.begin(STATE.heading_estimator.water, 60.0)
    state = replace(STATE, position=replace(STATE.position, dead_reckoning=begun))
    report = snapshot(state, replace(SITUATION, dead_reckoning_sd_m=sd_m)).dead_reckoning
    assert (report is not None) is is_used
    if is_used:
        assert (report.latitude_rad, report.longitude_rad, report.sd_m) == (0.6, 2.0, 12.0)
        assert report.time_since_fix_s == 0.5
    without = snapshot(STATE, replace(SITUATION, dead_reckoning_sd_m=sd_m))
    assert without.dead_reckoning is None
