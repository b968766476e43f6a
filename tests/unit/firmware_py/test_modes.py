import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    ForgetParameters,
    ManualRudder,
    Restart,
    SetMode,
    SteerHeading,
    SteerPosition,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Water
from firmware_py.modes import (
    HeadingGoal,
    ModeState,
    PositionGoal,
    Situation,
    decide,
    heading_to_steer,
    live_bench,
    live_stick,
    obstacle_to,
)

CURRENT_EAST = Water(1.0, 0.1, 0.0, 0.3, 0.1)
WELL = Situation(heading_rad=1.0, water=CURRENT_EAST, position_ok=True, rudder_ok=True, mission_ok=True, home_ok=True)
NO_HEADING = replace(WELL, heading_rad=None)
GUIDED = ModeState(Mode.GUIDED, armed=True, goal=HeadingGoal(1.0))


def accepted(state, intent, situation=WELL):
    state, answer = decide(state, intent, situation, 5.0)
    assert answer.verdict is Verdict.ACCEPTED, answer
    return state


def refused(state, intent, verdict, situation=WELL):
    after, answer = decide(state, intent, situation, 5.0)
    assert answer.verdict is verdict
    assert answer.text
    assert after is state
    return answer.text


def test_the_start_state_follows_the_parameters():
    assert ModeState.at_start(ParameterSet()) == ModeState(Mode.HOLD, armed=False)
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", 15)
    assert ModeState.at_start(parameters) == ModeState(Mode.GUIDED, armed=True)


@pytest.mark.parametrize("mode", [Mode.STEERING, Mode.GUIDED])
def test_a_steering_mode_begins_on_the_present_heading(mode):
    state = accepted(ModeState(goal=HeadingGoal(3.0)), SetMode(mode))
    assert state.goal == HeadingGoal(1.0)
    assert "heading" in refused(ModeState(), SetMode(mode), Verdict.TEMPORARILY_REJECTED, NO_HEADING)


def test_entering_the_present_mode_keeps_its_goal():
    state = replace(GUIDED, goal=HeadingGoal(2.5))
    assert accepted(state, SetMode(Mode.GUIDED)) == state


@pytest.mark.parametrize("number", [1, 99, -1, 0x7FFF0000, 15 + 256])
def test_an_unknown_mode_is_denied_whole(number):
    refused(ModeState(), SetMode(number), Verdict.DENIED)


def test_arming_needs_a_heading_and_an_answering_rudder_unless_forced():
    assert accepted(ModeState(), Arm(armed=True)).armed
    assert "heading" in refused(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, NO_HEADING)
    no_servo = replace(WELL, rudder_ok=False)
    assert "servo" in refused(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, no_servo)
    assert accepted(ModeState(), Arm(armed=True, force=True), replace(NO_HEADING, rudder_ok=False)).armed
    assert not accepted(replace(GUIDED), Arm(armed=False), NO_HEADING).armed


def test_a_heading_goal_needs_a_steering_mode():
    refused(ModeState(Mode.HOLD), SteerHeading(2.0), Verdict.TEMPORARILY_REJECTED)
    assert accepted(GUIDED, SteerHeading(2.0)).goal == HeadingGoal(2.0)
    changed = accepted(ModeState(Mode.HOLD), SteerHeading(2.0, change_mode=True))
    assert (changed.mode, changed.goal) == (Mode.GUIDED, HeadingGoal(2.0))


@pytest.mark.parametrize("goal", [None, HeadingGoal(6.0), HeadingGoal(6.0, over_ground=True), PositionGoal(0.1, 0.1)])
def test_a_relative_goal_counts_from_the_heading_whatever_the_goal_was(goal):
    state = replace(GUIDED, goal=goal)  # the present heading is 1.0
    assert accepted(state, SteerHeading(-0.5, relative=True)).goal == HeadingGoal(0.5)
    assert accepted(state, SteerHeading(-1.5, relative=True)).goal.heading_rad == pytest.approx(2 * math.pi - 0.5)


def test_a_turn_the_long_way_is_kept_only_when_it_is_longer():
    assert accepted(GUIDED, SteerHeading(1.5, turn=-1)).goal.turn == -1
    assert accepted(GUIDED, SteerHeading(1.5, turn=1)).goal.turn == 0
    assert accepted(GUIDED, SteerHeading(0.97, turn=1)).goal.turn == 0  # already on the heading


def test_a_course_is_made_good_by_heading_up_against_the_current():
    state = accepted(GUIDED, SteerHeading(2.0, over_ground=True))
    heading_rad = heading_to_steer(state.goal, CURRENT_EAST)
    made_good_rad = math.atan2(math.sin(heading_rad) + 0.3, math.cos(heading_rad))
    assert made_good_rad == pytest.approx(2.0)
    assert heading_to_steer(state.goal, None) == 2.0


LACKING = {
    "no valid heading": {"heading_rad": None},
    "no position": {"position_ok": False},
    "no mission": {"mission_ok": False},
    "no home": {"home_ok": False},
}
NEEDED = {
    Mode.STEERING: ["no valid heading"],
    Mode.GUIDED: ["no valid heading"],
    Mode.LOITER: ["no valid heading", "no position"],
    Mode.AUTO: ["no valid heading", "no position", "no mission"],
    Mode.RTL: ["no valid heading", "no position", "no home"],
}


