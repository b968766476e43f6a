"""The fixed-rate loop with a simulated clock: ticks, link service, plans, restart, safe end."""

import itertools
import math
from dataclasses import fields

import pytest

from firmware_py.common import records
from firmware_py.common.intents import (
    Arm,
    ForgetParameters,
    ManualRudder,
    ReplacePlan,
    Request,
    Restart,
    SetMode,
    SetParameter,
    SteerHeading,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet, parse_file
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.records import DeviceRole, DeviceState, HeadingSample, NorthReference, RudderFeedback
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import from_bytes as resume_from_bytes
from firmware_py.core.state import State
from firmware_py.faults.table import Fault
from firmware_py.loop import LoopParts, make_safe, run
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.state_directory import PARAMETER_FILE, PLAN_FILES, RESUME_FILE, StateDirectory

MAX_PENDING = 256
SAFE_INTERVAL_S = 0.1


class FakeClock:
    """Advances only in `wait`; tests add the duration of work. `arrivals`: when descriptors become readable."""

    def __init__(self):
        self.t_s = 0.0
        self.arrivals = []  # (time, descriptor)
        self.waits = []

    def now_s(self):
        return self.t_s

    def utc_s(self):
        return 1e9 + self.t_s

    def wait(self, deadline_s, descriptors):
        self.waits.append((self.t_s, deadline_s, tuple(descriptors)))
        due_arrivals = sorted(entry for entry in self.arrivals if entry[0] <= deadline_s and entry[1] in descriptors)
        if not due_arrivals:
            self.t_s = max(self.t_s, deadline_s)
            return []
        if due_arrivals[0][1] != FakeLink.DESCRIPTOR:  # the link remains readable until it is served
            self.arrivals.remove(due_arrivals[0])
        self.t_s = max(self.t_s, due_arrivals[0][0])
        return [due_arrivals[0][1]]


class FakeDevice:
    """A device that records when it is read; the next poll returns `samples`."""

    def __init__(self, role, descriptor=-1):
        self.role, self.descriptor = role, descriptor
        self.samples, self.receive_times_s = [], []

    def fileno(self):
        return self.descriptor

    def receive(self, now_s):
        self.receive_times_s.append(now_s)

    def poll(self):
        samples, self.samples = self.samples, []
        return samples

    def health(self, now_s):
        return records.DeviceHealth(now_s, self.role, DeviceState.RUNNING, len(self.receive_times_s), 0)


class FakeCompass(FakeDevice):
    """A compass with a sample at each read."""

    def receive(self, now_s):
        super().receive(now_s)
        self.samples.append(HeadingSample(now_s, 1.0, NorthReference.TRUE))


class FakePosition(FakeDevice):
    """A receiver with a fix at each poll."""

    def poll(self):
        return [records.PositionSample(0.0, records.FixType.FIX_3D, 0.1, 0.2, utc_s=2e9)]


class FakeRudder(FakeDevice):
    """A servo that reaches each command at once, or remains where it is (`is_stuck`)."""

    def __init__(self, call_log):
        super().__init__(DeviceRole.RUDDER)
        self.call_log = call_log
        self.commands = []
        self.is_stuck = False
        self.prompt_replies = 0  # number of replies that need prompt I/O

    def command(self, command, now_s):
        self.call_log.append(("command", now_s))
        self.commands.append((now_s, command))
        self.samples.append(RudderFeedback(now_s + 0.002, 0.3 if self.is_stuck else command.shaft_rad))

    def needs_prompt_io(self):
        return self.prompt_replies > 0

    def receive(self, now_s):
        super().receive(now_s)
        self.prompt_replies = max(0, self.prompt_replies - 1)


class FakeLink:
    """A link that records its calls; it is busy for `pending_calls` more calls of `service`."""

    DESCRIPTOR = 20

    def __init__(self, call_log):
        self.call_log = call_log
        self.outputs = []
        self.on_service = lambda _now_s: None
        self.pending_calls = 0
        self.station_s = None
        self.key_problem = ""

    @property
    def busy(self):
        return self.pending_calls > 0

    def descriptors(self):
        return [self.DESCRIPTOR]

    def service(self, now_s, ready):
        assert list(ready) == ([] if self.pending_calls else [self.DESCRIPTOR])
        if ready:
            self.clock.arrivals.remove(min(entry for entry in self.clock.arrivals if entry[1] == self.DESCRIPTOR))
        self.pending_calls = max(0, self.pending_calls - 1)
        self.call_log.append(("service", now_s))
        self.on_service(now_s)

    def publish(self, output, now_s):
        self.call_log.append(("publish", now_s))
        self.outputs.append(output)


class FakeRecorder:
    """A recorder that keeps inputs, output and previous state of each tick."""

    def __init__(self):
        self.ticks = []

    def offer(self, inputs, output, previous_state):
        self.ticks.append((inputs, output, previous_state()))

    def health(self, now_s):
        return records.DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.RUNNING, len(self.ticks), 0)


