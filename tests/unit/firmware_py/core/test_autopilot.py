"""Autopilot between ticks: accepted commands are stored, and acknowledged when they are on disk."""

import pytest
from msgspec.structs import replace

from firmware_py.common.intents import (
    Arm,
    EnableFence,
    ForgetParameters,
    PauseMission,
    ReplacePlan,
    Request,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    SteerHeading,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.records import Inputs, Tick
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import from_bytes
from firmware_py.core.state import State
from firmware_py.modes import HeadingGoal, ModeState
from firmware_py.plans.items import Command

MAX_AWAITED = 256
MAX_PENDING = 256
PARAMETER_RATE_HZ = 0.5
BURST = 1000.0  # writes of the resume record
RATE_HZ = 0.1

UTC_S = 1.8e9
MISSION = Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=number) for number in range(5)])
FENCE = Plan.of(PlanKind.FENCE, [PlanItem(Command.INCLUDED_CIRCLE, 3, params=(50.0, 0.0, 0.0, 0.0))])


class FakeWriter:
    """A store that calls back on request, as a disk does after a write."""

    def __init__(self):
        self.records, self.callbacks, self.plans, self.parameters = [], [], [], []

    def save_parameters(self, changed):
        self.parameters.append(dict(changed))

    def clear_parameters(self):
        self.parameters.append("cleared")

    def save_plan(self, _plan, done):
        self.plans.append(done)

    def save_resume(self, data):
        self.records.append(from_bytes(data)[0])

    def when_parameters_stored(self, call):
        self.callbacks.append(call)

    when_resume_stored = when_parameters_stored

    def finish(self, *, is_stored=True):
        callbacks, self.callbacks = self.callbacks, []
        for call in callbacks:
            call(is_stored)


class AutopilotRig:
    """An autopilot and its acknowledgements; `level`: BOOT_RESUME."""

    def __init__(self, level=2, **changes):
        self.writer, self.answers, self.t_s = FakeWriter(), [], 0.0
        parameters = ParameterSet().replaced("BOOT_RESUME", level)
        state = replace(State.at_start(parameters, Plans(mission=MISSION, fence=FENCE)), **changes)
        self.autopilot = Autopilot(state, self.writer)

    def tick(self, seconds=0.1):
        self.t_s += seconds
        tick = Tick(round(self.t_s * 10), self.t_s, 0.0, 0, 10.0)
        self.autopilot.step(Inputs(tick, (), (), (), (), self.autopilot.take_requests()))
        self.autopilot.save_resume(self.t_s, UTC_S + self.t_s)

    def command(self, intent):
        answer = self.autopilot.decide(Request(self.t_s, intent))
        assert answer.verdict is Verdict.ACCEPTED, answer
        self.autopilot.when_orders_stored(self.answers.append)


@pytest.fixture
def rig():
    autopilot_rig = AutopilotRig()
    autopilot_rig.tick()
    return autopilot_rig


COMMANDS = {
    Arm(armed=True, force=True): lambda record: record.modes.armed,
    SetMode(int(Mode.MANUAL)): lambda record: record.modes.mode is Mode.MANUAL,
    SetMissionItem(3): lambda record: record.mission.index == 3,
    EnableFence(enabled=True): lambda record: record.fence_enabled,
    SetHome(0.5, 1.0): lambda record: record.home.latitude_rad == 0.5,
}


@pytest.mark.parametrize("intent", COMMANDS, ids=lambda intent: type(intent).__name__)
def test_command_is_acknowledged_when_its_record_is_on_disk(rig, intent):
    rig.command(intent)
    assert COMMANDS[intent](rig.writer.records[-1])  # before any tick
    assert rig.answers == []
    rig.writer.finish()
    assert rig.answers == [True]
    count = len(rig.writer.records)
    rig.command(intent)  # a repeated command causes no write
    assert len(rig.writer.records) == count


def test_goal_and_pause_are_stored():
    rig = AutopilotRig(modes=ModeState(Mode.AUTO, armed=True))
    rig.tick()
    rig.command(PauseMission(paused=True))
    assert rig.writer.records[-1].mission.paused
    rig = AutopilotRig(modes=ModeState(Mode.GUIDED, goal=HeadingGoal(1.0)))
    rig.tick()
    assert rig.writer.records[-1].modes.goal == HeadingGoal(1.0)
    # A goal that is refused, because there is no heading, causes no write.
    assert rig.autopilot.decide(Request(0.1, SteerHeading(2.0))).verdict is Verdict.TEMPORARILY_REJECTED
    assert len(rig.writer.records) == 1