def test_a_position_by_dead_reckoning_counts_as_known():
    dead_reckoning = replace(WELL, position_ok=False, dead_reckoning_sd_m=300.0)
    for mode in (Mode.LOITER, Mode.AUTO, Mode.RTL):
        assert obstacle_to(mode, dead_reckoning) == ""
    state, answer = decide(GUIDED, SteerPosition(0.5, -0.5), dead_reckoning, 0.0)
    assert (state.goal, answer.verdict) == (PositionGoal(0.5, -0.5), Verdict.ACCEPTED)


@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.STEERING, Mode.LOITER, Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_each_mode_is_entered_with_what_it_needs_and_refused_with_the_reason(mode):
    assert accepted(ModeState(Mode.HOLD), SetMode(mode)).mode is mode
    for reason, lack in LACKING.items():
        situation = replace(WELL, **lack)
        if reason in NEEDED.get(mode, []):
            text = refused(ModeState(Mode.HOLD), SetMode(mode), Verdict.TEMPORARILY_REJECTED, situation)
            assert reason in text
            assert mode.name in text
        else:
            assert accepted(ModeState(Mode.HOLD), SetMode(mode), situation).mode is mode


def test_arming_outside_the_fence_is_refused():
    outside = replace(WELL, fence_breached=True)
    assert "fence" in refused(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, outside)


@pytest.mark.parametrize("absurd", [math.nan, math.inf, -math.inf, 1e300, -1e300, 13.0])
def test_absurd_goals_are_denied_and_change_nothing(absurd):
    refused(GUIDED, SteerHeading(absurd), Verdict.DENIED)
    refused(GUIDED, SteerPosition(absurd, 0.0), Verdict.DENIED)
    refused(GUIDED, SteerPosition(0.0, absurd), Verdict.DENIED)
    refused(GUIDED, ManualRudder(absurd), Verdict.DENIED)


def test_a_position_goal_needs_a_position():
    assert accepted(GUIDED, SteerPosition(0.5, -0.5)).goal == PositionGoal(0.5, -0.5)
    refused(GUIDED, SteerPosition(0.5, -0.5), Verdict.TEMPORARILY_REJECTED, replace(WELL, position_ok=False))
    refused(replace(GUIDED, mode=Mode.STEERING), SteerPosition(0.5, 0.5), Verdict.TEMPORARILY_REJECTED)


def test_the_stick_goes_stale():
    state = accepted(ModeState(Mode.MANUAL), ManualRudder(0.5))
    assert live_stick(state, 7.9, 3.0) == 0.5
    assert live_stick(state, 8.1, 3.0) is None
    assert live_stick(accepted(state, ManualRudder(None)), 5.1, 3.0) is None


INTENTS = st.one_of(
    st.builds(SetMode, st.integers(-(2**31), 2**31)),
    st.builds(Arm, st.booleans(), st.booleans()),
    st.builds(SteerHeading, st.floats(), st.booleans(), st.booleans(), st.integers(-2, 2), st.booleans()),
    st.builds(SteerPosition, st.floats(), st.floats(), st.booleans()),
    st.builds(ManualRudder, st.none() | st.floats()),
)


@given(st.lists(INTENTS, max_size=20), st.booleans())
def test_any_request_leaves_a_valid_goal(intents, has_heading):
    state = ModeState()
    for intent in intents:
        state, answer = decide(state, intent, WELL if has_heading else NO_HEADING, 1.0)
        assert (answer.verdict is Verdict.ACCEPTED) == (not answer.text)
        if isinstance(state.goal, HeadingGoal):
            assert 0.0 <= state.goal.heading_rad < 2 * math.pi
        if isinstance(state.goal, PositionGoal):
            assert abs(state.goal.latitude_rad) <= math.pi / 2
        assert state.stick is None or abs(state.stick) <= 1.0


# ------------------------------------------------------------------ bench and restart


def test_the_bench_rudder_holds_for_a_while_and_arming_ends_it():
    state = accepted(ModeState(), BenchRudder(0.5, 10.0))
    assert (live_bench(state, 5.0), live_bench(state, 14.9), live_bench(state, 15.0)) == (0.5, 0.5, None)
    assert live_bench(accepted(state, BenchRudder(0.0, 0.0)), 5.0) is None
    armed = accepted(state, Arm(True))
    assert live_bench(armed, 6.0) is None
    assert live_bench(accepted(armed, Arm(False)), 6.0) is None


@pytest.mark.parametrize(
    "bench", [*((value, 1.0) for value in (1.1, -1.1, math.nan, math.inf)), *((0.0, s) for s in (-0.1, 60.1, math.nan))]
)
def test_a_bench_rudder_out_of_range_is_denied(bench):
    refused(ModeState(), BenchRudder(*bench), Verdict.DENIED)


def test_no_bench_rudder_while_armed_or_without_a_servo():
    assert "armed" in refused(GUIDED, BenchRudder(0.5, 10.0), Verdict.TEMPORARILY_REJECTED)
    no_servo = replace(WELL, rudder_ok=False)
    assert "servo" in refused(ModeState(), BenchRudder(0.5, 10.0), Verdict.TEMPORARILY_REJECTED, no_servo)


def test_restart_and_reset_wait_for_disarming_unless_forced():
    assert accepted(ModeState(), Restart()) == accepted(ModeState(), ForgetParameters()) == ModeState()
    assert "armed" in refused(GUIDED, Restart(), Verdict.TEMPORARILY_REJECTED)
    assert "armed" in refused(GUIDED, ForgetParameters(), Verdict.TEMPORARILY_REJECTED)
    assert accepted(GUIDED, Restart(force=True)) == GUIDED
