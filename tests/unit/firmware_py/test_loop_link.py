"""The fixed-rate loop: service of the link and the store between the ticks."""

import math

import pytest

from firmware_py.common.intents import (
    Arm,
    ManualRudder,
    ReplacePlan,
    Request,
    SetMode,
    SteerHeading,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.faults.table import Fault
from firmware_py.plans.items import Command
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.state_directory import PLAN_FILES
from support.loop_parts import FakeLink, FakeStore, event_texts, make_boat, run_for, set_parameter, ticks


@pytest.fixture
def boat():
    """Return the parts of the loop on a boat whose devices, link and store are fakes."""
    return make_boat()


MAX_PENDING = 256


@pytest.mark.parametrize("faulty_call", ["service", "publish", "store"])
def test_error_in_the_link_is_reported_and_does_not_end_the_loop(boat, faulty_call):
    printed, errors = [], iter([KeyError("inside")])
    boat.fault_barrier = FaultBarrier(printed.append)

    def raise_error(*_):
        for error in errors:
            raise error

    if faulty_call == "service":
        boat.clock.arrivals = [(0.15, FakeLink.DESCRIPTOR)]
        boat.link.on_service = raise_error
    elif faulty_call == "publish":
        boat.link.publish = raise_error
    else:
        boat.clock.arrivals = [(0.15, boat.store.fileno())]
        boat.store.service = lambda: (boat.clock.arrivals.clear(), raise_error())
    run_for(boat, 1.0)
    assert event_texts(boat).count("Link error KeyError; autopilot unaffected") == 1
    assert printed[-1] == "KeyError: 'inside'"
    assert len(ticks(boat)) == pytest.approx(10, abs=1)


@pytest.mark.parametrize("descriptor", [FakeLink.DESCRIPTOR, FakeStore.DESCRIPTOR])
def test_loop_does_not_wait_on_a_connection_closed_by_service(boat, descriptor):
    """The service of the link or a callback of the store may close a connection of the link."""
    boat.clock.arrivals = [(0.137, descriptor)]
    new_descriptor = 21

    def close(*_):
        boat.clock.arrivals.clear()
        boat.link.descriptors = lambda: [new_descriptor]

    boat.link.service = boat.store.service = close
    run_for(boat, 0.35)
    waits = [(now_s, descriptors) for now_s, _, descriptors in boat.clock.waits]
    assert any(FakeLink.DESCRIPTOR in descriptors for now_s, descriptors in waits if now_s < 0.137)
    assert not any(FakeLink.DESCRIPTOR in descriptors for now_s, descriptors in waits if now_s >= 0.137)
    assert any(new_descriptor in descriptors for now_s, descriptors in waits if now_s == 0.137)


def test_link_is_not_served_shortly_before_a_deadline(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.clock.arrivals = [(t_s, FakeLink.DESCRIPTOR) for t_s in (0.15, 0.1968, 0.2972)]
    run_for(boat, 0.5)
    service_times_s = [t_s for call, t_s in boat.link.call_log if call == "service"]
    assert service_times_s[:2] == pytest.approx([0.15, 0.1968])
    assert service_times_s[2] >= 0.3 - 1e-9  # the data arrive within the guard time of 3 ms


def test_remaining_link_data_are_served_before_waiting(boat):
    boat.link.publish = lambda _output, now_s: setattr(boat.link, "pending_calls", 3 if 0.09 < now_s < 0.11 else 0)
    run_for(boat, 0.35)
    service_times_s = [t_s for call, t_s in boat.link.call_log if call == "service"]
    assert service_times_s == pytest.approx([0.1, 0.1, 0.1], abs=0.001)


def test_request_is_decided_at_once_and_is_an_input_of_the_next_tick(boat):
    answers = []
    boat.clock.arrivals = [(0.15, FakeLink.DESCRIPTOR)]

    def on_service(now_s):
        intents = (Arm(armed=True), SetMode(Mode.GUIDED), SteerHeading(2.0), SteerHeading(math.nan))
        answers.extend(boat.autopilot.decide(Request(now_s, intent, 255, 190)).verdict for intent in intents)

    boat.link.on_service = on_service
    run_for(boat, 0.5)
    assert answers == [Verdict.ACCEPTED] * 3 + [Verdict.DENIED]
    (with_requests,) = [inputs for inputs, _, _ in boat.recorder.ticks if inputs.requests]
    assert with_requests.tick.t_s == pytest.approx(0.2, abs=0.01)
    assert len(with_requests.requests) == 3
    assert boat.link.outputs[-1].snapshot.goal_heading_rad == pytest.approx(2.0)


def test_flood_on_the_link_has_a_limited_share_and_delays_no_tick(boat):
    """Linux suspends a real-time process that uses all of the processor."""
    boat.link.pending_calls = 10**6

    def on_service(_now_s):
        boat.clock.t_s += 0.001

    boat.link.on_service = on_service
    run_for(boat, 1.0)
    service_count = sum(call == "service" for call, _ in boat.link.call_log)
    assert service_count == pytest.approx(9 * 75, abs=9)  # three quarters of nine periods
    assert all(inputs.tick.late_s < 1e-9 for inputs, _, _ in boat.recorder.ticks)


def test_busy_link_has_a_longer_guard_time(boat):
    """A call of the link that becomes slow for a moment must end before the tick."""
    set_parameter(boat, "LOOP_RATE_HZ", 50)
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 0.5)
    boat.link.pending_calls = 10**6

    def on_service(now_s):
        calls.append(now_s)
        boat.clock.t_s += 0.00095

    def publish(output, now_s):
        outputs.append(output)
        boat.clock.t_s += 0.014 if len(outputs) % 10 == 0 else 0.0  # a slow tick leaves a short remainder of its period

    calls, outputs = [], []
    boat.link.on_service, boat.link.publish = on_service, publish
    run_for(boat, 1.5)
    deadlines_s = [tick.t_s for tick in ticks(boat)]
    margins_s = [min(deadline_s for deadline_s in deadlines_s if deadline_s > now_s) - now_s for now_s in calls[:400]]
    assert len(calls) >= 400
    assert min(margins_s) == pytest.approx(0.0105, abs=2e-4)  # 11 calls in a half of the period


@pytest.mark.parametrize(("calls", "is_busy"), [(10, False), (11, True)])
def test_link_that_has_used_a_tenth_of_a_period_is_busy_in_this_one_and_the_next(boat, calls, is_busy):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.clock.arrivals = [(t_s, FakeLink.DESCRIPTOR) for t_s in (0.11, 0.1883, 0.2883, 0.3883)]
    served_s = []

    def on_service(now_s):
        if now_s == 0.11:
            boat.link.pending_calls = calls - 1
        if now_s < 0.15:
            boat.clock.t_s += 0.00095
        else:
            served_s.append(now_s)

    boat.link.on_service = on_service
    run_for(boat, 0.5)
    assert served_s == pytest.approx([0.2, 0.3, 0.3883] if is_busy else [0.1883, 0.2883, 0.3883])


def test_guard_time_of_a_busy_link_is_12_ms(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.clock.arrivals = [(0.1453, FakeLink.DESCRIPTOR)]
    calls = []

    def on_service(now_s):
        calls.append(now_s)
        boat.link.pending_calls = 10**6 if now_s < 0.2 else 0
        boat.clock.t_s += 0.00095

    boat.link.on_service = on_service
    run_for(boat, 0.3)
    assert max(now_s for now_s in calls if now_s < 0.2) == pytest.approx(0.1871)


GLOBAL_RELATIVE_ALT_INT = 6  # MAV_FRAME
MISSION = Plan.of(PlanKind.MISSION, (PlanItem(Command.WAYPOINT, GLOBAL_RELATIVE_ALT_INT, x=1, y=2),))


def test_plan_is_active_once_it_is_on_disk_and_is_an_input_of_the_next_tick(boat):
    answers = []
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(MISSION)), answers.append)
    assert (answers, boat.autopilot.plans()) == ([], Plans())
    assert plan_from_text(boat.store.saved[PLAN_FILES[PlanKind.MISSION]].decode())[0] == MISSION
    boat.store.service()
    assert [answer.verdict for answer in answers] == [Verdict.ACCEPTED]
    assert boat.autopilot.plans().mission is MISSION
    run_for(boat, 0.2)
    assert boat.link.outputs[-1].snapshot.mission.identities == (MISSION.identity, 0, 0)
    assert boat.recorder.ticks[0][0].requests[0].intent == ReplacePlan(MISSION)


def test_plan_that_is_refused_or_cannot_be_stored_keeps_the_old_one(boat):
    answers = []
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(MISSION)), answers.append)
    boat.store.callbacks.pop(0)(False)
    too_long = Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT)] * 2001)
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(too_long)), answers.append)
    assert [answer.verdict for answer in answers] == [Verdict.FAILED, Verdict.DENIED]
    assert boat.autopilot.plans() == Plans()


def test_number_of_pending_requests_is_limited(boat):
    verdicts = {boat.autopilot.decide(Request(0.0, ManualRudder(0.1))).verdict for _ in range(MAX_PENDING)}
    assert verdicts == {Verdict.ACCEPTED}
    assert boat.autopilot.decide(Request(0.0, ManualRudder(0.1))).verdict is Verdict.TEMPORARILY_REJECTED


def test_store_failure_is_a_storage_fault(boat):
    boat.store.failure = "parameters.param cannot be stored: No space left on device"
    run_for(boat, 4.0)
    assert boat.link.outputs[-1].snapshot.faults == 1 << Fault.STORAGE_FAILING
