"""Mode state machine: entering modes, arming, goals, stick, bench rudder."""

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
    bench_deflection,
    decide,
    heading_to_steer,
    mode_refusal,
    stick_deflection,
)

CURRENT_EAST = Water(1.0, 0.1, 0.0, 0.3, 0.1)  # 1 m/s through the water, current of 0.3 m/s to the east
NORMAL = Situation(heading_rad=1.0, water=CURRENT_EAST, position_ok=True, rudder_ok=True, mission_ok=True, home_ok=True)
NO_HEADING = replace(NORMAL, heading_rad=None)
GUIDED = ModeState(Mode.GUIDED, armed=True, goal=HeadingGoal(1.0))


def accept(state, intent, situation=NORMAL):
    state, answer = decide(state, intent, situation, 5.0)
    assert answer.verdict is Verdict.ACCEPTED, answer
    return state


def refuse(state, intent, verdict, situation=NORMAL):
    unchanged, answer = decide(state, intent, situation, 5.0)
    assert answer.verdict is verdict
    assert answer.text
    assert unchanged is state
    return answer.text


def test_start_state_follows_the_parameters():
    assert ModeState.at_start(ParameterSet()) == ModeState(Mode.HOLD, armed=False)
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", int(Mode.GUIDED))
    assert ModeState.at_start(parameters) == ModeState(Mode.GUIDED, armed=True)


@pytest.mark.parametrize("mode", [Mode.STEERING, Mode.GUIDED])
def test_mode_with_heading_goals_begins_with_the_present_heading(mode):
    state = accept(ModeState(goal=HeadingGoal(3.0)), SetMode(mode))
    assert state.goal == HeadingGoal(1.0, over_ground=False)
    assert "heading" in refuse(ModeState(), SetMode(mode), Verdict.TEMPORARILY_REJECTED, NO_HEADING)


def test_entering_the_present_mode_keeps_its_goal():
    state = replace(GUIDED, goal=HeadingGoal(2.5))
    assert accept(state, SetMode(Mode.GUIDED)) == state


@pytest.mark.parametrize("number", [1, 99, -1, 0x7FFF0000, 15 + 256])
def test_unknown_mode_is_denied(number):
    refuse(ModeState(), SetMode(number), Verdict.DENIED)


def test_arming_needs_heading_rudder_and_fence_unless_forced():
    assert accept(ModeState(), Arm(armed=True)).armed
    assert "heading" in refuse(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, NO_HEADING)
    no_servo = replace(NORMAL, rudder_ok=False)
    assert "servo" in refuse(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, no_servo)
    outside = replace(NORMAL, fence_breached=True)
    assert "fence" in refuse(ModeState(), Arm(armed=True), Verdict.TEMPORARILY_REJECTED, outside)
    assert accept(ModeState(), Arm(armed=True, force=True), replace(NO_HEADING, rudder_ok=False)).armed
    assert not accept(GUIDED, Arm(armed=False), NO_HEADING).armed


def test_heading_goal_needs_a_mode_that_accepts_it():
    refuse(ModeState(Mode.HOLD), SteerHeading(2.0), Verdict.TEMPORARILY_REJECTED)
    assert accept(GUIDED, SteerHeading(2.0)).goal == HeadingGoal(2.0)
    entered = accept(ModeState(Mode.HOLD), SteerHeading(2.0, change_mode=True))
    assert (entered.mode, entered.goal) == (Mode.GUIDED, HeadingGoal(2.0))


@pytest.mark.parametrize("goal", [None, HeadingGoal(6.0), HeadingGoal(6.0, over_ground=True), PositionGoal(0.1, 0.1)])
def test_relative_goal_is_relative_to_the_present_heading(goal):
    state = replace(GUIDED, goal=goal)  # the present heading is 1.0
    assert accept(state, SteerHeading(-0.5, relative=True)).goal == HeadingGoal(0.5)
    assert accept(state, SteerHeading(-1.5, relative=True)).goal.heading_rad == pytest.approx(2 * math.pi - 0.5)


