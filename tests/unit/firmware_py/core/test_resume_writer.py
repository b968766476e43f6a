"""Writes of the resume record: at once after commands, otherwise rate-limited."""

import random

import pytest
from msgspec.structs import replace

from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reports import Home
from firmware_py.core.resume import Moment, from_bytes
from firmware_py.core.resume_writer import ResumeWriter
from firmware_py.core.state import State
from firmware_py.estimate.heading_estimator import with_expected_water
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.modes import HeadingGoal, ModeState

BURST = 1000.0
FINE_INTERVAL_S = 30.0
MAX_AGE_S = 600.0
RATE_HZ = 0.1

UTC_S = 1.8e9
STREAM_S = 10_000.0


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


class Writes:
    """A writer and the number of its writes; a call returns whether a record was written."""

    def __init__(self):
        self.writer = ResumeWriter(Moment(0.0))
        self.writes = 0

    def __call__(self, t_s, state, **options):
        text = self.writer.update(state, t_s, UTC_S + t_s, **options)
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
    write, state = Writes(), at_sea()
    assert write(0.0, state)
    assert not write(0.1, state)
    assert write(0.2, change(state))
    assert not write(0.3, change(state))


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
    write, state = Writes(), at_sea()
    assert write(0.0, state)
    assert not write(FINE_INTERVAL_S - 0.1, change(state))
    assert write.writer.is_current
    assert write(FINE_INTERVAL_S, change(state))
    assert not write(2 * FINE_INTERVAL_S, state := change(state))
    assert write(FINE_INTERVAL_S + MAX_AGE_S, state)  # because of its age
    assert not write(
        FINE_INTERVAL_S + MAX_AGE_S + 1.0, replace(state, modes=replace(state.modes, stick=0.5, stick_t_s=9.0))
    )


def test_nothing_is_written_with_boot_resume_0():
    write = Writes()
    for t_s in range(10):
        assert not write(float(t_s), with_goal(at_sea(0), t_s), is_awaited=True)
        assert write.writer.is_current
    assert write(10.0, at_sea())
    assert not write(11.0, at_sea(0))
    assert write(12.0, at_sea())  # the stored record is outdated


@pytest.mark.parametrize("change", [with_goal, with_mode], ids=["goals", "modes"])
@pytest.mark.parametrize("is_awaited", [False, True], ids=["setpoints", "acknowledged"])
def test_stream_of_changes_respects_the_rate_limit(change, is_awaited):
    write = Writes()
    for tick in range(int(STREAM_S) // 4):
        write(4.0 * tick, change(at_sea(), tick), is_awaited=is_awaited)
    assert RATE_HZ * STREAM_S - 1 <= write.writes <= BURST + RATE_HZ * STREAM_S


def test_any_mix_of_changes_respects_the_rate_limit_and_is_written_finally():
    rng, write, state, t_s = random.Random(1), Writes(), at_sea(), 0.0
    for tick in range(6_000):
        t_s += rng.choice((0.0, 0.1, 1.0))
        state = rng.choice((with_goal, with_mode, *[lambda state, _number: state] * 2))(state, tick)
        write(t_s, state, is_awaited=rng.random() < 0.3)
    assert write.writes <= BURST + RATE_HZ * t_s
    if not write.writer.is_current:
        assert write(t_s + 1.0 / RATE_HZ * BURST, state)


def test_stream_of_setpoints_leaves_writes_for_acknowledged_goals_and_commands():
    write, state = Writes(), at_sea()
    for tick in range(2000):
        write(0.0, with_goal(state, tick))
    assert write.writes == 101  # one more than the tokens above 900
    assert not write(0.0, with_goal(state, 9999))
    assert not write.writer.is_current
    assert write(0.0, with_goal(state, 9999), is_awaited=True)
    for tick in range(2000):
        write(0.0, with_goal(state, tick), is_awaited=True)
    assert not write(0.0, with_goal(state, 9999), is_awaited=True)
    assert write.writes == 901
    for number in range(1, 100):
        assert write(0.0, with_mode(state, number))
        assert write.writer.is_current
    assert not write(0.0, with_mode(state, 100))


def test_continuous_changes_leave_writes_for_commands():
    write, state = Writes(), at_sea()
    for number in range(100):
        assert write(0.0, with_goal(state, number))
    assert write(30.0, with_mission(with_goal(state, 99), elapsed_s=300.0))  # 903 writes are left
    for number in range(50):
        assert write(30.0, with_goal(state, number), is_awaited=True)
    assert not write(60.0, with_mission(with_goal(state, 49), elapsed_s=600.0))


def test_delayed_record_has_the_newest_values():
    write, state = Writes(), at_sea()
    while write(0.0, with_goal(state, write.writes)):
        pass
    text = write.writer.update(with_goal(state, 5), 1.0 / RATE_HZ, UTC_S)
    assert from_bytes(text)[0].modes.goal == HeadingGoal(5e-3)


def test_last_record_is_always_written():
    write, state = Writes(), at_sea()
    assert write(0.0, state)
    assert not write(1.0, with_mission(state, elapsed_s=300.0))
    assert write(1.0, with_mission(state, elapsed_s=300.0), last=True)
    assert not write(1.0, with_mission(state, elapsed_s=300.0), last=True)
    assert MissionProgress() == state.guidance.mission
