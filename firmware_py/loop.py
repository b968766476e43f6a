"""The fixed-rate loop: wait, poll, step, actuate, record, publish; between ticks it serves the link."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from msgspec.structs import replace

from firmware_py.common.interfaces import (
    Clock,
    Compass,
    Depth,
    Device,
    Link,
    Position,
    Power,
    Recorder,
    Rudder,
    RudderAngle,
    Vessels,
    Wind,
)
from firmware_py.common.records import Event, HeadingSample, Inputs, Progress, RudderCommand, Severity, Tick
from firmware_py.common.reports import Output
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.liveness import Liveness, StuckError, devices_progress
from firmware_py.core.state import parameters_in_force, settings_of
from firmware_py.core.state_codec import state_to_text
from firmware_py.system.clock import LOCK_MARGIN_S, TickTimer
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.health import HealthMonitor
from firmware_py.system.network_line import NetworkLine
from firmware_py.system.serial_port import SerialPort
from firmware_py.system.store import Store
from firmware_py.system.watchdogs import Watchdogs, is_in_uninterruptible_wait

if TYPE_CHECKING:
    from firmware_py.system.pwm_line import PwmLine

# The link is not served within this time before a deadline.
GUARD_S = 0.003
# If the link used more than LINK_BUSY_FRACTION of this period or of the one before, the guard time is BUSY_GUARD_S,
# at most BUSY_GUARD_FRACTION of the period. Virtual machines and overheated boards may become ten times slower for
# some milliseconds: a running call must end before the tick even then.
LINK_BUSY_FRACTION = 0.1
BUSY_GUARD_S = 0.012
BUSY_GUARD_FRACTION = 0.5
# Maximum share of the link in a period. Linux suspends a real-time process for 50 ms in each second in which it would
# use more than 95 % of the processor; a flood of messages must not cause that.
MAX_LINK_FRACTION = 0.75
# The sample of the compass that the ticks are locked to arrives shortly before the deadline and starts the tick, which
# saves another wake-up of the processor. It starts at most this time early.
MAX_EARLY_S = 2.0 * LOCK_MARGIN_S
COLLECT_INTERVAL_S = 60.0  # of the garbage collection
WATCHDOG_INTERVAL_S = 1.0  # the timeouts of the watchdogs are several intervals
# Centring of the rudder at the end of a run: maximum time, interval of the command, error of a centred rudder.
SAFE_TIMEOUT_S = 2.0
SAFE_INTERVAL_S = 0.1
SAFE_ANGLE_RAD = 0.02
MIN_SAFE_READINGS = 2  # consecutive, because a rudder that moves to the other side passes the centre


@dataclass(slots=True)
class LoopParts:
    """Parts of the loop, connected by the package assemble."""

    clock: Clock
    autopilot: Autopilot
    compass: Compass
    position: Position | None
    rudder: Rudder
    link: Link
    recorder: Recorder | None
    store: Store
    lines: Sequence[SerialPort | NetworkLine | PwmLine]
    print_event: Callable[[Event], None]
    fault_barrier: FaultBarrier
    clock_setter: ClockSetter | None = None
    notices: list[Event] = field(default_factory=list)  # events of the next tick
    signal_events: Callable[[], tuple[Event, ...]] = tuple  # events of process signals
    compass_b: Compass | None = None
    compass_b_is_prompt: bool = True  # False for a gyroscope, which sends a hundred times a second
    power: tuple[Power, ...] = ()
    rudder_angle: RudderAngle | None = None
    vessels: Vessels | None = None  # read after the rudder command is sent
    wind: Wind | None = None  # likewise, before the vessels, with which they may share a line
    depth: Depth | None = None
    health: HealthMonitor = field(default_factory=HealthMonitor)
    after_tick: Callable[[Output, float], None] = lambda _output, _now_s: None  # status reports; never raises
    watchdogs: Watchdogs = field(default_factory=Watchdogs)
    liveness: Liveness = field(default_factory=Liveness)
    tick_on_compass: bool = False  # whether a compass sample may start a tick; not in lockstep
    early_headings: tuple[HeadingSample, ...] = ()  # of the compass that has started the tick
    samples: int = 0  # number of heading, position and servo samples since the start
    watchdog_due_s: float = -math.inf
    prompt_devices: tuple[Device, ...] = field(init=False)  # read as bytes arrive, for exact time stamps
    devices: tuple[Device, ...] = field(init=False)  # read at least once a tick
    late_devices: tuple[Device, ...] = field(init=False)  # read after the rudder command is sent
    all_devices: tuple[Device, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Group the devices."""
        prompt = (self.compass, self.compass_b if self.compass_b_is_prompt else None, self.position)
        self.prompt_devices = tuple(device for device in prompt if device is not None)
        sensors = (self.compass, self.compass_b, self.position)
        self.devices = (*(device for device in sensors if device is not None), self.rudder, *self.power)
        if self.rudder_angle is not None:
            self.devices = (*self.devices, self.rudder_angle)
        self.late_devices = tuple(device for device in (self.wind, self.depth, self.vessels) if device is not None)
        self.all_devices = (*self.devices, *self.late_devices)