class FakeStore:
    """A store in memory; `service` calls the callbacks of what has been stored."""

    DESCRIPTOR = 30

    def __init__(self):
        self.saved, self.callbacks, self.failure = {}, [], ""

    def fileno(self):
        return self.DESCRIPTOR

    def load(self, name):
        return self.saved.get(name)

    def save(self, name, content):
        self.saved[name] = content

    def try_save(self, name, content, callback):
        self.saved[name] = content
        self.callbacks.append(callback)

    def when_stored(self, _names, callback):
        self.callbacks.append(callback)

    def on_mount(self, _names, _callback):
        """Do nothing: the store is available from the start."""

    def service(self):
        while self.callbacks:
            self.callbacks.pop(0)(True)


@pytest.fixture
def boat():
    """Return the parts of the loop on a boat whose devices, link and store are fakes."""
    call_log = []
    store = FakeStore()
    link, clock = FakeLink(call_log), FakeClock()
    link.clock = clock
    autopilot = Autopilot(State.at_start(ParameterSet()), StateDirectory(store, pytest.fail))
    return LoopParts(
        clock=clock,
        autopilot=autopilot,
        compass=FakeCompass(DeviceRole.COMPASS, 10),
        position=None,
        rudder=FakeRudder(call_log),
        link=link,
        recorder=FakeRecorder(),
        store=store,
        lines=[],
        print_event=lambda _event: None,
        fault_barrier=FaultBarrier(pytest.fail),  # tests that cause errors replace it
    )


def run_for(boat, seconds):
    # `run` makes one more tick after the stop, so it is stopped one period earlier.
    last_s = boat.clock.t_s + seconds - 1.0 / boat.autopilot.parameters()["LOOP_RATE_HZ"]
    run(boat, lambda: boat.clock.t_s >= last_s - 1e-9)


def ticks(boat):
    return [inputs.tick for inputs, _, _ in boat.recorder.ticks]


def set_parameter(boat, name, value):
    return boat.autopilot.decide(Request(boat.clock.t_s, SetParameter(name, value)))


def event_texts(boat):
    return [event.text for _, output, _ in boat.recorder.ticks for event in output.events]


def test_ticks_start_at_their_absolute_deadlines(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 2.0)
    assert [tick.index for tick in ticks(boat)] == list(range(len(ticks(boat))))
    assert [tick.t_s for tick in ticks(boat)] == pytest.approx([0.1 * index for index in range(len(ticks(boat)))])
    assert all(tick.late_s == 0.0 and tick.skipped == 0 for tick in ticks(boat))


def test_rudder_command_is_sent_before_the_link_publishes(boat):
    run_for(boat, 0.25)
    order = [call for call, _ in boat.link.call_log if call in ("command", "publish")]
    assert order[:4] == ["command", "publish", "command", "publish"]


