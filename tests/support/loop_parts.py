"""Parts of the loop on a boat whose clock, devices, link and store are fakes."""

import pytest

from firmware_py.common import records
from firmware_py.common.intents import (
    Request,
    SetParameter,
)
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceRole, DeviceState, HeadingSample, NorthReference, RudderFeedback
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.state import State
from firmware_py.loop import LoopParts, run
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.state_directory import StateDirectory


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
        assert len(self.waits) < 4000, "the loop does not end"
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


def make_boat():
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
