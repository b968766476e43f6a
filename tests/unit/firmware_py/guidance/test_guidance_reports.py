"""What is told of mission and fence, and how the report counts."""

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
    ("before", "after", "told"),
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
def test_what_is_told_of_a_mission(before, after, told):
    events = guidance_reports.mission_events(before, after, first=1)
    assert [event.text for event in events] == told
    assert [event.text for event in guidance_reports.mission_events(before, after, first=0)] == [
        text.replace("item 3", "item 2").replace("item 4", "item 3") for text in told
    ]


FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCED))


@pytest.mark.parametrize(
    ("before", "after", "plans", "told"),
    [
        (None, True, FENCE, [(Severity.NOTICE, "Fence enabled")]),
        (True, False, FENCE, [(Severity.NOTICE, "Fence disabled")]),
        (True, True, FENCE, []),
        (True, None, FENCE, []),
        (None, True, Plans(), [(Severity.WARNING, "Fence enabled, but none is loaded: send one")]),
        (None, False, Plans(), [(Severity.NOTICE, "Fence disabled")]),
    ],
)
def test_what_is_told_of_a_fence(before, after, plans, told):
    states = (GuidanceState(fence_enabled=one) for one in (before, after))
    assert [(event.severity, event.text) for event in guidance_reports.fence_events(*states, plans)] == told


def test_the_report_counts_as_the_operator_does_and_stays_within_the_mission():
    plans = mission(item(WAYPOINT, 100.0, 0.0), item(WAYPOINT, 200.0, 0.0))
    state = GuidanceState(mission=MissionProgress(plans.mission.identity))
    for index, told in ((0, 0), (1, 1), (2, 1)):
        progress = replace(state.mission, index=index)
        report = guidance_reports.mission_report(replace(state, mission=progress), plans, AUTO, first=1)
        assert (report.index, report.first, report.count) == (told, 1, 2)
    assert guidance_reports.mission_report(state, Plans(), AUTO, first=1).index is None
