"""The fixed-rate loop: wait, poll, step, actuate, record, publish; the link is served in the slack."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from firmware_py.common.intents import Answer, ForgetParameters, ReplacePlan, Request, Restart, SetParameter, Verdict
from firmware_py.common.interfaces import Clock, Compass, Device, Link, Position, Recorder, Rudder
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind, Plans
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.common.records import Event, HeadingSample, Inputs, Output, RudderCommand, Tick
from firmware_py.core.resume import RESUME_FILE, ResumeKeeper
from firmware_py.core.state_codec import state_to_text
from firmware_py.core.step import State, accept, settings_of, step
from firmware_py.system.clock import Metronome
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.health import HealthMonitor
from firmware_py.system.serial_port import SerialPort
from firmware_py.system.store import Store

# Before a deadline the link is left alone for this long, or for this part of a short period.
GUARD_S = 0.003
GUARD_PART = 0.15
# A link that has had this part of a period, or of the one before, is left alone earlier. Virtual machines, and boards
# that are hot, become ten times slower for some milliseconds at any moment: a call that is under way must be at its end
# by the tick even then.
MUCH_PART = 0.1
BUSY_GUARD_S = 0.012
BUSY_GUARD_PART = 0.5
# The link gets at most this part of a period. Linux takes the processor from a real-time
# process for 50 ms in every second that it would use to more than 95 %: a flood must not
# bring it there.
LINK_PART = 0.75
# More requests than this between two ticks are turned away.
PENDING_LIMIT = 256
COLLECT_INTERVAL_S = 60.0
PARAMETER_FILE = "parameters.param"
PLAN_FILES = {PlanKind.MISSION: "mission.plan", PlanKind.FENCE: "fence.plan", PlanKind.RALLY: "rally.plan"}

SAFE_TIMEOUT_S = 2.0
SAFE_INTERVAL_S = 0.1
SAFE_ANGLE_RAD = 0.02


class Autopilot:
    """Holds the state between ticks, judges requests at once and hands them to the next step.

    `decide` computes ahead with the same pure function that the next step will use, so
    that an answer need not wait for the tick and still cannot differ from what is done.
    """

    def __init__(self, state: State, store: Store, kept: dict[str, float], format_kept: Callable[..., str]) -> None:
        """Start from a state; `kept` are the parameters that the store holds."""
        self._state = state
        self._ahead = state
        self._pending: list[Request] = []
        self._store = store
        self._kept = kept
        self._format_kept = format_kept
        self.restart: Restart | None = None  # taken by a tick: the loop ends behind it
        self._memory = ResumeKeeper()

    @property
    def state(self) -> State:
        """The state after the last step."""
        return self._state

    def decide(self, request: Request) -> Answer:
        """Judge a request at once; when accepted it is an input of the next tick."""
        if len(self._pending) >= PENDING_LIMIT:
            return Answer(Verdict.TEMPORARILY_REJECTED, "Too many requests")
        ahead, answer = accept(self._ahead, request)
        if answer.verdict is not Verdict.ACCEPTED:
            return answer
        self._ahead = ahead
        self._pending.append(request)
        if isinstance(request.intent, SetParameter):
            name = request.intent.name
            self._kept[name] = ahead.parameters[name]
            self._store.save(PARAMETER_FILE, self._format_kept(self._kept).encode())
        elif isinstance(request.intent, ForgetParameters):
            self._kept.clear()
            self._store.save(PARAMETER_FILE, b"")
        return answer

    def replace_plan(self, request: Request, done: Callable[[Answer], None]) -> None:
        """Put a plan in force once it is on disk; the old one stands until then."""
        intent = request.intent
        if not isinstance(intent, ReplacePlan):
            raise TypeError(f"{type(intent).__name__} is not a plan")
        _, answer = accept(self._ahead, request)
        if answer.verdict is not Verdict.ACCEPTED:
            done(answer)
            return

        def stored(well: bool) -> None:  # noqa: FBT001 - the store's callback
            if not well:
                done(Answer(Verdict.FAILED, "the plan could not be stored; the old one stands"))
                return
            # On disk, so nothing may turn it away any more, not even a full queue.
            self._ahead, answer = accept(self._ahead, request)
            self._pending.append(request)
            done(answer)

        self._store.save(PLAN_FILES[intent.plan.kind], plan_to_text(intent.plan).encode())
        self._store.when_stored(stored)

    def parameters(self) -> ParameterSet:
        """The values in force, accepted requests included."""
        return self._ahead.parameters

    def plans(self) -> Plans:
        """The plans in force, accepted requests included."""
        return self._ahead.plans

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back once all that was accepted so far is on disk, or cannot be."""
        self._store.when_stored(call)

    def take_requests(self) -> tuple[Request, ...]:
        """Hand over the requests since the last tick."""
        requests = tuple(self._pending)
        self._pending.clear()
        return requests

    def step(self, inputs: Inputs) -> Output:
        """Compute a tick."""
        self._state, output = step(self._state, inputs)
        self._ahead = self._state
        for request in inputs.requests:
            if isinstance(request.intent, Restart):
                self.restart = request.intent
        return output

    def remember(self, now_s: float, utc_s: float) -> None:
        """Keep what she is doing for the next start, when it has changed."""
        text = self._memory.news(self._state, self._state.parameters, now_s, utc_s)
        if text is not None:
            self._store.save(RESUME_FILE, text.encode())


