"""Tick as a pure function: requests, mission items and home."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.intents import (
    ManualRudder,
    PauseMission,
    ReplacePlan,
    Request,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    SteerHeading,
    SteerPosition,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.records import (
    FixType,
    PositionSample,
)
from firmware_py.core.accept import accept
from firmware_py.core.state import State
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.plans.items import Command
from support.tick_boat import FIX, Boat


def test_delay_until_a_time_of_day_ends_without_a_receiver():
    boat = Boat(noise_rad=0.002)
    midnight_s = 20000 * 86400.0
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.5, 0.5, utc_s=midnight_s)
    until = PlanItem(Command.DELAY, frame=2, params=(-1.0, 0.0, 1.0, 0.0))
    turn = PlanItem(Command.YAW, frame=2, params=(90.0, 0.0, 0.0, 0.0))
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [until, turn])))
    boat.get_under_way(Mode.AUTO)
    boat.run(5.0)  # all fixes have the time of midnight
    boat.position = None
    boat.run(55.0)
    assert "Mission: item 2" not in boat.events
    boat.run(10.0)
    assert "Mission: item 2" in boat.events


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300, -1e300])
def test_requests_with_invalid_values_are_denied(value):
    boat = Boat().get_under_way()
    for intent in (
        SteerHeading(value),
        SteerPosition(value, value),
        ManualRudder(value),
        SetParameter("CTL_K1", value),
    ):
        state, answer = accept(boat.state, Request(boat.t_s, intent))
        assert state is boat.state
        assert answer.verdict is Verdict.DENIED


@pytest.mark.parametrize(("number", "limit"), [(0, math.pi / 2.0), (1, math.pi), (2, 1e5)])
def test_coordinates_are_accepted_up_to_their_limits(number, limit):
    state = State.at_start(ParameterSet())
    for value in (limit, -limit, 1.0000001 * limit, -1.0000001 * limit, math.nan):
        place = [0.1, 0.1, 0.0]
        place[number] = value
        for order in (SetHome(*place), *([SteerPosition(*place[:2])] if number < 2 else [])):
            _, answer = accept(state, Request(0.0, order))
            assert (answer.verdict is not Verdict.DENIED) is (abs(value) == limit)


def test_item_numbers_are_checked_and_only_auto_ends_a_pause():
    boat = Boat()
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.4, 0.1)
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.YAW, frame=2)])))
    verdicts = [accept(boat.state, Request(boat.t_s, SetMissionItem(index)))[1].verdict for index in (-1, 0, 1)]
    assert verdicts == [Verdict.DENIED, Verdict.ACCEPTED, Verdict.DENIED]
    boat.get_under_way(Mode.AUTO).tick(PauseMission(paused=True))
    for mode, paused in ((Mode.HOLD, True), (Mode.AUTO, False)):
        boat.tick(SetMode(mode))
        assert (boat.state.modes.mode, boat.state.guidance.mission.paused) == (mode, paused)


@pytest.mark.parametrize(
    ("progress", "expected"),
    [
        ({"index": 1, "begun": True}, {"index": 1, "begun": True}),
        ({"index": 1, "complete": True}, {"index": 0, "complete": False}),
        ({"complete": True, "unusable": True}, {"complete": True, "unusable": True}),
    ],
)
def test_auto_restarts_a_complete_mission(progress, expected):
    boat = Boat()
    boat.position = FIX
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.YAW, frame=2)] * 2)))
    boat.get_under_way(Mode.AUTO)
    mission = MissionProgress(boat.state.plans.mission.identity, started=True)
    state = replace(boat.state, guidance=replace(boat.state.guidance, mission=replace(mission, **progress)))
    accepted, _ = accept(state, Request(boat.t_s, SetMode(Mode.AUTO)))
    assert accepted.guidance.mission == replace(mission, **expected)


def test_mission_sets_home_to_the_present_position():
    boat = Boat()
    boat.position = FIX
    boat.run(1.0)
    boat.tick(SetHome(0.4, 0.1))
    items = [PlanItem(Command.SET_HOME, 0, params=(1.0, 0.0, 0.0, 0.0)), PlanItem(Command.YAW, frame=2)]
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, items)))
    boat.get_under_way(Mode.AUTO).run(1.0)
    assert (boat.state.home.latitude_rad, boat.state.home.longitude_rad) == pytest.approx((0.5, 0.5), abs=1e-6)


@pytest.mark.parametrize("place", [(0.5, None), (None, 0.5)])
def test_home_without_coordinates_is_the_present_position(place):
    boat = Boat()
    assert accept(boat.state, Request(boat.t_s, SetHome(*place)))[1].verdict is Verdict.TEMPORARILY_REJECTED
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.4, 0.1)
    boat.run(1.0)
    home = accept(boat.state, Request(boat.t_s, SetHome(*place)))[0].home
    assert (home.latitude_rad, home.longitude_rad) == pytest.approx((0.4, 0.1), abs=1e-6)


@pytest.mark.parametrize(
    ("fence", "expected"),
    [((), "Fence enabled, but none is loaded: send one"), ((Command.INCLUDED_CIRCLE,), "Fence enabled")],
)
def test_item_that_enables_a_missing_fence_is_reported(fence, expected):
    boat = Boat()
    boat.position = FIX
    circles = [PlanItem(command, frame=0, params=(50.0, 0.0, 0.0, 0.0), x=1, y=1) for command in fence]
    boat.tick(ReplacePlan(Plan.of(PlanKind.FENCE, circles)))
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.FENCE_ENABLE, 2, params=(1.0, 0.0, 0.0, 0.0))])))
    boat.get_under_way(Mode.AUTO)
    boat.run(2.0)
    fence_texts = [text for text in boat.events if "ence " in text and "loiter" not in text]
    assert [text for text in fence_texts if "reach" not in text] == [expected]


@pytest.mark.parametrize(
    ("kind", "command", "text"),
    [(PlanKind.MISSION, Command.WAYPOINT, "item 1: "), (PlanKind.FENCE, Command.EXCLUDED_CIRCLE, "item 0: ")],
)
def test_refused_plan_names_the_item_in_the_count_of_the_operator(kind, command, text):
    """A ground station counts mission items from 1, because item 0 is home, and those of a fence from 0."""
    plan = Plan.of(kind, [PlanItem(command, frame=3, params=(math.nan, math.nan, math.nan, math.nan), x=2**31 - 1)])
    _, answer = accept(State.at_start(ParameterSet()), Request(0.0, ReplacePlan(plan)))
    assert answer.verdict is Verdict.DENIED
    assert answer.text.startswith(text)


def test_read_only_parameter_is_refused():
    state, answer = accept(State.at_start(ParameterSet()), Request(0.0, SetParameter("STAT_BOOTCNT", 5.0)))
    assert (answer.verdict, answer.text) == (Verdict.DENIED, "STAT_BOOTCNT is read-only")
    assert state.parameters == ParameterSet()
