"""Between the ticks: what is accepted is kept, and acknowledged when it is."""

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
from firmware_py.core.autopilot import AWAITED_LIMIT, PENDING_LIMIT, Autopilot
from firmware_py.core.parameter_keeper import RATE_HZ as PARAMETER_RATE_HZ
from firmware_py.core.resume import from_bytes
from firmware_py.core.resume_keeper import BURST, RATE_HZ
from firmware_py.core.state import State
from firmware_py.modes import HeadingGoal, ModeState

UTC_S = 1.8e9
MISSION = Plan.of(PlanKind.MISSION, [PlanItem(16, 3, x=number) for number in range(5)])
FENCE = Plan.of(PlanKind.FENCE, [PlanItem(5003, 3, params=(50.0, 0.0, 0.0, 0.0))])


class FakeKeeper:
    """A store whose disk answers on request."""

    def __init__(self):
        self.records, self.waiting, self.plans, self.parameters = [], [], [], []

    def save_parameters(self, changed):
        self.parameters.append(dict(changed))

    def clear_parameters(self):
        self.parameters.append("forgotten")

    def save_plan(self, _plan, done):
        self.plans.append(done)

    def save_resume(self, text):
        self.records.append(from_bytes(text)[0])

    def when_parameters_stored(self, call):
        self.waiting.append(call)

    when_resume_stored = when_parameters_stored

    def answer(self, *, well=True):
        waiting, self.waiting = self.waiting, []
        for call in waiting:
            call(well)


class Sea:
    """An autopilot under way, and what it was answered."""

    def __init__(self, level=2, **changes):
        self.keeper, self.answers, self.t_s = FakeKeeper(), [], 0.0
        parameters = ParameterSet().replaced("BOOT_RESUME", level)
        state = replace(State.at_start(parameters, Plans(mission=MISSION, fence=FENCE)), **changes)
        self.autopilot = Autopilot(state, self.keeper)

    def tick(self, seconds=0.1):
        self.t_s += seconds
        tick = Tick(round(self.t_s * 10), self.t_s, 0.0, 0, 10.0)
        self.autopilot.step(Inputs(tick, (), (), (), (), self.autopilot.take_requests()))
        self.autopilot.save_resume(self.t_s, UTC_S + self.t_s)

    def order(self, intent):
        answer = self.autopilot.decide(Request(self.t_s, intent))
        assert answer.verdict is Verdict.ACCEPTED, answer
        self.autopilot.when_orders_stored(self.answers.append)


@pytest.fixture
def sea():
    made = Sea()
    made.tick()
    return made


KEPT = {
    Arm(armed=True, force=True): lambda record: record.modes.armed,
    SetMode(int(Mode.MANUAL)): lambda record: record.modes.mode is Mode.MANUAL,
    SetMissionItem(3): lambda record: record.mission.index == 3,
    EnableFence(enabled=True): lambda record: record.fence_enabled,
    SetHome(0.5, 1.0): lambda record: record.home.latitude_rad == 0.5,
}


@pytest.mark.parametrize("intent", KEPT, ids=lambda intent: type(intent).__name__)
def test_a_command_is_acknowledged_when_its_record_is_on_disk(sea, intent):
    sea.order(intent)
    assert KEPT[intent](sea.keeper.records[-1])  # before any tick
    assert sea.answers == []
    sea.keeper.answer()
    assert sea.answers == [True]
    written = len(sea.keeper.records)
    sea.order(intent)  # the same again: nothing to write
    assert len(sea.keeper.records) == written


def test_a_goal_and_a_pause_are_kept_too():
    sea = Sea(modes=ModeState(Mode.AUTO, armed=True))
    sea.tick()
    sea.order(PauseMission(paused=True))
    assert sea.keeper.records[-1].mission.paused
    sea = Sea(modes=ModeState(Mode.GUIDED, goal=HeadingGoal(1.0)))
    sea.tick()
    assert sea.keeper.records[-1].modes.goal == HeadingGoal(1.0)
    # Refused, since there is no heading here: nothing is written.
    assert sea.autopilot.decide(Request(0.1, SteerHeading(2.0))).verdict is Verdict.TEMPORARILY_REJECTED
    assert len(sea.keeper.records) == 1