def test_failed_write_is_reported_to_the_caller(rig):
    rig.command(Arm(armed=True, force=True))
    rig.writer.finish(is_stored=False)
    assert rig.answers == [False]
    rig.tick()
    assert rig.autopilot.state.modes.armed  # the command is executed in any case


def test_nothing_is_written_with_boot_resume_0():
    rig = AutopilotRig(0)
    rig.tick()
    rig.command(Arm(armed=True, force=True))
    assert (rig.answers, rig.writer.records, rig.writer.callbacks) == ([True], [], [])


def test_command_before_the_first_tick_waits_for_the_time():
    rig = AutopilotRig()
    rig.command(Arm(armed=True, force=True))
    assert rig.writer.callbacks == []
    rig.autopilot.save_resume(0.0, UTC_S)
    rig.writer.finish()
    assert rig.answers == [True]
    assert rig.writer.records[-1].modes.armed


def test_change_without_acknowledgement_is_stored_in_the_next_tick(rig):
    count = len(rig.writer.records)
    rig.autopilot.decide(Request(rig.t_s, Arm(armed=True, force=True)))  # as a message without acknowledgement
    assert len(rig.writer.records) == count
    rig.tick()
    assert rig.writer.records[-1].modes.armed


def test_tick_does_not_overwrite_a_command_with_an_older_state(rig):
    tick = Tick(9, 0.9, 0.0, 0, 10.0)
    rig.autopilot.step(Inputs(tick, (), (), (), (), rig.autopilot.take_requests()))
    rig.command(Arm(armed=True, force=True))  # between the tick and its record
    count = len(rig.writer.records)
    rig.autopilot.save_resume(0.9, UTC_S)
    assert len(rig.writer.records) == count
    assert rig.writer.records[-1].modes.armed


def test_new_plan_is_acknowledged_when_the_record_with_its_progress_is_stored(rig):
    rig.command(SetMissionItem(3))
    answers = []
    other = Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=77)])
    rig.autopilot.replace_plan(Request(rig.t_s, ReplacePlan(other)), answers.append)
    rig.writer.plans.pop()(False)
    assert (answers.pop().verdict, rig.autopilot.plans().mission) == (Verdict.FAILED, MISSION)
    rig.autopilot.replace_plan(Request(rig.t_s, ReplacePlan(other)), answers.append)
    rig.writer.plans.pop()(True)
    assert rig.writer.records[-1].mission.index == 0
    assert answers == []
    rig.writer.finish()
    assert [answer.verdict for answer in answers] == [Verdict.ACCEPTED]


def test_parameter_that_changes_the_record_is_stored_with_it(rig):
    rig.command(EnableFence(enabled=True))
    rig.autopilot.decide(Request(rig.t_s, SetParameter("FENCE_ENABLE", 1)))
    rig.autopilot.when_stored(rig.answers.append)
    assert rig.writer.records[-1].fence_enabled is None
    without_resume = AutopilotRig(0)
    without_resume.tick()
    without_resume.autopilot.decide(Request(without_resume.t_s, SetParameter("BOOT_RESUME", 2)))
    without_resume.autopilot.when_stored(without_resume.answers.append)
    assert len(without_resume.writer.records) == 1


def test_number_of_waiting_callbacks_is_limited_with_a_hanging_disk(rig):
    for number in range(MAX_AWAITED + 3):
        rig.command(SetHome(number * 1e-3, 0.0))
        rig.autopilot.take_requests()
    assert rig.answers == [False] * 3
    rig.writer.finish()
    assert rig.answers == [False] * 3 + [True] * MAX_AWAITED
    rig.command(SetHome(1.5, 0.0))
    rig.writer.finish()
    assert rig.answers[-1] is True


def use_up_rate_limit(rig):
    """Send goals until the rate limit is reached; return the number of records."""
    number = 0
    while rig.writer.callbacks or number == 0:
        rig.writer.finish()
        number += 1
        rig.command(SetHome(number * 1e-4, 0.0))
        rig.autopilot.take_requests()
    assert BURST / 2 < len(rig.writer.records) < BURST
    rig.answers.clear()
    return len(rig.writer.records)


