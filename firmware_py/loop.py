"""The fixed-rate loop: wait, poll, step, actuate, record, publish; the link is served in the slack."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from msgspec.structs import replace

from firmware_py.common.interfaces import Clock, Compass, Device, Link, Position, Power, Recorder, Rudder, Vessels
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
from firmware_py.system.watchdogs import Watchdogs, waits_in_kernel

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
# The compass that the ticks are locked to comes a little before its deadline: the tick begins with it, so that a
# processor that is awake need not be woken again. Not earlier than this, or than this part of a short period.
EARLY_S = 2.0 * LOCK_MARGIN_S
EARLY_PART = 0.2
COLLECT_INTERVAL_S = 60.0
LIFE_INTERVAL_S = 1.0  # and with the first tick; whoever watches over her waits for several
SAFE_TIMEOUT_S = 2.0
SAFE_INTERVAL_S = 0.1
SAFE_ANGLE_RAD = 0.02
SAFE_READINGS = 2  # in a row: a rudder that is on its way to the other side is amidships for a moment, too


@dataclass(slots=True)
class LoopParts:
    """Everything the loop drives, wired by assemble."""

    clock: Clock
    autopilot: Autopilot
    compass: Compass
    position: Position | None
    rudder: Rudder
    link: Link
    recorder: Recorder | None
    store: Store
    lines: Sequence[SerialPort | NetworkLine]
    show_event: Callable[[Event], None]
    fault_barrier: FaultBarrier
    clock_setter: ClockSetter | None = None
    notices: list[Event] = field(default_factory=list)  # of what is found on disk: told with the next tick
    take_signals: Callable[[], tuple[Event, ...]] = tuple  # what is to be told of the process's signals
    compass_b: Compass | None = None
    power: tuple[Power, ...] = ()
    vessels: Vessels | None = None  # read behind all that steers; they are in no hurry
    health: HealthMonitor = field(default_factory=HealthMonitor)
    show_status: Callable[[Output, float], None] = lambda _output, _now_s: None  # to who looks on; never raises
    watchdogs: Watchdogs = field(default_factory=Watchdogs)
    liveness: Liveness = field(default_factory=Liveness)
    prompt_ticks: bool = False  # whether a tick begins with the compass: where time goes by, and waking takes some
    heard: tuple[HeadingSample, ...] = ()  # what the compass has said that the tick begins with
    samples: int = 0  # taken from all devices since the start
    life_due_s: float = -math.inf
    prompt: tuple[Device, ...] = field(init=False)  # whose bytes are taken as they arrive: the time is that of a sample
    devices: tuple[Device, ...] = field(init=False)  # these, and those of which each tick takes what has come
    reporting: tuple[Device, ...] = field(init=False)  # all

    def __post_init__(self) -> None:
        """List the devices once."""
        present = (self.compass, self.compass_b, self.position)
        self.prompt = tuple(device for device in present if device is not None)
        self.devices = (*self.prompt, self.rudder, *self.power)
        self.reporting = self.devices if self.vessels is None else (*self.devices, self.vessels)


def run(parts: LoopParts, stopped: Callable[[], bool]) -> None:
    """Turn the loop until stopped or asked to restart; whatever ends it, the rudder is made safe first.

    The tick after a stop is still done: its log, and who hears her, shall know an end in good order from a power cut.
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
            _show_life(parts, now_s)
            parameters = parameters_in_force(parts.autopilot.state)
            tick_timer.set_rate(parameters["LOOP_RATE_HZ"])
            if newest is not None and parameters["LOOP_LOCK"]:
                tick_timer.lock(newest.t_s)
            if now_s >= collect_s:
                # The frozen start-up heap is exempt, so this looks at little.
                gc.collect()
                now_s = clock.now_s()
                collect_s = now_s + COLLECT_INTERVAL_S
            index += 1
            skipped = tick_timer.advance(now_s)
    finally:
        make_safe(parts)
    parts.autopilot.save_resume(clock.now_s(), clock.utc_s(), last=True)