@dataclass(slots=True)
class LoopParts:
    """Everything the loop drives, wired by assemble."""

    clock: Clock
    pilot: Autopilot
    compass: Compass
    position: Position | None
    rudder: Rudder
    link: Link
    recorder: Recorder | None
    store: Store
    lines: Sequence[SerialPort]
    tell: Callable[[Event], None]
    shelter: FaultBarrier
    timekeeper: ClockSetter | None = None
    compass_b: Compass | None = None
    health: HealthMonitor = field(default_factory=HealthMonitor)
    devices: tuple[Device, ...] = field(init=False)

    def __post_init__(self) -> None:
        """List the devices once."""
        fitted = (self.compass, self.compass_b, self.rudder, self.position)
        self.devices = tuple(device for device in fitted if device is not None)


def run(boat: LoopParts, stopped: Callable[[], bool]) -> None:
    """Turn the loop until stopped or asked to restart; whatever ends it, the rudder is made safe first."""
    clock = boat.clock
    metronome = Metronome(clock.now_s(), boat.pilot.parameters()["LOOP_RATE_HZ"])
    index = skipped = 0
    crowded = False
    collect_s = clock.now_s() + COLLECT_INTERVAL_S
    try:
        while not stopped() and boat.pilot.restart is None:
            crowded = _serve_until_deadline(boat, metronome, crowded)
            if stopped():
                break
            late_s = max(0.0, clock.now_s() - metronome.deadline_s)
            tick = Tick(index, metronome.deadline_s, late_s, skipped, metronome.rate_hz)
            newest = _tick(boat, tick)
            parameters = boat.pilot.state.parameters
            metronome.set_rate(parameters["LOOP_RATE_HZ"])
            if newest is not None and parameters["LOOP_LOCK"]:
                metronome.lock(newest.t_s)
            if clock.now_s() >= collect_s:
                # The frozen start-up heap is exempt, so this looks at little.
                gc.collect()
                collect_s = clock.now_s() + COLLECT_INTERVAL_S
            index += 1
            skipped = metronome.advance(clock.now_s())
    finally:
        make_safe(boat)