def test_turn_direction_is_forced_only_for_the_long_way():
    assert accept(GUIDED, SteerHeading(1.5, turn=-1)).goal.turn == -1
    assert accept(GUIDED, SteerHeading(1.5, turn=1)).goal.turn == 0
    assert accept(GUIDED, SteerHeading(1.0 - 0.099, turn=1)).goal.turn == 0  # already on the heading
    assert accept(GUIDED, SteerHeading(1.0 - 0.101, turn=1)).goal.turn == 1
    assert accept(GUIDED, SteerHeading(1.0 + math.pi - 1e-6, turn=1)).goal.turn == 0


def test_heading_for_a_course_compensates_the_current():
    state = accept(GUIDED, SteerHeading(2.0, over_ground=True))
    heading_rad = heading_to_steer(state.goal, CURRENT_EAST)
    course_rad = math.atan2(math.sin(heading_rad) + 0.3, math.cos(heading_rad))
    assert course_rad == pytest.approx(2.0)
    assert heading_to_steer(state.goal, None) == 2.0


MISSING = {
    "no valid heading": {"heading_rad": None},
    "no position": {"position_ok": False},
    "no mission": {"mission_ok": False},
    "no home": {"home_ok": False},
}
REQUIREMENTS = {
    Mode.STEERING: ["no valid heading"],
    Mode.GUIDED: ["no valid heading"],
    Mode.LOITER: ["no valid heading", "no position"],
    Mode.AUTO: ["no valid heading", "no position", "no mission"],
    Mode.RTL: ["no valid heading", "no position", "no home"],
}


def test_dead_reckoning_position_is_sufficient():
    dead_reckoning = replace(NORMAL, position_ok=False, dead_reckoning_sd_m=300.0)
    for mode in (Mode.LOITER, Mode.AUTO, Mode.RTL):
        assert mode_refusal(mode, dead_reckoning) == ""
    state, answer = decide(GUIDED, SteerPosition(0.5, -0.5), dead_reckoning, 0.0)
    assert (state.goal, answer.verdict) == (PositionGoal(0.5, -0.5), Verdict.ACCEPTED)


@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.STEERING, Mode.LOITER, Mode.AUTO, Mode.RTL, Mode.GUIDED])
def test_mode_is_refused_with_the_missing_requirement(mode):
    entered = accept(ModeState(Mode.HOLD, goal=HeadingGoal(3.0)), SetMode(mode))
    goal = HeadingGoal(1.0) if mode in (Mode.STEERING, Mode.GUIDED) else None
    assert (entered.mode, entered.goal) == (mode, goal)
    for reason, missing in MISSING.items():
        situation = replace(NORMAL, **missing)
        if reason in REQUIREMENTS.get(mode, []):
            text = refuse(ModeState(Mode.HOLD), SetMode(mode), Verdict.TEMPORARILY_REJECTED, situation)
            assert reason in text
            assert mode.name in text
        else:
            assert accept(ModeState(Mode.HOLD), SetMode(mode), situation).mode is mode


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300, 13.0])
def test_goals_out_of_range_are_denied(value):
    refuse(GUIDED, SteerHeading(value), Verdict.DENIED)
    refuse(GUIDED, SteerPosition(value, 0.0), Verdict.DENIED)
    refuse(GUIDED, SteerPosition(0.0, value), Verdict.DENIED)
    refuse(GUIDED, ManualRudder(value), Verdict.DENIED)


def test_position_goal_needs_a_position_and_guided_mode():
    for position in ((0.5, -0.5), (0.5 * math.pi, math.pi), (-0.5 * math.pi, -math.pi)):
        assert accept(GUIDED, SteerPosition(*position)).goal == PositionGoal(*position)
    refuse(GUIDED, SteerPosition(0.5, -0.5), Verdict.TEMPORARILY_REJECTED, replace(NORMAL, position_ok=False))
    refuse(replace(GUIDED, mode=Mode.STEERING), SteerPosition(0.5, 0.5), Verdict.TEMPORARILY_REJECTED)