def run(parts: LoopParts, stopped: Callable[[], bool]) -> None:
    """Run the loop until it is stopped or a restart is requested; at any end, the rudder is centred first.

    One more tick follows a stop, so that log and ground stations can distinguish a regular end from a power cut.
    """
    clock = parts.clock
    tick_timer = TickTimer(clock.now_s(), parts.autopilot.parameters()["LOOP_RATE_HZ"])
    index = skipped = 0
    link_busy, ended = False, stopped()
    collect_s = clock.now_s() + COLLECT_INTERVAL_S
    parts.autopilot.save_resume(clock.now_s(), clock.utc_s())
    try:
        while not ended and parts.autopilot.restart is None:
            link_busy = _serve_until_deadline(parts, tick_timer, link_busy)
            ended = stopped()
            now_s, due_s = clock.now_s(), tick_timer.deadline_s
            tick = Tick(index, min(now_s, due_s), max(0.0, now_s - due_s), skipped, tick_timer.rate_hz)
            newest = _tick(parts, tick, last=ended)
            now_s = clock.now_s()
            _serve_watchdogs(parts, now_s)
            parameters = parameters_in_force(parts.autopilot.state)
            tick_timer.set_rate(parameters["LOOP_RATE_HZ"])
            if newest is not None and parameters["LOOP_LOCK"]:
                tick_timer.lock(newest.t_s)
            if now_s >= collect_s:
                # Fast, because the start-up heap is frozen.
                gc.collect()
                now_s = clock.now_s()
                collect_s = now_s + COLLECT_INTERVAL_S
            index += 1
            skipped = tick_timer.advance(now_s)
    finally:
        make_safe(parts)
    parts.autopilot.save_resume(clock.now_s(), clock.utc_s(), last=True)


