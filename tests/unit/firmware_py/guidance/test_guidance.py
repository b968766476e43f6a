"""The guidance of a tick: when it is carried out, what it is told to change, and what it tells."""

from dataclasses import replace

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import Severity
from firmware_py.guidance import guidance
from firmware_py.guidance.guidance import INTERVAL_S, LONGEST_STEP_S, GuidanceInput, GuidanceSettings, GuidanceState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.tasks import VesselMotion
from firmware_py.modes import ModeState, PositionGoal
from support.plans import FENCED, item, mission, placed

SETTINGS = GuidanceSettings.of(ParameterSet())
MOTION = VesselMotion(Place(*placed(0.0, 0.0)), 0.0, 0.4, 0.0, 0.0)
WAYPOINT, DELAY = 16, 93
GUIDED = ModeState(Mode.GUIDED, armed=True, goal=PositionGoal(*placed(500.0, 0.0)))
AUTO = ModeState(Mode.AUTO, armed=True)
TICK_S = 0.1


def looked_at(t_s, modes=GUIDED, plans=Plans(), *, new_fix=False, motion=MOTION):  # noqa: B008 - frozen
    return GuidanceInput(t_s, 0.0, motion, new_fix, modes, plans, None, None)


def updated(times_s, state=GuidanceState(), fixes=(), **given):  # noqa: B008 - frozen
    """Return at which of the times it was carried out, and the state after them."""
    when_s = []
    for t_s in times_s:
        state = guidance.update(SETTINGS, state, looked_at(t_s, new_fix=t_s in fixes, **given)).state
        if state.updated_s == t_s:
            when_s.append(t_s)
    return when_s, state


def test_it_is_carried_out_twice_a_second_and_at_each_fix():
    ticks_s = [100.0 + tick / 16.0 for tick in range(33)]
    assert updated(ticks_s)[0] == [100.0, 100.0 + INTERVAL_S, 101.0, 101.5, 102.0]
    assert INTERVAL_S == 0.5
    assert updated(ticks_s, fixes=(100.25, 101.0625))[0] == [100.0, 100.25, 100.75, 101.0625, 101.5625]


@pytest.mark.parametrize(
    "change",
    [
        {"modes": replace(GUIDED, mode=Mode.LOITER)},
        {"modes": replace(GUIDED, armed=False)},
        {"plans": mission(item(WAYPOINT, 100.0, 0.0))},
    ],
)
def test_it_is_carried_out_at_once_when_mode_arming_or_mission_change(change):
    _, state = updated([100.0])
    assert updated([100.125], state)[0] == []
    assert updated([100.125], state, **change)[0] == [100.125]


def test_between_two_times_the_very_state_stands():
    _, state = updated([100.0])
    assert guidance.update(SETTINGS, state, looked_at(100.25)).state is state


@pytest.mark.parametrize(("pause_s", "counted_s"), [(0.75, 0.75), (3600.0, LONGEST_STEP_S), (-50.0, 0.0)])
def test_a_wait_counts_the_time_that_it_was_carried_out_for(pause_s, counted_s):
    given = {"modes": AUTO, "plans": mission(item(DELAY, None, None, 1000.0), item(WAYPOINT, 100.0, 0.0))}
    _, state = updated([100.0, 100.5], **given)
    before_s = state.mission.elapsed_s
    _, state = updated([100.5 + pause_s], state, fixes=(100.5 + pause_s,), **given)
    assert state.mission.elapsed_s == pytest.approx(before_s + counted_s)


def test_disarmed_the_mission_stands_and_armed_it_begins():
    given = {"plans": mission(item(WAYPOINT, 100.0, 0.0))}
    _, state = updated([100.0, 101.0], modes=replace(AUTO, armed=False), **given)
    assert not state.mission.started
    _, state = updated([102.0], state, modes=AUTO, **given)
    assert (state.mission.started, state.mission.begun) == (True, True)


def test_another_mission_is_sailed_from_its_beginning_where_one_was_sailed():
    first, other = mission(item(WAYPOINT, 100.0, 0.0)), mission(item(WAYPOINT, 200.0, 0.0), item(WAYPOINT, 0.0, 0.0))
    for modes, sails in ((AUTO, True), (GUIDED, False)):
        _, state = updated([100.0, 101.0], modes=modes, plans=first)
        _, state = updated([102.0], state, modes=modes, plans=other)
        assert (state.mission.identity, state.mission.started) == (other.mission.identity, sails)


# ------------------------------------------------------------------ what is told

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
        (replace(SAILS, waiting=True), replace(SAILS, index=3), ["Mission goes on", "Mission: item 4"]),
        (SAILS, replace(SAILS, paused=True), ["Mission paused: keeping station"]),
        (replace(SAILS, paused=True), replace(SAILS, paused=True), []),
        (replace(SAILS, paused=True), SAILS, ["Mission goes on"]),
        (replace(SAILS, paused=True), replace(SAILS, waiting=True), ["Mission paused after item 3: no autocontinue"]),
        (SAILS, replace(SAILS, index=3, complete=True), ["Mission complete: keeping station"]),
        (SAILS, replace(SAILS, complete=True, unusable=True), []),
        (replace(SAILS, complete=True), replace(SAILS, complete=True), []),
    ],
)
def test_what_is_told_of_a_mission(before, after, told):
    events = guidance.mission_events(before, after, first=1)
    assert [event.text for event in events] == told
    assert [event.text for event in guidance.mission_events(before, after, first=0)] == [
        text.replace("item 3", "item 2").replace("item 4", "item 3") for text in told
    ]


FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCED))


@pytest.mark.parametrize(
    ("before", "after", "plans", "told"),
    [
        (None, True, FENCE, [(Severity.NOTICE, "Fence heeded")]),
        (True, False, FENCE, [(Severity.NOTICE, "Fence not heeded")]),
        (True, True, FENCE, []),
        (True, None, FENCE, []),
        (None, True, Plans(), [(Severity.WARNING, "No fence to heed: send one")]),
        (None, False, Plans(), [(Severity.NOTICE, "Fence not heeded")]),
    ],
)
def test_what_is_told_of_a_fence(before, after, plans, told):
    states = (GuidanceState(fence_enabled=one) for one in (before, after))
    assert [(event.severity, event.text) for event in guidance.fence_events(*states, plans)] == told


def test_the_margin_is_that_of_a_fence_that_is_heeded_and_known():
    _, state = updated([100.0], plans=FENCE)
    assert guidance.fence_margin_m(state, FENCE, enabled=True) == pytest.approx(100.0 * 2.0**0.5 - 30.0, abs=0.5)
    assert guidance.fence_margin_m(state, FENCE, enabled=False) is None
    assert guidance.fence_margin_m(state, Plans(), enabled=True) is None
    assert guidance.fence_margin_m(GuidanceState(), FENCE, enabled=True) is None
    _, unplaced = updated([100.0], plans=FENCE, motion=None)
    assert guidance.fence_margin_m(unplaced, FENCE, enabled=True) is None


def test_the_report_counts_as_the_operator_does_and_stays_within_the_mission():
    plans = mission(item(WAYPOINT, 100.0, 0.0), item(WAYPOINT, 200.0, 0.0))
    _, state = updated([100.0], modes=AUTO, plans=plans)
    for index, told in ((0, 0), (1, 1), (2, 1)):
        progress = replace(state.mission, index=index)
        report = guidance.mission_report(replace(state, mission=progress), plans, AUTO, first=1)
        assert (report.index, report.first, report.count) == (told, 1, 2)
    assert guidance.mission_report(state, Plans(), AUTO, first=1).index is None