def test_deadlines_missed_in_a_stall_are_skipped_in_phase_and_reported(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    stall = iter([0.0] * 5 + [0.73])

    def publish(output, now_s):
        boat.clock.t_s += next(stall, 0.0)

    boat.link.publish = publish
    run_for(boat, 3.0)
    assert sum(tick.skipped for tick in ticks(boat)) == 6
    late_tick = next(tick for tick in ticks(boat) if tick.skipped)
    assert late_tick.t_s == pytest.approx(1.2)
    assert late_tick.late_s == pytest.approx(0.03)
    assert ticks(boat)[-1].t_s == pytest.approx(round(ticks(boat)[-1].t_s, 1))


class FakeLine:
    """A closed port that records the times at which it is reopened."""

    written = 0

    def __init__(self):
        self.reopen_times_s = []

    def reopen(self, now_s):
        self.reopen_times_s.append(now_s)


def test_last_tick_opens_no_port(boat):
    """After the harness is killed, another process may own the paths of its ptys."""
    line = FakeLine()
    boat.lines = [line]
    run_for(boat, 1.0)
    assert line.reopen_times_s == [tick.t_s + tick.late_s for tick in ticks(boat)[:-1]]


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


def test_sample_is_read_when_it_arrives(boat):
    boat.clock.arrivals = [(0.137, 10)]
    run_for(boat, 0.3)
    assert 0.137 in boat.compass.receive_times_s


def test_servo_reply_wakes_the_loop_only_if_prompt_io_is_needed(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    boat.rudder.descriptor = 11
    boat.clock.arrivals = [(0.104, 11), (0.214, 11), (0.216, 11)]

    def publish(_output, now_s):
        boat.rudder.prompt_replies = 1 if now_s == pytest.approx(0.2) else 0

    boat.link.publish = publish
    run_for(boat, 0.35)
    receive_times_s = [now_s for now_s in boat.rudder.receive_times_s if now_s < 0.35]
    assert receive_times_s[:5] == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.3], abs=1e-3)


def test_loop_does_not_wait_on_a_closed_port(boat):
    boat.clock.arrivals = [(0.137, 10), (0.15, 10)]
    boat.compass.receive = lambda now_s: setattr(boat.compass, "fileno", lambda: -1) if now_s > 0.13 else None
    run_for(boat, 0.35)
    wait_times_s = [now_s for now_s, _, descriptors in boat.clock.waits if 10 in descriptors]
    assert max(wait_times_s) < 0.137
    assert not any(-1 in descriptors for _, _, descriptors in boat.clock.waits)


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


def test_battery_monitor_is_read_at_the_ticks(boat):
    power = FakeDevice(DeviceRole.POWER, 12)
    boat.power = (power,)
    boat.__post_init__()
    boat.clock.arrivals = [(0.137, power.fileno())]
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 0.35)
    assert power.receive_times_s == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("is_prompt", [True, False])
def test_second_compass_wakes_the_loop_unless_it_is_a_gyroscope(boat, is_prompt):
    boat.compass_b, boat.compass_b_is_prompt = FakeCompass(DeviceRole.COMPASS_B, 12), is_prompt
    boat.__post_init__()
    assert boat.compass_b in boat.devices
    boat.clock.arrivals = [(0.137, 12)]
    set_parameter(boat, "LOOP_LOCK", 0)
    run_for(boat, 0.35)
    expected_s = [0.0, 0.1, 0.137, 0.2, 0.3] if is_prompt else [0.0, 0.1, 0.2, 0.3]
    assert boat.compass_b.receive_times_s == pytest.approx(expected_s)


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


def test_ticks_drift_to_shortly_after_the_compass_samples(boat):
    boat.compass.receive = lambda now_s: None
    boat.clock.arrivals = []
    phase_s = 0.04

    def poll():
        newest_s = phase_s + 0.1 * math.floor((boat.clock.t_s - phase_s) / 0.1 + 1e-9)
        return [HeadingSample(newest_s, 1.0, NorthReference.TRUE)] if newest_s > 0.0 else []

    boat.compass.poll = poll
    run_for(boat, 60.0)
    assert (ticks(boat)[-1].t_s - phase_s) % 0.1 == pytest.approx(0.002, abs=2e-4)