def _tick(parts: LoopParts, tick: Tick, *, last: bool) -> HeadingSample | None:
    """Run one tick, with the rudder command before all that can wait; return the newest heading sample, if any.

    The last tick does not reopen ports: a pty of a harness that has ended may belong to another process by now.
    """
    clock, now_s = parts.clock, tick.t_s + tick.late_s
    # Early headings: the compass, the first device, has been read.
    for device in parts.devices[1:] if parts.early_headings else parts.devices:
        device.receive(now_s)
    headings = (*parts.early_headings, *parts.compass.poll())
    parts.early_headings = ()
    previous_state = parts.autopilot.state
    others = tuple(parts.compass_b.poll()) if parts.compass_b is not None else ()
    inputs = Inputs(
        tick,
        tuple(sorted(headings + others, key=lambda sample: sample.t_s)) if others else headings,
        tuple(parts.position.poll()) if parts.position is not None else (),
        tuple(parts.rudder.poll()),
        parts.health.take_reports(),
        parts.autopilot.take_requests(),
        tuple(sample for device in parts.power for sample in device.poll()),
        tuple(parts.vessels.poll()) if parts.vessels is not None else (),
        tuple(parts.rudder_angle.poll()) if parts.rudder_angle is not None else (),
        tuple(parts.wind.poll()) if parts.wind is not None else (),
        tuple(parts.depth.poll()) if parts.depth is not None else (),
    )
    output = parts.autopilot.step(inputs)
    parts.rudder.command(output.command, now_s)
    events = (*parts.notices, *parts.signal_events(), *parts.fault_barrier.take_events())
    parts.notices.clear()
    if parts.clock_setter is not None:
        policy = int(parts.autopilot.state.parameters["CLK_SET"])
        events = (*events, *parts.clock_setter.update(policy, inputs.positions, now_s))
    if events:
        output = replace(output, events=(*output.events, *events))
    if parts.recorder is not None:
        parts.recorder.offer(inputs, output, lambda: state_to_text(previous_state))
    if parts.autopilot.compass_swing.is_running:
        parts.notices += parts.autopilot.compass_swing.take(inputs, parts.autopilot.state.parameters)
    parts.fault_barrier.call(now_s, partial(parts.link.publish, output, now_s))
    for device in parts.late_devices:
        device.receive(now_s)
    for event in output.events:
        parts.print_event(event)
    for line in () if last else parts.lines:
        if text := line.reopen(now_s):
            parts.notices.append(Event(Severity.WARNING, text))
    parts.samples += len(inputs.headings) + len(inputs.positions) + len(inputs.rudder)
    parts.health.update(parts.all_devices, (parts.store, parts.recorder), clock, parts.link, now_s)
    parts.autopilot.save_resume(now_s, clock.utc_s())
    parts.after_tick(output, now_s)
    return headings[-1] if headings else None


def _serve_watchdogs(parts: LoopParts, now_s: float) -> None:
    """Serve the watchdogs; raise StuckError if a part is stuck.

    A thread that waits for the disk in the kernel cannot be ended by a restart: it is reported as a storage fault, and
    steering continues.
    """
    watchdogs = parts.watchdogs
    if not watchdogs.can_restart or now_s < parts.watchdog_due_s:
        return
    parts.watchdog_due_s = now_s + WATCHDOG_INTERVAL_S
    stuck = parts.liveness.update(_progress(parts), now_s)
    hanging = tuple(part for part in stuck if part.thread is not None and is_in_uninterruptible_wait(part.thread))
    for part in stuck:
        if part not in hanging:
            problem = "has ended" if not part.alive else f"no progress for {part.patience_s:.0f} s"
            raise StuckError(f"{part.name}: {problem}")
    parts.health.blocked_threads = ", ".join(part.name for part in hanging)
    modes = parts.autopilot.state.modes
    watchdogs.notify_alive(now_s, f"{modes.mode.name}, {'armed' if modes.armed else 'disarmed'}")


def _progress(parts: LoopParts) -> list[Progress]:
    """Return the progress of all supervised parts."""
    lines = parts.lines
    devices = devices_progress(
        parts.samples,
        sum(line.written for line in lines),
        [device.fileno() >= 0 for device in parts.devices],  # those read late may be silent
        rudder_connected=parts.rudder.fileno() >= 0,
    )
    workers = [parts.store.progress(), *parts.link.progress()]
    return [*devices, *workers, *(parts.recorder.progress() if parts.recorder is not None else ())]


