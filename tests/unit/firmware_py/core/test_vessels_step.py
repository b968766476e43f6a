"""Other vessels in a tick: report, avoidance and its end, replay from a checkpoint."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.intents import SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Water
from firmware_py.common.vessels import Vessel, VesselIdentity, VesselKind, VesselPosition
from firmware_py.core.state import State, settings_of
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.core.vessels_step import avoid_vessels
from firmware_py.faults.table import Fault
from firmware_py.guidance.avoidance import IDLE, AvoidanceState
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.guidance.traffic import TrafficState
from firmware_py.modes import ModeState, Situation
from support import rig
from support.plans import placed


def ship_reports(north_m, east_m, speed_m_s=6.0, course_deg=180.0):
    """Return the reports by time of a ship on a straight course, every 10 s."""
    course_rad = math.radians(course_deg)

    def reports(t_s):
        if round(t_s * 10) % 100:
            return ()
        place = placed(
            north_m + speed_m_s * math.cos(course_rad) * t_s, east_m + speed_m_s * math.sin(course_rad) * t_s
        )
        position = VesselPosition(t_s, 211000001, VesselKind.CLASS_A, *place, speed_m_s, course_rad)
        return position, VesselIdentity(t_s, 211000001, "ANNA", "DA1", 70, (90, 10, 8, 8))

    return reports


def approaching_ship(**parameters):
    boat = rig.Sailing(rig.sea("calm"), 1, AIS_NEAR_S=200.0, **parameters)
    boat.vessels_at = ship_reports(1300.0, -30.0)
    return boat.get_under_way(Mode.GUIDED, SteerHeading(0.0))


def test_approach_is_reported_and_avoided_until_it_ends():
    boat = approaching_ship(AIS_ACT=1).run(30.0)
    (avoided_s,) = boat.times_of("Avoidance: heading")
    (reported_s,) = boat.times_of("ANNA: closest")
    assert reported_s <= avoided_s <= reported_s + 3.0
    assert boat.times_of("Vessel approaching") == [reported_s]
    assert boat.snapshot.faults >> Fault.VESSEL_NEAR & 1
    assert 40.0 <= math.degrees(boat.snapshot.goal_heading_rad) <= 60.001
    boat.run(290.0, until=lambda boat: not boat.snapshot.faults >> Fault.VESSEL_NEAR & 1)
    boat.run(10.0)
    assert boat.times_of("Avoidance ended: back on course")
    assert not boat.snapshot.faults >> Fault.VESSEL_NEAR & 1
    assert boat.snapshot.goal_heading_rad == pytest.approx(0.0, abs=1e-9)
    assert len(boat.times_of("ANNA: closest")) == 1


def test_vessel_at_a_loiter_point_is_avoided():
    boat = rig.Sailing(rig.sea("calm"), 1, AIS_NEAR_S=200.0, AIS_ACT=1)
    boat.vessels_at = ship_reports(1300.0, -30.0)
    boat.get_under_way(Mode.LOITER).run(30.0)
    assert boat.times_of("Avoidance: heading")
    assert boat.state.aside.way_rad is not None


def test_vessels_are_only_reported_by_default():
    boat = approaching_ship().run(30.0)
    assert boat.times_of("ANNA: closest")
    assert not boat.times_of("Avoidance: heading")
    assert boat.snapshot.goal_heading_rad == pytest.approx(0.0, abs=1e-9)
    assert boat.snapshot.traffic.vessels[0].title == "ANNA"


SETTINGS = settings_of(ParameterSet().replaced("AIS_ACT", 1))
NEAR = Vessel(VesselPosition(0.0, 1, VesselKind.CLASS_A, *placed(300.0, 0.0), 0.0, 0.0), cpa_m=0.0, near_s=0.0)
NORTH = Situation(0.1, Water(0.4, 0.0, 0.0, 0.0, 0.0), position_ok=True, rudder_ok=True)
TARGET = SteeringTarget(0.0, -0.1)


@pytest.mark.parametrize(
    ("changes", "situation", "target", "is_avoiding"),
    [
        ({}, NORTH, TARGET, True),
        ({"modes": ModeState(Mode.GUIDED, armed=False)}, NORTH, TARGET, False),
        ({"modes": ModeState(Mode.STEERING, armed=True)}, NORTH, TARGET, False),
        ({"traffic": TrafficState()}, NORTH, TARGET, False),
        ({}, replace(NORTH, heading_rad=None), TARGET, False),
        ({}, replace(NORTH, position_ok=False), TARGET, False),
        ({}, replace(NORTH, water=None), TARGET, False),
        ({}, replace(NORTH, water=replace(NORTH.water, too_strong=True)), TARGET, False),
        ({}, NORTH, SteeringTarget(), False),
    ],
)
def test_avoidance_needs_a_near_vessel_and_a_boat_that_can_avoid_it(changes, situation, target, is_avoiding):
    state = State.at_start(ParameterSet())
    position = replace(state.position, latitude_rad=placed(0.0, 0.0)[0], longitude_rad=placed(0.0, 0.0)[1])
    state = replace(
        state,
        position=position,
        modes=ModeState(Mode.GUIDED, armed=True),
        traffic=TrafficState((NEAR,)),
        aside=AvoidanceState(heading_rad=1.0, way_rad=0.0, tried_s=9.0),
    )
    state, steered, events = avoid_vessels(SETTINGS, replace(state, **changes), target, situation, 10.0)
    if is_avoiding:
        assert (steered, events) == (SteeringTarget(1.0, pytest.approx(0.9)), ())
        assert state.aside.heading_rad == 1.0
    else:
        assert (steered, state.aside) == (target, IDLE)
        assert [event.text for event in events] == ["Avoidance ended: back on course"]


@pytest.mark.parametrize("mode", [Mode.STEERING, Mode.MANUAL, Mode.HOLD])
def test_no_avoidance_in_modes_without_a_task(mode):
    boat = rig.Sailing(rig.sea("calm"), 1, AIS_ACT=1)
    boat.vessels_at = ship_reports(1300.0, -30.0)
    boat.get_under_way(mode).run(20.0)
    assert boat.times_of("ANNA: closest")
    assert not boat.times_of("Avoidance: heading")


def test_checkpoint_during_avoidance_gives_the_same_rudder():
    boat = approaching_ship(AIS_ACT=1).run(1.0)
    state, notes = state_from_text(state_to_text(boat.state))
    assert state_to_text(state) == state_to_text(boat.state)
    assert notes == ()
    boat.keep_inputs = True
    commands = [boat.tick().command for _ in range(200)]
    for inputs, command in zip(boat.inputs, commands, strict=True):
        state, output = step(state, inputs)
        assert output.command == command
    assert boat.times_of("Avoidance: heading")


def test_no_traffic_report_without_ais():
    boat = rig.Sailing(rig.sea("calm"), 1).run(3.0)
    assert boat.snapshot.traffic is None
    assert boat.state.traffic.vessels == ()