@pytest.mark.parametrize(
    ("tick_on_compass", "lock", "sample_s", "is_complete", "start_s"),
    [
        (True, 1, 0.098, True, 0.098),
        (True, 1, 0.098, False, 0.1),  # the sentence is incomplete
        (True, 1, 0.0962, True, 0.0962),
        (True, 1, 0.0958, True, 0.1),  # more than 4 ms before the deadline
        (True, 0, 0.098, True, 0.1),
        (False, 1, 0.098, True, 0.1),  # in lockstep with a simulator
    ],
)
def test_tick_starts_with_the_sample_that_it_is_locked_to(boat, tick_on_compass, lock, sample_s, is_complete, start_s):
    boat.tick_on_compass = tick_on_compass
    set_parameter(boat, "LOOP_LOCK", lock)
    receive = boat.compass.receive
    boat.compass.receive = lambda now_s: receive(now_s) if now_s == sample_s and is_complete else None
    boat.clock.arrivals = [(sample_s, boat.compass.fileno())]
    run_for(boat, 0.25)
    samples = [sample.t_s for inputs, _, _ in boat.recorder.ticks for sample in inputs.headings]
    assert samples == ([sample_s] if is_complete else [])
    second, third = ticks(boat)[1:3]
    assert (second.t_s, second.late_s, third.t_s) == (pytest.approx(start_s), 0.0, pytest.approx(0.2, abs=6e-4))
    assert [time_s for call, time_s in boat.link.call_log if call == "command"][1] == pytest.approx(start_s)


def test_request_is_answered_at_once_and_is_an_input_of_the_next_tick(boat):
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


def test_garbage_is_collected_once_a_minute(boat, monkeypatch):
    times_s = []
    monkeypatch.setattr("firmware_py.loop.gc.collect", lambda: times_s.append(boat.clock.t_s))
    set_parameter(boat, "LOOP_RATE_HZ", 1)
    run_for(boat, 125.0)
    assert times_s == pytest.approx([60.0, 120.0], abs=1.01)


def test_accepted_parameter_is_used_at_once_and_stored(boat):
    answer = set_parameter(boat, "CTL_K1", 44.4)
    assert answer.verdict is Verdict.ACCEPTED
    value = boat.autopilot.parameters()["CTL_K1"]
    assert value == pytest.approx(44.4)
    boat.autopilot.when_stored(lambda _is_stored: None)
    assert parse_file(boat.store.saved[PARAMETER_FILE].decode(), "x") == {"CTL_K1": value}
    assert set_parameter(boat, "CTL_K1", math.inf).verdict is Verdict.DENIED
    assert parse_file(boat.store.saved[PARAMETER_FILE].decode(), "x") == {"CTL_K1": value}


def resume_record(boat):
    return resume_from_bytes(boat.store.saved[RESUME_FILE])[0]


def test_resume_record_is_updated_at_start_ticks_and_end(boat):
    set_parameter(boat, "BOOT_RESUME", 2)
    armed_states = []  # (time, armed in the record)
    boat.link.publish = lambda output, now_s: armed_states.append((now_s, resume_record(boat).modes.armed))
    boat.link.on_service = lambda now_s: boat.autopilot.decide(Request(now_s, Arm(armed=True, force=True)))
    boat.clock.arrivals.append((0.33, FakeLink.DESCRIPTOR))
    run_for(boat, 0.75)
    # The record of a tick is saved after its publication, so it is seen in the next one.
    arming_tick_s = next(tick.t_s for tick in ticks(boat) if tick.t_s > 0.33)
    assert [armed for now_s, armed in armed_states if now_s <= arming_tick_s] == [False] * 5
    assert all(armed for now_s, armed in armed_states if now_s > arming_tick_s)
    boat.autopilot.decide(Request(boat.clock.t_s, SetMode(int(Mode.MANUAL))))
    run(boat, lambda: True)
    assert resume_record(boat).modes.mode is Mode.MANUAL


def test_no_resume_record_without_boot_resume(boat):
    run_for(boat, 1.0)
    assert RESUME_FILE not in boat.store.saved


