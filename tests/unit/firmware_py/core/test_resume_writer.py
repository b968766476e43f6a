"""Writes of the resume record: at once after commands, rate-limited otherwise."""

import random

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Home
from firmware_py.core.resume import Moment, from_bytes
from firmware_py.core.resume_writer import BURST, FINE_INTERVAL_S, RATE_HZ, REFRESH_S, ResumeWriter
from firmware_py.core.state import State
from firmware_py.estimate.heading_estimator import with_expected_water
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.modes import HeadingGoal, ModeState

UTC_S = 1.8e9
HOURS_S = 10_000.0


def at_sea(level=2):
    return replace(
        State.at_start(ParameterSet().replaced("BOOT_RESUME", level)),
        modes=ModeState(Mode.GUIDED, armed=True, goal=HeadingGoal(1.0)),
        guidance=GuidanceState(Mode.GUIDED, True),
    )


def with_goal(state, number):
    return replace(state, modes=replace(state.modes, goal=HeadingGoal(number % 1000 * 1e-3)))


def with_mode(state, number):
    return replace(state, modes=replace(state.modes, mode=Mode.HOLD if number % 2 else Mode.MANUAL, goal=None))


def with_mission(state, **changes):
    mission = replace(state.guidance.mission, **changes)
    return replace(state, guidance=replace(state.guidance, mission=mission))


class Keeping:
    """A writer, and the number of its writes."""

    def __init__(self):
        self.writer = ResumeWriter(Moment(0.0))
        self.writes = 0

    def __call__(self, t_s, state, **how):
        text = self.writer.update(state, t_s, UTC_S + t_s, **how)
        self.writes += text is not None
        return text is not None


ORDERS = {
    "mode": lambda state: replace(state, modes=replace(state.modes, mode=Mode.HOLD)),
    "arming": lambda state: replace(state, modes=replace(state.modes, armed=False)),
    "goal": lambda state: with_goal(state, 7),
    "item": lambda state: with_mission(state, index=2),
    "pause": lambda state: with_mission(state, paused=True),
    "item begun": lambda state: with_mission(state, begun=True),
    "fence": lambda state: replace(state, guidance=replace(state.guidance, fence_enabled=True)),
    "home": lambda state: replace(state, home=Home(0.6, 2.0, 1.0)),
}


@pytest.mark.parametrize("change", ORDERS.values(), ids=ORDERS.keys())
def test_commands_and_decisions_are_written_in_the_same_tick(change):
    keep, state = Keeping(), at_sea()
    assert keep(0.0, state)
    assert not keep(0.1, state)
    assert keep(0.2, change(state))
    assert not keep(0.3, change(state))


FINE = {
    "elapsed": lambda state: with_mission(state, elapsed_s=300.0),
    "current": lambda state: replace(
        state, heading_estimator=with_expected_water(state.heading_estimator, (0.5, 0.5, 1.0))
    ),
    "turned": lambda state: replace(
        state,
        guidance=replace(
            state.guidance,
            follower=replace(state.guidance.follower, orbit=replace(state.guidance.follower.orbit, turned_rad=3.0)),
        ),
    ),
}


@pytest.mark.parametrize("change", FINE.values(), ids=FINE.keys())
def test_continuous_changes_are_written_at_intervals(change):
    keep, state = Keeping(), at_sea()
    assert keep(0.0, state)
    assert not keep(FINE_INTERVAL_S - 0.1, change(state))
    assert keep.writer.is_current
    assert keep(FINE_INTERVAL_S, change(state))
    assert not keep(2 * FINE_INTERVAL_S, state := change(state))
    assert keep(FINE_INTERVAL_S + REFRESH_S, state)  # its age
    assert not keep(
        FINE_INTERVAL_S + REFRESH_S + 1.0, replace(state, modes=replace(state.modes, stick=0.5, stick_t_s=9.0))
    )


def test_without_resume_nothing_is_written():
    keep = Keeping()
    for t_s in range(10):
        assert not keep(float(t_s), with_goal(at_sea(0), t_s), is_awaited=True)
        assert keep.writer.is_current
    assert keep(10.0, at_sea())
    assert not keep(11.0, at_sea(0))
    assert keep(12.0, at_sea())  # what lies there has aged meanwhile


@pytest.mark.parametrize("make", [with_goal, with_mode], ids=["goals", "modes"])
@pytest.mark.parametrize("is_awaited", [False, True], ids=["setpoints", "acknowledged"])
def test_a_stream_costs_no_more_than_the_bound(make, is_awaited):
    keep = Keeping()
    for tick in range(int(HOURS_S) // 4):
        keep(4.0 * tick, make(at_sea(), tick), is_awaited=is_awaited)
    assert RATE_HZ * HOURS_S - 1 <= keep.writes <= BURST + RATE_HZ * HOURS_S


def test_any_mix_of_changes_respects_the_limit_and_is_written_finally():
    numbers, keep, state, t_s = random.Random(1), Keeping(), at_sea(), 0.0
    for tick in range(6_000):
        t_s += numbers.choice((0.0, 0.1, 1.0))
        state = numbers.choice((with_goal, with_mode, *[lambda state, _number: state] * 2))(state, tick)
        keep(t_s, state, is_awaited=numbers.random() < 0.3)
    assert keep.writes <= BURST + RATE_HZ * t_s
    if not keep.writer.is_current:
        assert keep(t_s + 1.0 / RATE_HZ * BURST, state)


def test_a_stream_of_setpoints_leaves_writes_for_acknowledged_goals_and_those_for_orders():
    keep, state = Keeping(), at_sea()
    for tick in range(2000):
        keep(0.0, with_goal(state, tick))
    streamed = keep.writes
    assert not keep(0.0, with_goal(state, 9999))
    assert not keep.writer.is_current
    assert keep(0.0, with_goal(state, 9999), is_awaited=True)
    for tick in range(2000):
        keep(0.0, with_goal(state, tick), is_awaited=True)
    assert not keep(0.0, with_goal(state, 9999), is_awaited=True)
    assert keep.writes > 5 * streamed
    assert keep(0.0, with_mode(state, 1))
    assert keep.writer.is_current


def test_a_delayed_record_holds_the_newest_values():
    keep, state = Keeping(), at_sea()
    while keep(0.0, with_goal(state, keep.writes)):
        pass
    text = keep.writer.update(with_goal(state, 5), 1.0 / RATE_HZ, UTC_S)
    assert from_bytes(text)[0].modes.goal == HeadingGoal(5e-3)


def test_the_last_record_is_always_written():
    keep, state = Keeping(), at_sea()
    assert keep(0.0, state)
    assert not keep(1.0, with_mission(state, elapsed_s=300.0))
    assert keep(1.0, with_mission(state, elapsed_s=300.0), last=True)
    assert not keep(1.0, with_mission(state, elapsed_s=300.0), last=True)
    assert MissionProgress() == state.guidance.mission
