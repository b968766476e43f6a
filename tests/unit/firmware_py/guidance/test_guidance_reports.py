"""Events of mission and fence, and the mission report."""

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import Severity
from firmware_py.common.reports import Activity, MissionReport, MissionState, Navigation
from firmware_py.guidance import guidance_reports
from firmware_py.guidance.fence import FenceState
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.modes import ModeState
from support.plans import FENCE_ITEMS, item, mission

WAYPOINT = 16
AUTO = ModeState(Mode.AUTO, armed=True)
ACTIVE = MissionProgress(identity=1, index=2, started=True, begun=True)


@pytest.mark.parametrize(
    ("previous", "present", "texts"),
    [
        (ACTIVE, ACTIVE, []),
        (ACTIVE, replace(ACTIVE, index=3), ["Mission: item 4"]),
        (replace(ACTIVE, begun=False), ACTIVE, ["Mission: item 3"]),
        (ACTIVE, replace(ACTIVE, index=3, begun=False), []),
        (ACTIVE, replace(ACTIVE, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (replace(ACTIVE, index=1), replace(ACTIVE, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (replace(ACTIVE, waiting=True), replace(ACTIVE, waiting=True), []),
        (replace(ACTIVE, waiting=True), replace(ACTIVE, index=3), ["Mission resumed", "Mission: item 4"]),
        (ACTIVE, replace(ACTIVE, paused=True), ["Mission paused: keeping station"]),
        (replace(ACTIVE, paused=True), replace(ACTIVE, paused=True), []),
        (replace(ACTIVE, paused=True), ACTIVE, ["Mission resumed"]),
        (replace(ACTIVE, paused=True), replace(ACTIVE, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (ACTIVE, replace(ACTIVE, index=3, complete=True), ["Mission complete: keeping station"]),
        (ACTIVE, replace(ACTIVE, complete=True, unusable=True), []),
        (replace(ACTIVE, complete=True), replace(ACTIVE, complete=True), []),
    ],
)
def test_changes_of_the_mission_are_events(previous, present, texts):
    events = guidance_reports.mission_events(previous, present, first_number=1)
    assert [event.text for event in events] == texts
    assert [event.text for event in guidance_reports.mission_events(previous, present, first_number=0)] == [
        text.replace("item 3", "item 2").replace("item 4", "item 3") for text in texts
    ]


FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCE_ITEMS))


@pytest.mark.parametrize(
    ("previous", "present", "plans", "texts"),
    [
        (None, True, FENCE, [(Severity.NOTICE, "Fence enabled")]),
        (True, False, FENCE, [(Severity.NOTICE, "Fence disabled")]),
        (True, True, FENCE, []),
        (True, None, FENCE, []),
        (None, True, Plans(), [(Severity.WARNING, "Fence enabled, but none is loaded: send one")]),
        (None, False, Plans(), [(Severity.NOTICE, "Fence disabled")]),
    ],
)
def test_changes_of_the_fence_are_events(previous, present, plans, texts):
    states = (GuidanceState(fence_enabled=is_enabled) for is_enabled in (previous, present))
    assert [(event.severity, event.text) for event in guidance_reports.fence_events(*states, plans)] == texts


def test_mission_report_has_the_item_number_of_the_operator():
    plans = replace(FENCE, mission=mission(item(WAYPOINT, 100.0, 0.0), item(WAYPOINT, 200.0, 0.0)).mission)
    identities = (plans.mission.identity, FENCE.fence.identity, 0)
    state = GuidanceState(mission=MissionProgress(plans.mission.identity, started=True), reached=(0,))
    for index, reported_index in ((0, 0), (1, 1), (2, 1)):
        progress = replace(state.mission, index=index)
        report = guidance_reports.mission_report(replace(state, mission=progress), plans, AUTO, first_number=1)
        assert report == MissionReport(
            MissionState.ACTIVE,
            index=reported_index,
            count=2,
            reached_items=(0,),
            identities=identities,
            first_item_number=1,
        )
    for modes in (replace(AUTO, armed=False), replace(AUTO, mode=Mode.LOITER)):
        assert guidance_reports.mission_report(state, plans, modes, first_number=1).state is MissionState.PAUSED
    assert guidance_reports.mission_report(state, Plans(), AUTO, first_number=1) == MissionReport(
        reached_items=(0,), first_item_number=1
    )


@pytest.mark.parametrize(
    ("arrived", "activity", "is_reported"),
    [
        (True, Activity.STATION, True),
        (True, Activity.NOTHING, False),
        (False, Activity.STATION, False),
        (False, Activity.NOTHING, False),
    ],
)
def test_navigation_report_has_the_target_and_the_fence(arrived, activity, is_reported):
    place = Place(0.6, 2.0)
    status = TaskStatus(activity=activity, target=place, radius_m=20.0, cross_track_m=-3.0)
    state = GuidanceState(
        status=status,
        follower=TaskFollowerState(arrived=arrived),
        fence=FenceState(FENCE.fence.identity, place, 55.0),
    )
    report = guidance_reports.navigation_report(state, FENCE, fence_enabled=True)
    assert report == Navigation(
        activity,
        target_latitude_rad=0.6,
        target_longitude_rad=2.0,
        radius_m=20.0,
        cross_track_m=-3.0,
        arrived=is_reported,
        fence_enabled=True,
        fence_margin_m=55.0,
    )
    without = guidance_reports.navigation_report(GuidanceState(), FENCE, fence_enabled=False)
    assert without == Navigation()