@pytest.mark.parametrize("deflection", [-1.0, 1.0])
def test_full_deflection_of_stick_and_bench_rudder_is_accepted(deflection):
    assert accept(ModeState(Mode.MANUAL), ManualRudder(deflection)).stick == deflection
    assert accept(ModeState(), BenchRudder(deflection, 60.0)).bench == deflection


def test_stick_expires():
    state = accept(ModeState(Mode.MANUAL), ManualRudder(0.5))
    assert stick_deflection(state, 7.9, 3.0) == 0.5
    assert stick_deflection(state, 8.1, 3.0) is None
    assert stick_deflection(accept(state, ManualRudder(None)), 5.1, 3.0) is None


INTENTS = st.one_of(
    st.builds(SetMode, st.integers(-(2**31), 2**31)),
    st.builds(Arm, st.booleans(), st.booleans()),
    st.builds(SteerHeading, st.floats(), st.booleans(), st.booleans(), st.integers(-2, 2), st.booleans()),
    st.builds(SteerPosition, st.floats(), st.floats(), st.booleans()),
    st.builds(ManualRudder, st.none() | st.floats()),
)


@given(st.lists(INTENTS, max_size=20), st.booleans())
def test_any_requests_leave_a_valid_state(intents, has_heading):
    state = ModeState()
    for intent in intents:
        state, answer = decide(state, intent, NORMAL if has_heading else NO_HEADING, 1.0)
        assert (answer.verdict is Verdict.ACCEPTED) == (not answer.text)
        if isinstance(state.goal, HeadingGoal):
            assert 0.0 <= state.goal.heading_rad < 2 * math.pi
        if isinstance(state.goal, PositionGoal):
            assert abs(state.goal.latitude_rad) <= math.pi / 2
        assert state.stick is None or abs(state.stick) <= 1.0


def test_bench_rudder_ends_after_its_time_and_with_arming():
    state = accept(ModeState(), BenchRudder(0.5, 10.0))
    assert [bench_deflection(state, now_s) for now_s in (5.0, 14.9, 15.0)] == [0.5, 0.5, None]
    assert bench_deflection(accept(state, BenchRudder(0.0, 0.0)), 5.0) is None
    assert bench_deflection(accept(state, BenchRudder(0.5, 60.0)), 5.0) == 0.5
    assert bench_deflection(replace(state, bench_until_s=65.1), 5.0) is None  # by the clock of another process
    armed = accept(state, Arm(True))
    assert bench_deflection(armed, 6.0) is None
    assert bench_deflection(accept(armed, Arm(False)), 6.0) is None


@pytest.mark.parametrize(
    "bench", [*((value, 1.0) for value in (1.1, -1.1, math.nan, math.inf)), *((0.0, s) for s in (-0.1, 60.1, math.nan))]
)
def test_bench_rudder_out_of_range_is_denied(bench):
    refuse(ModeState(), BenchRudder(*bench), Verdict.DENIED)


def test_bench_rudder_is_refused_while_armed_or_without_a_servo():
    assert "armed" in refuse(GUIDED, BenchRudder(0.5, 10.0), Verdict.TEMPORARILY_REJECTED)
    no_servo = replace(NORMAL, rudder_ok=False)
    assert "servo" in refuse(ModeState(), BenchRudder(0.5, 10.0), Verdict.TEMPORARILY_REJECTED, no_servo)


def test_restart_and_reset_are_refused_while_armed_unless_forced():
    assert accept(ModeState(), Restart()) == accept(ModeState(), ForgetParameters()) == ModeState()
    assert "armed" in refuse(GUIDED, Restart(), Verdict.TEMPORARILY_REJECTED)
    assert "armed" in refuse(GUIDED, ForgetParameters(), Verdict.TEMPORARILY_REJECTED)
    assert accept(GUIDED, Restart(force=True)) == GUIDED
