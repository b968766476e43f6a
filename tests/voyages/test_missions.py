"""Missions with all kinds of items, pauses, dead reckoning, and restarts from checkpoints."""

import itertools
import math

import pytest

from firmware_py.common.intents import (
    Arm,
    PauseMission,
    ReplacePlan,
    Request,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.reports import Activity, MissionState
from firmware_py.core import resume
from firmware_py.core.accept import accept
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.faults.table import TABLE, Fault
from firmware_py.guidance import guidance
from firmware_py.guidance.tasks import HoldHeading
from support import rig
from support.plans import EARTH_M, item, mission, placed


def all_items():
    return [
        item(16, 120, 0),
        item(178, None, None, 0, 0.5),
        item(16, 120, 80, 30),
        item(115, None, None, 180, 0, 0, 0),
        item(93, None, None, 60),
        item(213, None, None, 90, 0, 1),
        item(18, 60, 160, 1, 0, 40),
        item(19, 0, 100, 60, 0, 50),
        item(179, 20, 20, 0),
        item(16, 0, 60),
        item(177, None, None, 9, 1),
        item(20),
        item(17, 0, 0),
    ]


def run_mission(boat, limit_s):
    """Return the items reached, and the activities during each of them."""
    reached, activities = [], {}
    for _ in range(round(limit_s * 10)):
        snapshot = boat.tick().snapshot
        reached += snapshot.mission.reached_items
        activities.setdefault(snapshot.mission.index, set()).add(snapshot.navigation.activity)
        if snapshot.mission.index == 12 and snapshot.navigation.arrived:
            break
    return reached, activities


@pytest.mark.proof
def test_all_kinds_of_items():
    boat = rig.Sailing(rig.scenario(1.2, 0.2), 1, mission(*all_items()), LOIT_RADIUS=60.0)
    boat.get_under_way(Mode.AUTO)
    reached, activities = run_mission(boat, 5000)
    assert reached == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 9, 10, 11]
    assert activities[4] == {Activity.HEADING}
    assert Activity.CIRCLE in activities[6]
    assert Activity.STATION in activities[7]
    # Item 8 moved home, and the boat returned there.
    home = boat.snapshot.home
    assert (home.latitude_rad, home.longitude_rad) == pytest.approx(placed(20, 20), abs=1e-8)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    boat.run(120.0)
    assert math.hypot(*boat.where) < 70.0


def test_pause_change_and_replacement_of_a_mission():
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(16, 400, 0), item(16, 400, 400)))
    assert boat.state.guidance.mission.index == 0
    boat.run(2.0)
    assert boat.snapshot.mission.state is MissionState.NOT_STARTED
    boat.get_under_way(Mode.AUTO)
    boat.run(60.0)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    boat.tick(PauseMission(paused=True))
    boat.run(20.0)
    assert (boat.snapshot.mission.state, boat.snapshot.navigation.activity) == (MissionState.PAUSED, Activity.STATION)
    boat.tick(PauseMission(paused=False))
    boat.tick(SetMissionItem(1))
    boat.run(1.0)
    assert boat.snapshot.mission.index == 1
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    boat.tick(SetMode(Mode.LOITER))
    boat.run(1.0)
    assert boat.snapshot.mission.state is MissionState.PAUSED
    boat.tick(SetMode(Mode.AUTO))
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [item(16, 100, 0)])))
    boat.run(1.0)
    assert (boat.snapshot.mission.index, boat.snapshot.mission.count) == (0, 1)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [])))
    boat.run(1.0)
    assert boat.snapshot.mission.state is MissionState.NO_MISSION
    assert boat.snapshot.navigation.activity is Activity.STATION
    assert boat.times_of("Mission unusable")


def test_refusals_contain_reason():
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(16, 400, 0)))
    boat.run(2.0)
    for intent, verdict, word in (
        (SetMissionItem(1), Verdict.DENIED, "1 to 1"),
        (SetMissionItem(-1), Verdict.DENIED, "1 to 1"),
        (PauseMission(paused=True), Verdict.TEMPORARILY_REJECTED, "HOLD"),
    ):
        state, answer = accept(boat.state, Request(boat.t_s, intent))
        assert state is boat.state
        assert answer.verdict is verdict
        assert word in answer.text
    empty = rig.Sailing(rig.scenario(0.6), 1)
    empty.run(2.0)
    _, answer = accept(empty.state, Request(2.0, SetMode(Mode.AUTO)))
    assert answer.text == "AUTO refused: no mission"