def _tick(boat: LoopParts, tick: Tick) -> HeadingSample | None:
    """Do one tick, the rudder before all that can wait; return the newest heading sample, if any."""
    clock, now_s = boat.clock, tick.t_s + tick.late_s
    for device in boat.devices:
        device.receive(now_s)
    headings = tuple(boat.compass.poll())
    before = boat.pilot.state
    others = tuple(boat.compass_b.poll()) if boat.compass_b is not None else ()
    inputs = Inputs(
        tick,
        tuple(sorted(headings + others, key=lambda sample: sample.t_s)) if others else headings,
        tuple(boat.position.poll()) if boat.position is not None else (),
        tuple(boat.rudder.poll()),
        boat.health.take_news(),
        boat.pilot.take_requests(),
    )
    output = boat.pilot.step(inputs)
    boat.rudder.command(output.command, now_s)
    told = boat.shelter.take_events()
    if boat.timekeeper is not None:
        of_clock = boat.timekeeper.consider(int(boat.pilot.state.parameters["CLK_SET"]), inputs.positions, now_s)
        told = (*told, of_clock) if of_clock else told
    if told:
        output = replace(output, events=(*output.events, *told))
    if boat.recorder is not None:
        boat.recorder.offer(inputs, output, lambda: state_to_text(before))
    boat.shelter.call(now_s, partial(boat.link.publish, output, now_s))
    for event in output.events:
        boat.tell(event)
    for line in boat.lines:
        line.maintain(now_s)
    boat.health.look(boat.devices, (boat.store, boat.recorder), clock, boat.link, now_s)
    boat.pilot.remember(now_s, clock.utc_s())
    return headings[-1] if headings else None


def _serve_until_deadline(boat: LoopParts, metronome: Metronome, crowded: bool) -> bool:  # noqa: FBT001 - its own answer of before
    """Sleep until the deadline; meanwhile take bytes as they arrive and serve the link in the slack.

    Takes and returns whether the link had much to do, in the period before and in this one.
    """
    clock, link, deadline_s = boat.clock, boat.link, metronome.deadline_s
    period_s = 1.0 / metronome.rate_hz
    guard_s, busy_guard_s = min(GUARD_S, GUARD_PART * period_s), min(BUSY_GUARD_S, BUSY_GUARD_PART * period_s)
    link_s = 0.0
    store_fd = boat.store.fileno()
    while (now_s := clock.now_s()) < deadline_s:
        slack_end_s = deadline_s - (busy_guard_s if crowded or link_s >= MUCH_PART * period_s else guard_s)
        in_slack = now_s < slack_end_s and link_s < LINK_PART * period_s
        busy = in_slack and link.busy
        device_fds = {device.fileno(): device for device in boat.devices}
        device_fds.pop(-1, None)
        others = [*link.descriptors(), store_fd] if in_slack else []
        ready = clock.wait(now_s if busy else deadline_s, [*device_fds, *others])
        if not ready and not busy:
            continue
        now_s = clock.now_s()
        for fd in ready:
            if fd in device_fds:
                device_fds[fd].receive(now_s)
        # What wakes the link within the guard time waits for the tick.
        if now_s >= slack_end_s:
            continue
        if store_fd in ready:
            boat.shelter.call(now_s, boat.store.service)  # its callbacks are the link's
        link_ready = [fd for fd in ready if fd not in device_fds and fd != store_fd]
        if link_ready or busy:
            boat.shelter.call(now_s, partial(link.service, now_s, link_ready))
            link_s += clock.now_s() - now_s
    return link_s >= MUCH_PART * period_s


def make_safe(boat: LoopParts) -> None:
    """Bring the rudder amidships and wait, within bounds, until it is there."""
    clock = boat.clock
    linkage = settings_of(boat.pilot.state.parameters).rudder.linkage
    command = RudderCommand(linkage.to_shaft(0.0), torque_on=True)
    end_s = clock.now_s() + SAFE_TIMEOUT_S
    while (now_s := clock.now_s()) < end_s:
        boat.rudder.command(command, now_s)
        clock.wait(now_s + SAFE_INTERVAL_S, [])
        boat.rudder.receive(clock.now_s())
        angles_rad = [
            linkage.to_rudder(feedback.shaft_rad)
            for feedback in boat.rudder.poll()
            if feedback.shaft_rad is not None and feedback.t_s >= now_s
        ]
        if angles_rad and abs(angles_rad[-1]) < SAFE_ANGLE_RAD:
            return