def test_a_failed_write_is_reported_to_the_caller(sea):
    sea.order(Arm(armed=True, force=True))
    sea.keeper.answer(well=False)
    assert sea.answers == [False]
    sea.tick()
    assert sea.autopilot.state.modes.armed  # it is done all the same


def test_with_nothing_to_resume_nothing_is_written_and_nothing_waits():
    sea = Sea(0)
    sea.tick()
    sea.order(Arm(armed=True, force=True))
    assert (sea.answers, sea.keeper.records, sea.keeper.waiting) == ([True], [], [])


def test_a_command_before_the_first_tick_waits_for_the_time():
    sea = Sea()
    sea.order(Arm(armed=True, force=True))
    assert sea.keeper.waiting == []
    sea.autopilot.save_resume(0.0, UTC_S)
    sea.keeper.answer()
    assert sea.answers == [True]
    assert sea.keeper.records[-1].modes.armed


def test_changes_by_the_tick_are_stored_in_that_tick(sea):
    before = len(sea.keeper.records)
    sea.autopilot.decide(Request(sea.t_s, Arm(armed=True, force=True)))  # as a message without acknowledgement
    assert len(sea.keeper.records) == before
    sea.tick()
    assert sea.keeper.records[-1].modes.armed


def test_a_tick_does_not_overwrite_a_command_with_an_older_state(sea):
    tick = Tick(9, 0.9, 0.0, 0, 10.0)
    sea.autopilot.step(Inputs(tick, (), (), (), (), sea.autopilot.take_requests()))
    sea.order(Arm(armed=True, force=True))  # while the tick is published
    written = len(sea.keeper.records)
    sea.autopilot.save_resume(0.9, UTC_S)
    assert len(sea.keeper.records) == written
    assert sea.keeper.records[-1].modes.armed


def test_a_new_plan_is_acknowledged_when_the_old_progress_is_removed(sea):
    sea.order(SetMissionItem(3))
    answers = []
    other = Plan.of(PlanKind.MISSION, [PlanItem(16, 3, x=77)])
    sea.autopilot.replace_plan(Request(sea.t_s, ReplacePlan(other)), answers.append)
    sea.keeper.plans.pop()(True)
    assert sea.keeper.records[-1].mission.index == 0
    assert answers == []
    sea.keeper.answer()
    assert [answer.verdict for answer in answers] == [Verdict.ACCEPTED]


def test_a_parameter_that_changes_the_record_is_on_disk_together_with_it(sea):
    sea.order(EnableFence(enabled=True))
    sea.autopilot.decide(Request(sea.t_s, SetParameter("FENCE_ENABLE", 1)))
    sea.autopilot.when_stored(sea.answers.append)
    assert sea.keeper.records[-1].fence_enabled is None
    off = Sea(0)
    off.tick()
    off.autopilot.decide(Request(off.t_s, SetParameter("BOOT_RESUME", 2)))
    off.autopilot.when_stored(off.answers.append)
    assert len(off.keeper.records) == 1


def test_with_a_hanging_disk_the_waiting_callbacks_are_limited(sea):
    for number in range(AWAITED_LIMIT + 3):
        sea.order(SetHome(number * 1e-3, 0.0))
        sea.autopilot.take_requests()
    assert sea.answers == [False] * 3
    sea.keeper.answer()
    assert sea.answers == [False] * 3 + [True] * AWAITED_LIMIT
    sea.order(SetHome(1.5, 0.0))
    sea.keeper.answer()
    assert sea.answers[-1] is True


def drained(sea):
    """Give goals until no write is to be spared for them."""
    number = 0
    while sea.keeper.waiting or number == 0:
        sea.keeper.answer()
        number += 1
        sea.order(SetHome(number * 1e-4, 0.0))
        sea.autopilot.take_requests()
    assert BURST / 2 < len(sea.keeper.records) < BURST
    sea.answers.clear()
    return len(sea.keeper.records)