def test_restart_ends_the_loop_after_the_logged_tick_with_a_centred_rudder(boat):
    assert boat.autopilot.decide(Request(0.0, Restart())).verdict is Verdict.ACCEPTED
    run_for(boat, 10.0)
    assert len(ticks(boat)) == 1
    assert boat.recorder.ticks[0][0].requests[0].intent == Restart()
    assert boat.autopilot.restart == Restart()
    assert boat.rudder.commands[-1][1].torque_on
    assert boat.clock.t_s < 3.0


def test_refused_restart_does_not_end_the_loop(boat):
    boat.autopilot.decide(Request(0.0, Arm(armed=True, force=True)))
    assert boat.autopilot.decide(Request(0.0, Restart(shutdown=True))).verdict is Verdict.TEMPORARILY_REJECTED
    run_for(boat, 1.0)
    assert boat.autopilot.restart is None
    assert len(ticks(boat)) > 9


def test_reset_deletes_stored_parameters_and_keeps_the_present_values(boat):
    set_parameter(boat, "CTL_K1", 44.0)
    boat.autopilot.decide(Request(0.0, ForgetParameters()))
    assert boat.store.saved[PARAMETER_FILE] == b""
    assert boat.autopilot.parameters()["CTL_K1"] == 44.0
    set_parameter(boat, "CTL_K2", 0.5)
    boat.autopilot.when_stored(lambda _is_stored: None)
    assert boat.store.saved[PARAMETER_FILE] == b"CTL_K2 0.5\n"


def test_clock_step_changes_no_deadline_and_is_reported(boat):
    utc_values_s = [1000.0]
    boat.clock_setter = ClockSetter(
        lambda: utc_values_s[0], lambda utc_s: utc_values_s.append(utc_s) or True, lambda: False
    )
    boat.position = FakePosition(DeviceRole.POSITION)
    run_for(boat, 2.0)
    set_parameter(boat, "LOOP_LOCK", 0)
    assert utc_values_s[1:] == pytest.approx([2e9], abs=3.0)
    times_s = [tick.t_s for tick in ticks(boat)]
    intervals_s = [later - earlier for earlier, later in itertools.pairwise(times_s)]
    assert intervals_s == pytest.approx([0.1] * len(intervals_s), abs=1e-3)
    clock_texts = [event.text for output in boat.link.outputs for event in output.events if "Clock" in event.text]
    assert clock_texts == [text for text in event_texts(boat) if "Clock" in text]
    assert len(clock_texts) == 1


MISSION = Plan.of(PlanKind.MISSION, (PlanItem(16, 6, x=1, y=2),))


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
    too_long = Plan.of(PlanKind.MISSION, [PlanItem(16)] * 2001)
    boat.autopilot.replace_plan(Request(0.0, ReplacePlan(too_long)), answers.append)
    assert [answer.verdict for answer in answers] == [Verdict.FAILED, Verdict.DENIED]
    assert boat.autopilot.plans() == Plans()


def test_loop_rate_follows_its_parameter(boat):
    set_parameter(boat, "LOOP_LOCK", 0)
    set_parameter(boat, "LOOP_RATE_HZ", 50)
    run_for(boat, 2.0)
    times_s = [tick.t_s for tick in ticks(boat)]
    assert [later - earlier for earlier, later in itertools.pairwise(times_s[2:])] == pytest.approx(
        [0.02] * (len(times_s) - 3)
    )
    assert ticks(boat)[-1].rate_hz == 50


def test_number_of_pending_requests_is_limited(boat):
    verdicts = {boat.autopilot.decide(Request(0.0, ManualRudder(0.1))).verdict for _ in range(MAX_PENDING)}
    assert verdicts == {Verdict.ACCEPTED}
    assert boat.autopilot.decide(Request(0.0, ManualRudder(0.1))).verdict is Verdict.TEMPORARILY_REJECTED


def test_health_is_an_input_only_when_it_changes(boat):
    run_for(boat, 1.0)
    counts = [len(inputs.devices) for inputs, _, _ in boat.recorder.ticks]
    assert counts[1] == 3
    assert sum(counts) == 3