def test_position_jump_causes_no_turn():
    boat = rig.Sailing(rig.scenario(0.6, 0.3), 1, mission(item(16, 1500, 0)))
    boat.get_under_way(Mode.AUTO)
    boat.run(150.0)
    boat.jump_m = (10_000.0, 0.0)
    boat.run(60.0)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    assert not boat.snapshot.position_ok
    assert boat.times_of(TABLE[Fault.POSITION_JUMPING].text)
    assert boat.times_of("GPS position lost")
    boat.jump_m = (0.0, 0.0)
    boat.run(60.0)
    assert boat.snapshot.position_ok
    assert abs(boat.where[1]) < 15.0
    assert not boat.times_of("GPS jump accepted")
    boat.jump_m = (200.0, 0.0)
    boat.run(60.0)
    (report_s,) = boat.times_of("GPS jump accepted: position moved by ")
    assert boat.snapshot.position_ok
    assert boat.times_of("GPS position recovered")[-1] >= report_s  # the recovered position is the new one


def test_restart_from_checkpoints_changes_nothing():
    boat = rig.Sailing(rig.scenario(1.2, 0.3), 3, mission(*all_items()[2:8]), LOIT_RADIUS=40.0)
    boat.keep_inputs = True
    boat.outputs = []
    boat.run(1.0)
    boat.get_under_way(Mode.AUTO, SetParameter("WP_RADIUS", 15.0))
    boat.run(120.0)
    state = State.at_start(ParameterSet().replaced("LOIT_RADIUS", 40.0), mission(*all_items()[2:8]))
    for inputs in boat.inputs:
        if inputs.tick.index % 250 == 0:
            state, _ = state_from_text(state_to_text(state))
        state, _ = step(state, inputs)
    assert state_to_text(state) == state_to_text(boat.state)


def paused_after_turn(**parameters):
    """Return a boat in AUTO whose mission is paused after its first item, a turn without autocontinue."""
    items = item(115, None, None, 40, autocontinue=False), item(115, None, None, 80), item(17, 400, 400)
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(*items), **parameters)
    boat.get_under_way(Mode.AUTO)
    boat.run(60.0, until=lambda boat: boat.snapshot.mission.state is MissionState.PAUSED)
    assert boat.snapshot.mission.state is MissionState.PAUSED
    assert boat.snapshot.navigation.activity is Activity.HEADING
    assert boat.times_of("Mission paused after item 1: no autocontinue")
    boat.events.clear()
    return boat


@pytest.mark.parametrize(
    ("intent", "index"),
    [(PauseMission(paused=False), 1), (SetMode(Mode.AUTO), 1), (SetMissionItem(2), 2)],
)
def test_paused_mission_continues_on_request(intent, index):
    boat = paused_after_turn()
    boat.tick(intent)
    boat.run(1.0)
    assert (boat.snapshot.mission.state, boat.snapshot.mission.index) == (MissionState.ACTIVE, index)
    assert boat.times_of("Mission resumed")


@pytest.mark.parametrize("intent", [PauseMission(paused=False), SetMode(Mode.AUTO)])
def test_pause_is_reported_and_ends_on_request(intent):
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(16, 400, 0)))
    boat.get_under_way(Mode.AUTO)
    boat.run(20.0)
    boat.tick(PauseMission(paused=True))
    boat.run(1.0)
    assert boat.times_of("Mission paused: keeping station")
    boat.tick(SetMissionItem(0))
    boat.run(1.0)
    assert boat.snapshot.mission.state is MissionState.PAUSED
    boat.tick(intent)
    boat.run(1.0)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    assert boat.times_of("Mission resumed")