def _tick(parts: LoopParts, tick: Tick, *, last: bool) -> HeadingSample | None:
    """Do one tick, the rudder before all that can wait; return the newest heading sample, if any.

    The last one takes up no port that was away: where that is a pty of a harness that ended first, its number may be
    another's by now, who would find it in use.
    """
    clock, now_s = parts.clock, tick.t_s + tick.late_s
    for device in parts.devices[1:] if parts.heard else parts.devices:
        device.receive(now_s)
    headings = (*parts.heard, *parts.compass.poll())
    parts.heard = ()
    before = parts.autopilot.state
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
    )
    output = parts.autopilot.step(inputs)
    parts.rudder.command(output.command, now_s)
    events = (*parts.notices, *parts.take_signals(), *parts.fault_barrier.take_events())
    parts.notices.clear()
    if parts.clock_setter is not None:
        policy = int(parts.autopilot.state.parameters["CLK_SET"])
        events = (*events, *parts.clock_setter.update(policy, inputs.positions, now_s))
    if events:
        output = replace(output, events=(*output.events, *events))
    if parts.recorder is not None:
        parts.recorder.offer(inputs, output, lambda: state_to_text(before))
    if parts.autopilot.compass_swing.running:
        parts.notices += parts.autopilot.compass_swing.take(inputs, parts.autopilot.state.parameters)
    parts.fault_barrier.call(now_s, partial(parts.link.publish, output, now_s))
    if parts.vessels is not None:
        parts.vessels.receive(now_s)
    for event in output.events:
        parts.show_event(event)
    for line in () if last else parts.lines:
        if text := line.reopen(now_s):
            parts.notices.append(Event(Severity.WARNING, text))
    parts.samples += len(inputs.headings) + len(inputs.positions) + len(inputs.rudder)
    parts.health.update(parts.reporting, (parts.store, parts.recorder), clock, parts.link, now_s)
    parts.autopilot.save_resume(now_s, clock.utc_s())
    parts.show_status(output, now_s)
    return headings[-1] if headings else None


def _show_life(parts: LoopParts, now_s: float) -> None:
    """Tell the watchdogs that all that the tick does is done; StuckError when a part beside it is stuck.

    A thread that waits for the disk inside the kernel cannot be ended either: that is a fault of the storage, and she
    steers on.
    """
    watchdogs = parts.watchdogs
    if not watchdogs.awaited or now_s < parts.life_due_s:
        return
    parts.life_due_s = now_s + LIFE_INTERVAL_S
    stuck = parts.liveness.update(_progress(parts), now_s)
    hanging = tuple(part for part in stuck if part.thread is not None and waits_in_kernel(part.thread))
    for part in stuck:
        if part not in hanging:
            done = "has ended" if not part.alive else f"nothing done for {part.patience_s:.0f} s"
            raise StuckError(f"{part.name}: {done}")
    parts.health.hanging = ", ".join(part.name for part in hanging)
    modes = parts.autopilot.state.modes
    watchdogs.notify_alive(now_s, f"{modes.mode.name}, {'armed' if modes.armed else 'disarmed'}")


def _progress(parts: LoopParts) -> list[Progress]:
    """Return what has been done by all that a watchdog vouches for."""
    lines = parts.lines
    devices = devices_progress(
        parts.samples,
        sum(line.written for line in lines),
        [device.fileno() >= 0 for device in parts.devices],  # AIS is excluded because it may be silent
        rudder_connected=parts.rudder.fileno() >= 0,
    )
    workers = [parts.store.progress(), *parts.link.progress()]
    return [*devices, *workers, *(parts.recorder.progress() if parts.recorder is not None else ())]