def test_store_failure_is_a_storage_fault(boat):
    boat.store.failure = "parameters.param cannot be stored: No space left on device"
    run_for(boat, 4.0)
    assert boat.link.outputs[-1].snapshot.faults == 1 << Fault.STORAGE_FAILING


def test_rudder_is_centred_when_an_error_ends_the_loop(boat):
    def raise_error(output, now_s):
        raise RuntimeError("unexpected")

    boat.link.publish = raise_error
    boat.fault_barrier = FaultBarrier(lambda _line: None)  # it raises an error that is repeated too often
    with pytest.raises(RuntimeError, match="unexpected"):
        run_for(boat, 1.0)
    assert boat.rudder.commands[-1][1].shaft_rad == 0.0
    assert boat.rudder.commands[-1][1].torque_on


def test_rudder_that_passes_the_centre_is_not_yet_safe(boat):
    run_for(boat, 1.0)
    # The rudder is still at 0.2 rad at the first reading; 0.02 rad and more is not centred.
    angles_rad = iter((0.2, 0.019, 0.021, -0.4, -0.021, -0.019, 0.0))
    boat.rudder.commands.clear()
    boat.rudder.command = lambda command, now_s: (
        boat.rudder.commands.append((now_s, command)),
        boat.rudder.samples.append(RudderFeedback(now_s + 0.002, next(angles_rad))),
    )
    make_safe(boat)
    assert len(boat.rudder.commands) == 7
    assert next(angles_rad, None) is None


def test_centred_rudder_ends_the_loop_after_two_readings(boat):
    run_for(boat, 1.0)
    begin_s = boat.clock.t_s
    make_safe(boat)
    assert boat.clock.t_s - begin_s <= 2 * SAFE_INTERVAL_S + 1e-9


def test_stuck_rudder_does_not_prevent_the_end(boat):
    boat.rudder.is_stuck = True
    run_for(boat, 0.2)
    begin_s = boat.clock.t_s
    boat.rudder.commands.clear()
    make_safe(boat)
    assert boat.clock.t_s - begin_s == pytest.approx(2.0)
    times_s = [t_s - begin_s for t_s, _ in boat.rudder.commands]
    assert times_s == pytest.approx([0.1 * number for number in range(20)])


def test_start_problems_are_reported_with_the_first_tick(boat):
    problem = records.Event(records.Severity.WARNING, "mission.plan.0 is damaged: there is no mission")
    boat.notices.append(problem)
    run_for(boat, 1.0)
    reported = [problem in output.events for output in boat.link.outputs]
    assert reported == [problem in output.events for _, output, _ in boat.recorder.ticks]
    assert (reported[0], sum(reported)) == (True, 1)


def test_wind_and_depth_are_read_after_the_command_and_passed_to_the_next_tick(boat):
    parts = {field.name: getattr(boat, field.name) for field in fields(LoopParts) if field.init}
    wind, depth, vessels = (FakeDevice(role) for role in (DeviceRole.WIND, DeviceRole.DEPTH, DeviceRole.AIS))
    order = []
    for device in (wind, depth, vessels):
        device.receive = lambda _now_s, device=device: order.append(device)
    wind.samples = [records.WindSample(0.0, 5.0, 1.0, records.WindReference.APPARENT)]
    depth.samples = [records.DepthSample(0.0, 12.0)]
    loop_parts = LoopParts(**parts | {"wind": wind, "depth": depth, "vessels": vessels})
    run_for(loop_parts, 0.2)
    first, second = (inputs for inputs, _, _ in boat.recorder.ticks)
    assert [sample.wind_m_s for sample in first.wind] == [5.0]
    assert [sample.depth_m for sample in first.depth] == [12.0]
    assert (second.wind, second.depth) == ((), ())
    assert order == [wind, depth, vessels] * 2  # the order of the views of a shared line
    roles = set(loop_parts.health.latest)
    assert {DeviceRole.WIND, DeviceRole.DEPTH, DeviceRole.AIS} <= roles
    assert wind not in loop_parts.devices  # a silent sensor does not keep the process from a restart