def test_fast_goals_are_acknowledged_together_and_commands_are_not_delayed(sea):
    written = drained(sea)
    sea.order(SetHome(1.5, 0.0))
    assert (len(sea.keeper.records), sea.keeper.waiting) == (written, [])
    sea.tick(seconds=1.0 / RATE_HZ)
    sea.keeper.answer()
    assert sea.keeper.records[-1].home.latitude_rad == 1.5
    assert sea.answers == [True, True]
    sea.order(SetHome(1.4, 0.0))
    sea.answers.clear()
    sea.order(Arm(armed=True, force=True))
    sea.keeper.answer()
    assert sea.answers == [True, True]  # the record of the order holds the goal


def test_waiting_callbacks_are_called_when_resume_is_switched_off(sea):
    drained(sea)
    sea.autopilot.decide(Request(sea.t_s, SetParameter("BOOT_RESUME", 0)))
    sea.tick()
    sea.keeper.answer()
    assert sea.answers == [True]


def set_radius(sea, number):
    sea.autopilot.decide(Request(sea.t_s, SetParameter("LOIT_RADIUS", 50.0 + number % 100)))
    sea.autopilot.when_stored(sea.answers.append)
    return sea.keeper.answer()


def test_fast_parameter_changes_are_written_together_and_each_is_acknowledged(sea):
    set_radius(sea, 7)
    assert sea.keeper.parameters == [{"LOIT_RADIUS": 57.0}]  # before any tick
    for number in range(40 * 90):  # a station gone mad: forty a tick, for nine seconds
        set_radius(sea, number)
        if number % 40 == 39:
            sea.tick()
            sea.keeper.answer()
    assert 1000 <= len(sea.keeper.parameters) <= 1010
    sea.tick(seconds=1.0 / PARAMETER_RATE_HZ)
    sea.keeper.answer()
    assert sea.keeper.parameters[-1] == {"LOIT_RADIUS": 50.0 + (40 * 90 - 1) % 100}
    assert len(sea.answers) == 40 * 90 + 1


def test_pending_parameters_are_written_at_the_end(sea):
    for number in range(1200):
        set_radius(sea, number)
        if number % 40 == 0:
            sea.tick()
    assert sea.keeper.parameters[-1] != {"LOIT_RADIUS": 149.0}
    sea.autopilot.save_resume(sea.t_s, UTC_S, last=True)
    assert sea.keeper.parameters[-1] == {"LOIT_RADIUS": 149.0}


def test_a_parameter_file_is_one_write_and_unawaited_changes_are_written_with_the_tick(sea):
    changes = {"LOIT_RADIUS": 60.0, "RUD_LIMIT_DEG": 30.0}
    requests = [Request(sea.t_s, SetParameter(name, value)) for name, value in changes.items()]
    assert sea.autopilot.decide_together(requests).verdict is Verdict.ACCEPTED
    assert sea.keeper.parameters == []
    sea.tick()
    assert sea.keeper.parameters == [changes]


def test_a_reset_of_parameters_follows_earlier_changes(sea):
    sea.autopilot.decide(Request(sea.t_s, SetParameter("LOIT_RADIUS", 60.0)))
    sea.autopilot.decide(Request(sea.t_s, ForgetParameters()))
    assert sea.keeper.parameters == [{"LOIT_RADIUS": 60.0}, "forgotten"]
    sea.tick()
    assert len(sea.keeper.parameters) == 2


@pytest.mark.parametrize("room", [0, 1])
def test_requests_together_are_accepted_all_or_none_beyond_the_limit(sea, room):
    for _ in range(PENDING_LIMIT - room):
        sea.autopilot.decide(Request(sea.t_s, SetParameter("LOIT_RADIUS", 60.0)))
    before = sea.autopilot.parameters()
    pair = [Request(sea.t_s, SetParameter(name, 20.0)) for name in ("LOIT_RADIUS", "RUD_LIMIT_DEG")]
    assert sea.autopilot.decide_together(pair).verdict is Verdict.TEMPORARILY_REJECTED
    assert sea.autopilot.parameters() is before


def test_requests_together_are_refused_if_one_is_refused(sea):
    before = sea.autopilot.parameters()
    pair = [Request(sea.t_s, SetParameter("LOIT_RADIUS", value)) for value in (60.0, -1e9)]
    assert sea.autopilot.decide_together(pair).verdict is Verdict.DENIED
    assert sea.autopilot.parameters() is before
    assert sea.autopilot.take_requests() == ()