def test_fast_goals_are_acknowledged_together_and_commands_are_not_delayed(rig):
    count = use_up_rate_limit(rig)
    rig.command(SetHome(1.5, 0.0))
    assert (len(rig.writer.records), rig.writer.callbacks) == (count, [])
    rig.tick(seconds=1.0 / RATE_HZ)
    rig.writer.finish()
    assert rig.writer.records[-1].home.latitude_rad == 1.5
    assert rig.answers == [True, True]
    rig.command(SetHome(1.4, 0.0))
    rig.answers.clear()
    rig.command(Arm(armed=True, force=True))
    rig.writer.finish()
    assert rig.answers == [True, True]  # the record of the command also contains the goal


def test_waiting_callbacks_are_called_when_boot_resume_becomes_0(rig):
    use_up_rate_limit(rig)
    rig.autopilot.decide(Request(rig.t_s, SetParameter("BOOT_RESUME", 0)))
    rig.tick()
    rig.writer.finish()
    assert rig.answers == [True]


def set_radius(rig, number):
    rig.autopilot.decide(Request(rig.t_s, SetParameter("LOIT_RADIUS", 50.0 + number % 100)))
    rig.autopilot.when_stored(rig.answers.append)
    return rig.writer.finish()


def test_fast_parameter_changes_are_written_together_and_each_is_acknowledged(rig):
    set_radius(rig, 7)
    assert rig.writer.parameters == [{"LOIT_RADIUS": 57.0}]  # before any tick
    for number in range(40 * 90):  # 40 in each of 90 ticks
        set_radius(rig, number)
        if number % 40 == 39:
            rig.tick()
            rig.writer.finish()
    assert 1000 <= len(rig.writer.parameters) <= 1010
    rig.tick(seconds=1.0 / PARAMETER_RATE_HZ)
    rig.writer.finish()
    assert rig.writer.parameters[-1] == {"LOIT_RADIUS": 50.0 + (40 * 90 - 1) % 100}
    assert len(rig.answers) == 40 * 90 + 1


def test_pending_parameters_are_written_at_the_end(rig):
    for number in range(1200):
        set_radius(rig, number)
        if number % 40 == 0:
            rig.tick()
    assert rig.writer.parameters[-1] != {"LOIT_RADIUS": 149.0}
    rig.autopilot.save_resume(rig.t_s, UTC_S, last=True)
    assert rig.writer.parameters[-1] == {"LOIT_RADIUS": 149.0}


def test_changes_together_are_a_single_write_in_the_next_tick(rig):
    changes = {"LOIT_RADIUS": 60.0, "RUD_LIMIT_DEG": 30.0}
    requests = [Request(rig.t_s, SetParameter(name, value)) for name, value in changes.items()]
    assert rig.autopilot.decide_together(requests).verdict is Verdict.ACCEPTED
    assert rig.writer.parameters == []
    rig.tick()
    assert rig.writer.parameters == [changes]


def test_reset_of_parameters_follows_earlier_changes(rig):
    rig.autopilot.decide(Request(rig.t_s, SetParameter("LOIT_RADIUS", 60.0)))
    rig.autopilot.decide(Request(rig.t_s, ForgetParameters()))
    assert rig.writer.parameters == [{"LOIT_RADIUS": 60.0}, "cleared"]
    rig.tick()
    assert len(rig.writer.parameters) == 2


@pytest.mark.parametrize(
    ("pending", "values", "verdict"),
    [
        (MAX_PENDING, (20.0, 30.0), Verdict.TEMPORARILY_REJECTED),
        (MAX_PENDING - 1, (20.0, 30.0), Verdict.TEMPORARILY_REJECTED),
        (MAX_PENDING - 2, (20.0, 30.0), Verdict.ACCEPTED),
        (0, (60.0, -1e9), Verdict.DENIED),
    ],
)
def test_requests_together_are_all_accepted_or_all_refused(rig, pending, values, verdict):
    for _ in range(pending):
        rig.autopilot.decide(Request(rig.t_s, SetParameter("LOIT_RADIUS", 60.0)))
    parameters = rig.autopilot.parameters()
    pair = [Request(rig.t_s, SetParameter("LOIT_RADIUS", value)) for value in values]
    assert rig.autopilot.decide_together(pair).verdict is verdict
    is_accepted = verdict is Verdict.ACCEPTED
    assert (rig.autopilot.parameters() is parameters) is not is_accepted
    assert len(rig.autopilot.take_requests()) == pending + 2 * is_accepted