def _serve_until_deadline(parts: LoopParts, tick_timer: TickTimer, link_busy: bool) -> bool:  # noqa: FBT001 - its own last result
    """Wait for the deadline, or for the compass shortly before it; meanwhile read devices and serve the link.

    Takes and returns whether the link was busy, in the last period and in this one.
    """
    clock, link, deadline_s = parts.clock, parts.link, tick_timer.deadline_s
    period_s = 1.0 / tick_timer.rate_hz
    busy_guard_s = min(BUSY_GUARD_S, BUSY_GUARD_FRACTION * period_s)
    locked = parts.tick_on_compass and parts.autopilot.state.parameters["LOOP_LOCK"]
    early_start_s = deadline_s - MAX_EARLY_S if locked else deadline_s
    link_s = 0.0
    store_fd, device_fds = parts.store.fileno(), _prompt_descriptors(parts)
    others = [*link.descriptors(), store_fd]
    while (now_s := clock.now_s()) < deadline_s:
        guard_start_s = deadline_s - (busy_guard_s if link_busy or link_s >= LINK_BUSY_FRACTION * period_s else GUARD_S)
        is_before_guard = now_s < guard_start_s and link_s < MAX_LINK_FRACTION * period_s
        has_link_data = is_before_guard and link.busy
        descriptors = [*device_fds, *others] if is_before_guard else [*device_fds]
        ready = clock.wait(now_s if has_link_data else deadline_s, descriptors)
        if not ready and not has_link_data:
            continue
        now_s = clock.now_s()
        readable = [device_fds[fd] for fd in ready if fd in device_fds]
        link_ready = [fd for fd in ready if fd not in device_fds and fd != store_fd]
        for device in readable:
            device.receive(now_s)
        if now_s >= early_start_s and parts.compass in readable and (early_headings := tuple(parts.compass.poll())):
            parts.early_headings = early_headings
            break
        if parts.rudder in readable or any(device.fileno() < 0 for device in readable):
            device_fds = _prompt_descriptors(parts)
        # Data of the link within the guard time wait until after the tick.
        if now_s >= guard_start_s:
            continue
        if store_fd in ready:
            parts.fault_barrier.call(now_s, parts.store.service)  # its callbacks belong to the link
        if link_ready or has_link_data:
            parts.fault_barrier.call(now_s, partial(link.service, now_s, link_ready))
            link_s += clock.now_s() - now_s
        if len(ready) > len(readable) or has_link_data:  # the link may have closed a connection
            others = [*link.descriptors(), store_fd]
    return link_s >= LINK_BUSY_FRACTION * period_s


def _prompt_descriptors(parts: LoopParts) -> dict[int, Device]:
    """Return the devices to read before the tick by descriptor; the rudder only while it needs prompt I/O."""
    devices = (*parts.prompt_devices, parts.rudder) if parts.rudder.needs_prompt_io() else parts.prompt_devices
    descriptors = {device.fileno(): device for device in devices}
    descriptors.pop(-1, None)
    return descriptors


def make_safe(parts: LoopParts) -> None:
    """Centre the rudder and wait until it is there, at most SAFE_TIMEOUT_S."""
    clock, rudder = parts.clock, parts.rudder
    parts.watchdogs.notify_alive(clock.now_s())  # this may take a while
    linkage = settings_of(parts.autopilot.state.parameters).rudder.linkage
    command = RudderCommand(linkage.to_shaft(0.0), torque_on=True)
    rudder.poll()  # discard old feedback
    next_s = clock.now_s()
    end_s = next_s + SAFE_TIMEOUT_S
    centred_readings = 0
    while centred_readings < MIN_SAFE_READINGS and (now_s := clock.now_s()) < end_s:
        if now_s >= next_s:
            rudder.command(command, now_s)
            next_s = now_s + SAFE_INTERVAL_S
        # The angle is requested after the reply to the command, so that replies must be read at once.
        descriptor = rudder.fileno()
        clock.wait(next_s, [] if descriptor < 0 else [descriptor])
        rudder.receive(clock.now_s())
        for feedback in rudder.poll():
            if feedback.shaft_rad is not None:
                is_centred = abs(linkage.to_rudder(feedback.shaft_rad)) < SAFE_ANGLE_RAD
                centred_readings = centred_readings + 1 if is_centred else 0
