"""Events of mission and fence, and the mission report."""

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import Severity
from firmware_py.guidance import guidance_reports
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.modes import ModeState
from support.plans import FENCED, item, mission

WAYPOINT = 16
AUTO = ModeState(Mode.AUTO, armed=True)
SAILS = MissionProgress(identity=1, index=2, started=True, begun=True)


@pytest.mark.parametrize(
    ("before", "after", "texts"),
    [
        (SAILS, SAILS, []),
        (SAILS, replace(SAILS, index=3), ["Mission: item 4"]),
        (replace(SAILS, begun=False), SAILS, ["Mission: item 3"]),
        (SAILS, replace(SAILS, index=3, begun=False), []),
        (SAILS, replace(SAILS, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (replace(SAILS, index=1), replace(SAILS, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (replace(SAILS, waiting=True), replace(SAILS, waiting=True), []),
        (replace(SAILS, waiting=True), replace(SAILS, index=3), ["Mission resumed", "Mission: item 4"]),
        (SAILS, replace(SAILS, paused=True), ["Mission paused: keeping station"]),
        (replace(SAILS, paused=True), replace(SAILS, paused=True), []),
        (replace(SAILS, paused=True), SAILS, ["Mission resumed"]),
        (replace(SAILS, paused=True), replace(SAILS, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (SAILS, replace(SAILS, index=3, complete=True), ["Mission complete: keeping station"]),
        (SAILS, replace(SAILS, complete=True, unusable=True), []),
        (replace(SAILS, complete=True), replace(SAILS, complete=True), []),
    ],
)
def test_mission_events(before, after, texts):
    events = guidance_reports.mission_events(before, after, first=1)
    assert [event.text for event in events] == texts
    assert [event.text for event in guidance_reports.mission_events(before, after, first=0)] == [
        text.replace("item 3", "item 2").replace("item 4", "item 3") for text in texts
    ]


FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCED))


@pytest.mark.parametrize(
    ("before", "after", "plans", "texts"),
    [
        (None, True, FENCE, [(Severity.NOTICE, "Fence enabled")]),
        (True, False, FENCE, [(Severity.NOTICE, "Fence disabled")]),
        (True, True, FENCE, []),
        (True, None, FENCE, []),
        (None, True, Plans(), [(Severity.WARNING, "Fence enabled, but none is loaded: send one")]),
        (None, False, Plans(), [(Severity.NOTICE, "Fence disabled")]),
    ],
)
def test_fence_events(before, after, plans, texts):
    states = (GuidanceState(fence_enabled=one) for one in (before, after))
    assert [(event.severity, event.text) for event in guidance_reports.fence_events(*states, plans)] == texts


def test_the_mission_report_counts_like_the_operator():
    plans = mission(item(WAYPOINT, 100.0, 0.0), item(WAYPOINT, 200.0, 0.0))
    state = GuidanceState(mission=MissionProgress(plans.mission.identity))
    for index, texts in ((0, 0), (1, 1), (2, 1)):
        progress = replace(state.mission, index=index)
        report = guidance_reports.mission_report(replace(state, mission=progress), plans, AUTO, first=1)
        assert (report.index, report.first_item_number, report.count) == (texts, 1, 2)
    assert guidance_reports.mission_report(state, Plans(), AUTO, first=1).index is None
