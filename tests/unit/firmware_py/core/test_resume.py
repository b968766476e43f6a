"""Resume record: state after a restart."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.reports import Home
from firmware_py.core.resume import Moment, from_bytes, restore, resume_of, to_bytes
from firmware_py.core.state import State
from firmware_py.estimate.heading_estimator import with_expected_water
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.line import LineState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo
from firmware_py.modes import HeadingGoal, ModeState, PositionGoal
from firmware_py.plans.items import Command

UTC_S = 1.8e9
A, B = Place(0.6, 2.0), Place(0.61, 2.01)
TASK = GoTo(B, A, 20.0, 100.0)
PLAN = Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=number) for number in range(5)])
PROGRESS = MissionProgress(
    PLAN.identity, 3, started=True, begun=True, elapsed_s=95.0, jumps=((2, 1),), line_start=B, task=TASK
)


def parameters(level, **others):
    values = ParameterSet().replaced("BOOT_RESUME", level)
    for name, value in others.items():
        values = values.replaced(name, value)
    return values


def at_sea(level=2):
    return replace(
        State.at_start(parameters(level), Plans(mission=PLAN)),
        modes=ModeState(Mode.AUTO, armed=True, stick=0.3, stick_t_s=55.0),
        guidance=GuidanceState(
            Mode.AUTO, True, PROGRESS, TASK, TaskFollowerState(TASK, line=LineState(A, 12.0, 88.0, 1)), updated_s=1234.0
        ),
        home=Home(0.6, 2.0, 1.0),
    )


def restart(state, level=2, age_s=100.0, **others):
    text = to_bytes(resume_of(state, Moment(UTC_S)))
    state, notes = restore(State.at_start(parameters(level, **others)), text, Moment(UTC_S + age_s))
    assert notes == ()
    return state


def test_mode_mission_line_and_home_are_restored():
    state = restart(at_sea())
    assert state.modes == ModeState(Mode.AUTO, armed=True)
    assert state.guidance.mission == replace(PROGRESS, elapsed_s=90.0)
    assert state.guidance.follower.task == TASK
    assert state.guidance.follower.line == LineState(A, tries=1)
    assert state.home == Home(0.6, 2.0, 1.0)
    assert state.guidance.updated_s is None


@pytest.mark.parametrize("goal", [HeadingGoal(1.25, over_ground=True), PositionGoal(0.5, -1.0)])
def test_goals_are_restored_bit_for_bit(goal):
    state = replace(at_sea(), modes=ModeState(Mode.GUIDED, armed=True, goal=goal))
    assert restart(state).modes.goal == goal


def test_arming_depends_on_boot_resume_and_boot_arm():
    assert not restart(at_sea(), 1).modes.armed
    assert not restart(at_sea(), 1).guidance.armed
    assert restart(at_sea(), 1, BOOT_ARM=1).modes.armed
    assert restart(at_sea(), 0).modes == ModeState.at_start(ParameterSet())


@pytest.mark.parametrize(
    ("age_s", "greeting"),
    [
        (0.0, "Resumed AUTO, 0 s old"),
        (119.0, "Resumed AUTO, 119 s old"),
        (120.0, "Resumed AUTO, 2 min old"),
        (7199.0, "Resumed AUTO, 120 min old"),
        (7200.0, "Resumed AUTO, 2 h old"),
        (86_400.0, "Resumed AUTO, 24 h old"),
        (86_401.0, "Not resumed: 24 h old"),
        (3.19e8, "Not resumed: 88611 h old"),
        (3.21e8, "Resumed AUTO, age unknown"),  # an impossible age
        (-1.0, "Resumed AUTO, age unknown"),
    ],
)
def test_record_of_the_last_24_hours_is_resumed(age_s, greeting):
    state = restart(at_sea(), age_s=age_s)
    assert state.greeting == greeting
    assert (state.modes.mode is Mode.HOLD) is greeting.startswith("Not")


@pytest.mark.parametrize(
    ("mode", "progress", "text"),
    [
        (Mode.AUTO, {"paused": True}, ", paused"),
        (Mode.AUTO, {"waiting": True}, ", paused"),
        (Mode.AUTO, {}, ""),
        (Mode.LOITER, {"paused": True}, ""),
    ],
)
def test_paused_mission_is_reported_in_auto(mode, progress, text):
    state = at_sea()
    guidance = replace(state.guidance, mode=mode, mission=replace(PROGRESS, **progress))
    state = replace(state, modes=ModeState(mode, armed=True), guidance=guidance)
    assert restart(state).greeting == f"Resumed {mode.name}{text}, 100 s old"


def test_continuous_values_are_rounded_down():
    state = at_sea()
    follower = replace(state.guidance.follower, orbit=OrbitState(1.0, 3.19))
    state = replace(
        state,
        guidance=replace(state.guidance, follower=follower),
        heading_estimator=with_expected_water(state.heading_estimator, (0.39, -0.31, 0.59)),
    )
    resume = resume_of(state, Moment(UTC_S))
    assert resume.orbit == OrbitState(None, pytest.approx(3.0))
    assert resume.water == pytest.approx((0.3, -0.4, 0.5))
    assert resume.mission.elapsed_s == 90.0


@pytest.mark.parametrize("data", [b"", b"{}", b'{"version":6,"$":"Resume"}', b"[[[", b"\xc0", b"\x80"])
def test_invalid_records_are_refused(data):
    with pytest.raises(ValueError):
        restore(State.at_start(parameters(2)), data, Moment(UTC_S))


def test_only_start_and_tries_of_a_line_are_restored():
    resume = replace(resume_of(at_sea(), Moment(UTC_S)), line=LineState(A, math.nan, 88.0, 1))
    state, _ = restore(State.at_start(parameters(2)), to_bytes(resume), Moment(UTC_S))
    assert state.guidance.follower.line == LineState(A, tries=1)


def test_numbers_that_are_not_finite_are_refused():
    resume = resume_of(at_sea(), Moment(UTC_S))
    for broken in (
        replace(resume, utc_s=math.nan),
        replace(resume, water=(0.0, math.inf, 1.0)),
        replace(resume, mission=replace(PROGRESS, elapsed_s=math.nan)),
        replace(resume, mission=replace(PROGRESS, line_start=Place(math.inf, 2.0))),
        replace(resume, modes=replace(resume.modes, goal=HeadingGoal(math.nan))),
        replace(resume, modes=replace(resume.modes, goal=PositionGoal(0.5, -math.inf))),
        replace(resume, modes=replace(resume.modes, stick=math.nan)),
        replace(resume, task=GoTo(Place(math.inf, 2.0), A, 20.0, 100.0)),
        replace(resume, task=GoTo(B, A, math.nan, 100.0)),
        replace(resume, line=LineState(Place(0.6, math.nan))),
        replace(resume, home=Home(0.6, 2.0, math.inf)),
    ):
        with pytest.raises(ValueError):
            from_bytes(to_bytes(broken))


def test_command_is_in_the_record_before_the_tick_applies_it():
    """AUTO starts its mission in the tick that enters it; a restart before that tick must also start it."""
    holding = replace(
        at_sea(), modes=ModeState(), guidance=GuidanceState(Mode.HOLD, mission=MissionProgress(PLAN.identity, 3))
    )
    ordered = replace(holding, modes=ModeState(Mode.AUTO, armed=True))
    state = restart(ordered)
    assert (state.guidance.mode, state.guidance.armed) == (Mode.AUTO, True)
    assert (state.guidance.mission.started, state.guidance.mission.index) == (True, 3)


def test_new_mission_resets_the_stored_progress():
    state = replace(at_sea(), plans=Plans(mission=Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=77)])))
    assert restart(state).guidance.mission.index == 0