@pytest.mark.parametrize("pause", [(), (PauseMission(paused=True),)])
@pytest.mark.parametrize("level", [1, 2])
def test_paused_mission_stays_paused_after_restart(pause, level):
    boat = paused_after_turn(BOOT_RESUME=level)
    boat.tick(*pause)
    boat.run(1.0)
    resume_bytes = resume.to_bytes(resume.resume_of(boat.state, resume.Moment(rig.UTC_S)))
    restarted = State.at_start(boat.state.parameters, boat.state.plans)
    boat.state, notes = resume.restore(restarted, resume_bytes, resume.Moment(rig.UTC_S + 600.0))
    assert notes == ()
    assert boat.state.greeting == "Resumed AUTO, paused, 10 min old"
    boat.run(2.0)
    boat.tick(Arm(armed=True))
    boat.run(30.0)
    assert (boat.snapshot.mode, boat.snapshot.armed) == (Mode.AUTO, True)
    assert (boat.snapshot.mission.state, boat.snapshot.mission.index) == (MissionState.PAUSED, 0)
    boat.tick(SetMode(Mode.AUTO))
    boat.run(1.0)
    assert boat.snapshot.mission.state is MissionState.ACTIVE
    assert boat.snapshot.mission.index in (1, 2)  # the boat may already be at the next item


def test_paused_mission_stays_paused_after_failsafe():
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(16, 400, 0)), FS_POS_ACT=2, FS_RESUME=1)
    boat.get_under_way(Mode.AUTO)
    boat.run(20.0)
    boat.tick(PauseMission(paused=True))
    fix_ticks, boat.fix_ticks = boat.fix_ticks, 10**9
    boat.run(30.0)
    assert boat.snapshot.mode is Mode.STEERING
    boat.fix_ticks = fix_ticks
    boat.run(30.0)
    assert (boat.snapshot.mode, boat.snapshot.mission.state) == (Mode.AUTO, MissionState.PAUSED)


def test_dead_reckoning_and_its_limit():
    items = item(16, 100, 0), item(16, 150, 0), item(16, 900, 0)
    boat = rig.Sailing(rig.scenario(0.6, 0.2), 1, mission(*items), WP_RADIUS=6.0, LOIT_RADIUS=40.0)
    boat.get_under_way(Mode.AUTO)
    boat.run(150.0)
    assert boat.snapshot.mission.index == 0
    fix_ticks, boat.fix_ticks = boat.fix_ticks, 10**9
    boat.run(420.0)
    assert boat.times_of("GPS position lost") == boat.times_of("Dead reckoning started: position error grows")
    assert not boat.snapshot.position_ok
    assert boat.snapshot.mission.index == 1  # the first was near, and the uncertainty small
    assert boat.times_of("Probably at the waypoint (no GPS); waiting for a fix")
    text = state_to_text(boat.state)
    read, notes = state_from_text(text)
    assert (state_to_text(read), notes) == (text, ())  # states that contain NaN are never equal
    north_m, east_m = boat.where
    assert math.hypot(north_m - 150.0, east_m) < 40.0 + 2.0 * boat.snapshot.dead_reckoning.sd_m
    boat.fix_ticks = fix_ticks
    rudders_rad = [boat.tick().snapshot.rudder_command_rad for _ in range(100)]
    assert max(abs(a - b) for a, b in itertools.pairwise(rudders_rad)) <= math.radians(3.0) + 1e-9
    assert boat.times_of("GPS recovered after 7 min: position error ")
    assert boat.snapshot.dead_reckoning is None
    boat.run(120.0, until=lambda boat: boat.snapshot.mission.index == 2)
    assert boat.snapshot.mission.index == 2


def test_fence_is_monitored_by_dead_reckoning():
    fence = Plans(fence=Plan.of(PlanKind.FENCE, (item(5003, 0, 0, 60),)))
    boat = rig.Sailing(rig.scenario(0.6), 1, fence, FENCE_ENABLE=1, FS_FENCE_ACT=3)
    boat.get_under_way(Mode.GUIDED)
    boat.run(30.0)
    boat.fix_ticks = 10**9
    boat.run(300.0, until=lambda boat: boat.snapshot.mode is Mode.LOITER)
    assert boat.times_of("Fence breached")
    assert boat.where[0] == pytest.approx(60.0, abs=10.0)