def _serve_until_deadline(parts: LoopParts, tick_timer: TickTimer, link_busy: bool) -> bool:  # noqa: FBT001 - its own answer of before
    """Sleep until the deadline, or the compass just before; meanwhile take bytes and serve the link in the slack.

    Takes and returns whether the link had much to do, in the period before and in this one.
    """
    clock, link, deadline_s = parts.clock, parts.link, tick_timer.deadline_s
    period_s = 1.0 / tick_timer.rate_hz
    guard_s, busy_guard_s = min(GUARD_S, GUARD_PART * period_s), min(BUSY_GUARD_S, BUSY_GUARD_PART * period_s)
    locked = parts.prompt_ticks and parts.autopilot.state.parameters["LOOP_LOCK"]
    begin_s = deadline_s - min(EARLY_S, EARLY_PART * period_s) if locked else deadline_s
    link_s = 0.0
    store_fd, device_fds = parts.store.fileno(), _awaited(parts)
    others = [*link.descriptors(), store_fd]
    while (now_s := clock.now_s()) < deadline_s:
        slack_end_s = deadline_s - (busy_guard_s if link_busy or link_s >= MUCH_PART * period_s else guard_s)
        in_slack = now_s < slack_end_s and link_s < LINK_PART * period_s
        waiting = in_slack and link.busy
        awaited = [*device_fds, *others] if in_slack else [*device_fds]
        ready = clock.wait(now_s if waiting else deadline_s, awaited)
        if not ready and not waiting:
            continue
        now_s = clock.now_s()
        speaking = [device_fds[fd] for fd in ready if fd in device_fds]
        link_ready = [fd for fd in ready if fd not in device_fds and fd != store_fd]
        for device in speaking:
            device.receive(now_s)
        if now_s >= begin_s and parts.compass in speaking and (heard := tuple(parts.compass.poll())):
            parts.heard = heard
            break
        if parts.rudder in speaking or any(device.fileno() < 0 for device in speaking):
            device_fds = _awaited(parts)
        # What wakes the link within the guard time waits for the tick.
        if now_s >= slack_end_s:
            continue
        if store_fd in ready:
            parts.fault_barrier.call(now_s, parts.store.service)  # its callbacks are the link's
        if link_ready or waiting:
            parts.fault_barrier.call(now_s, partial(link.service, now_s, link_ready))
            link_s += clock.now_s() - now_s
        if len(ready) > len(speaking) or waiting:  # the link has done something, and may have closed a connection
            others = [*link.descriptors(), store_fd]
    return link_s >= MUCH_PART * period_s


def _awaited(parts: LoopParts) -> dict[int, Device]:
    """Return by their descriptors the devices that are heard before the tick; the rudder if it is to be told more."""
    heard = (*parts.prompt, parts.rudder) if parts.rudder.needs_prompt_io() else parts.prompt
    awaited = {device.fileno(): device for device in heard}
    awaited.pop(-1, None)
    return awaited


def make_safe(parts: LoopParts) -> None:
    """Bring the rudder amidships and wait, within bounds, until it stands there."""
    clock, rudder = parts.clock, parts.rudder
    parts.watchdogs.notify_alive(clock.now_s())  # this may take a while
    linkage = settings_of(parts.autopilot.state.parameters).rudder.linkage
    command = RudderCommand(linkage.to_shaft(0.0), torque_on=True)
    rudder.poll()  # what was measured before
    next_s = clock.now_s()
    end_s = next_s + SAFE_TIMEOUT_S
    amidships = 0
    while amidships < SAFE_READINGS and (now_s := clock.now_s()) < end_s:
        if now_s >= next_s:
            rudder.command(command, now_s)
            next_s = now_s + SAFE_INTERVAL_S
        # The servo is asked for its angle when it has taken the command, so its answers must not wait.
        descriptor = rudder.fileno()
        clock.wait(next_s, [] if descriptor < 0 else [descriptor])
        rudder.receive(clock.now_s())
        for feedback in rudder.poll():
            if feedback.shaft_rad is not None:
                there = abs(linkage.to_rudder(feedback.shaft_rad)) < SAFE_ANGLE_RAD
                amidships = amidships + 1 if there else 0