def test_last_heading_is_held_without_dead_reckoning():
    boat = rig.Sailing(rig.scenario(1.2), 1, mission(item(16, 100, 0)), POS_RECKON_M=0.0)
    boat.get_under_way(Mode.AUTO)
    boat.run(30.0)
    boat.fix_ticks = 10**9
    boat.run(150.0)
    assert boat.snapshot.dead_reckoning is None
    assert boat.where[0] > 150.0


def test_headings_of_mission_need_no_position():
    turns = item(115, None, None, 40), item(93, None, None, 20), item(115, None, None, 120), item(93, None, None, 999)
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(*turns))
    boat.get_under_way(Mode.AUTO)
    boat.fix_ticks = 10**9
    boat.run(200.0)
    assert not boat.snapshot.position_ok
    assert boat.snapshot.mission.index == 3
    assert math.degrees(boat.snapshot.goal_heading_rad) == pytest.approx(120.0)
    assert abs(math.degrees(boat.snapshot.heading_error_rad)) < 10.0


def test_mode_with_heading_task_needs_no_position(monkeypatch):
    monkeypatch.setitem(guidance._TASK_SELECTORS, Mode.RTL, lambda *_: HoldHeading(1.0))
    boat = rig.Sailing(rig.scenario(0.6), 1, BOOT_MODE=11, BOOT_ARM=1)
    boat.fix_ticks = 10**9
    boat.index = 1  # tick 0 would have a fix
    boat.run(60.0)
    assert boat.snapshot.position is None
    assert boat.snapshot.goal_heading_rad == 1.0


def test_complete_mission_restarts_on_request():
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(115, None, None, 40), item(115, None, None, 80)))
    boat.get_under_way(Mode.AUTO)
    boat.run(300.0, until=lambda boat: boat.snapshot.mission.state is MissionState.COMPLETE)
    boat.run(10.0)
    assert boat.snapshot.mission.state is MissionState.COMPLETE
    boat.tick(SetMode(Mode.AUTO))
    boat.run(1.0)
    assert (boat.snapshot.mission.state, boat.snapshot.mission.index) == (MissionState.ACTIVE, 0)
    assert len(boat.times_of("Mission: item 1")) == 2


def return_north_m(boat):
    """Return the distance from the start to the target, to the north [m]."""
    boat.run(2.0)
    return round((boat.snapshot.navigation.target_latitude_rad - placed(0, 0)[0]) * EARTH_M)


def test_mission_returns_to_current_home():
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(179, 60, 60), item(20)))
    boat.get_under_way(Mode.AUTO)
    assert return_north_m(boat) == 60
    boat.tick(SetHome(*placed(-100, 0)))
    assert return_north_m(boat) == -100


@pytest.mark.parametrize("intent", [PauseMission(paused=True), SetMode(Mode.LOITER)])
def test_time_of_day_that_passed_during_pause_is_not_awaited(intent):
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(93, None, None, -1, 0, 1, 0), item(115, None, None, 40)))
    assert rig.UTC_S % 86400 == 0
    boat.get_under_way(Mode.AUTO)
    boat.run(20.0)
    assert boat.snapshot.mission.index == 0
    boat.tick(intent)
    boat.run(60.0)
    boat.tick(SetMode(Mode.AUTO))
    boat.run(1.0)
    assert boat.snapshot.mission.index == 1


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.RTL, Mode.AUTO])
def test_loiter_radius_follows_the_parameter(mode):
    boat = rig.Sailing(rig.scenario(0.6), 1, mission(item(16, 400, 0)), WP_RADIUS=50.0)
    boat.get_under_way(mode)
    boat.tick(PauseMission(paused=True))
    boat.run(2.0)
    assert boat.snapshot.navigation.radius_m in (50.0, 100.0)
    boat.tick(SetParameter("LOIT_RADIUS", 60.0), SetParameter("WP_RADIUS", 60.0))
    boat.run(2.0)
    assert boat.snapshot.navigation.radius_m == 60.0
