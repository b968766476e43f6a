"""The only reader of time: the machine's clock, or the HIL's in its place, and the tick tick_timer."""

from __future__ import annotations

import json
import math
import os
import select
import socket
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from firmware_py.common.angles import clamp

# A tick should come this long after the arrival of the compass sample it steers by: long
# enough for the jitter of a real compass, short against the boat's response.
LOCK_MARGIN_S = 0.002
# The phase moves by at most this part of a period a tick, so that the rate stays what it is.
LOCK_SLEW = 0.005
LOCK_GAIN = 0.1
MAX_WATCHES = 16
LOCKSTEP_PROTOCOL = 2
REPLY = struct.Struct("<ddd")  # the new time, by how much UTC is stepped, how long to look for the next answer
LINE_EVENT = struct.Struct("<dQ")  # when, and on which line
MAX_REPLY_BYTES = 4096
BOOT_ID = "RAMBLER_BOOT_ID"  # of the environment, by the unit of the service
LOCKSTEP_BOOT = "lockstep"  # in the place of a machine's boot: the HIL's clock goes on from run to run, or starts anew


class ClockError(RuntimeError):
    """The clock of the HIL is gone; there is nothing to go on by."""


class RealClock:
    """The machine's monotonic clock, counted from the start of the process."""

    def __init__(self) -> None:
        """Start counting."""
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Seconds since start."""
        return time.monotonic() - self._start_s

    def utc_s(self) -> float:
        """Seconds since 1970-01-01 UTC, as far as the machine knows."""
        return time.time()

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Sleep until the deadline or until a descriptor is readable; return those that are."""
        remaining_s = deadline_s - (time.monotonic() - self._start_s)
        return select.select(descriptors, [], [], max(0.0, remaining_s))[0]


def machine_s() -> float:
    """Seconds since the machine was switched on, also those that it slept; all its processes share them."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def boot_id(path: Path = Path("/proc/sys/kernel/random/boot_id"), environment: Mapping[str, str] = os.environ) -> str:
    """Return what names the run of the machine, empty where nothing does; a service sees no /proc/sys and is told."""
    try:
        # Without a codec by name: its module would be sought on the disk.
        return (environment.get(BOOT_ID) or path.read_bytes().decode()).strip().replace("-", "")
    except (OSError, UnicodeDecodeError):
        return ""


def set_utc_s(utc_s: float) -> bool:
    """Set the machine's calendar clock, which no deadline depends on; False when that is not allowed."""
    try:
        time.clock_settime(time.CLOCK_REALTIME, utc_s)
    except OSError:
        return False
    return True


class LockstepClock:
    """The HIL's clock: time stands still while the autopilot computes.

    Each wait is one packet (deadline, the serial lines that are awaited, bytes written so far on each) and one
    packet in return (the new time, a step of UTC, and what has been said before it). The HIL has by then
    taken the bytes written, moved the world on to the deadline or to the first bytes that are awaited, and put those
    into the serial lines. What somebody says who is never spoken to needs no answer: the HIL moves on behind it, and
    waits return at its moments first. Everything else is the same code on the same lines as at sea.
    """

    def __init__(
        self,
        path: str,
        lines: Sequence[str],
        written: Callable[[], Sequence[int]],
        settle: Callable[[], bool] = lambda: False,
        fed: Callable[[], Sequence[int]] = tuple,
    ) -> None:
        """Connect to the HIL's socket and name the serial lines whose bytes `written` counts.

        `settle` waits for the disk, which takes no time here either, and returns whether that has brought answers.
        `fed` are the descriptors of the lines, which only the HIL makes readable.
        """
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(path)
            self._socket.sendall(json.dumps({"protocol": LOCKSTEP_PROTOCOL, "lines": list(lines)}).encode())
            hello = json.loads(self._socket.recv(65536))
        except OSError as error:
            self._socket.close()
            raise ClockError(f"lockstep socket {path}: {error.strerror}; is the HIL running?") from None
        self._now_s = float(hello["start_s"])
        self._utc_offset_s = float(hello["utc_s"]) - self._now_s
        self._written = written
        self._settle = settle
        self._fed = fed
        self._watches: dict[tuple[tuple[int, ...], tuple[int, ...]], _Watch] = {}
        self._packet = struct.Struct(f"<d{1 + len(lines)}Q")
        self._outstanding = False
        self._look_s = 0.0
        self._coming: list[tuple[float, int]] = []  # moments that the HIL has told of: the last first, its line -1

    def close(self) -> None:
        """Leave the HIL."""
        self._socket.close()

    def now_s(self) -> float:
        """Seconds on the HIL's clock."""
        return self._now_s

    def utc_s(self) -> float:
        """Seconds since 1970-01-01 UTC on the HIL's clock."""
        return self._utc_offset_s + self._now_s

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Let the world move on; return the descriptors that are readable then.

        Returns early, without any time gone by, for a descriptor that the HIL does not
        feed (a socket of an outside ground station), and then for no other: the bytes that
        the HIL puts into its lines meanwhile belong to a later time.
        """
        watch = self._watch(tuple(descriptors), tuple(self._fed()))
        if self._settle() and (ready := self._ready(watch)):
            return ready
        if deadline_s > self._now_s and not (self._outstanding or self._coming):
            self._send(deadline_s, watch.lines)
        if self._outstanding and watch.hil_has_answered(self._look_s):
            self._receive()
        if deadline_s > self._now_s and self._coming:
            self._now_s, line = self._coming.pop()
            if line >= 0:
                return [descriptor for descriptor in (self._fed()[line],) if descriptor in descriptors]
        return self._ready(watch)

    def _ready(self, watch: _Watch) -> Sequence[int]:
        return watch.ready(fed=not (self._outstanding or self._coming))

    def _watch(self, descriptors: tuple[int, ...], fed: tuple[int, ...]) -> _Watch:
        """Return what looks at these descriptors, of which there are a few sets, again and again."""
        watch = self._watches.get((descriptors, fed))
        if watch is None:
            if len(self._watches) >= MAX_WATCHES:
                self._watches.clear()
            watch = self._watches[descriptors, fed] = _Watch(descriptors, fed, self._socket.fileno())
        return watch

    def _send(self, deadline_s: float, awaited: int) -> None:
        try:
            self._socket.sendall(self._packet.pack(deadline_s, awaited, *self._written()))
        except OSError as error:
            raise ClockError(f"the HIL has gone: {error.strerror}") from None
        self._outstanding = True

    def _receive(self) -> None:
        try:
            packet = self._socket.recv(MAX_REPLY_BYTES)
        except OSError as error:
            raise ClockError(f"the HIL has gone: {error.strerror}") from None
        if not packet:
            raise ClockError("the HIL has ended the run")
        now_s, step_s, self._look_s = REPLY.unpack_from(packet)
        self._utc_offset_s += step_s
        self._coming = [(now_s, -1), *reversed([*LINE_EVENT.iter_unpack(packet[REPLY.size :])])]
        self._outstanding = False


class _Watch:
    """Descriptors that are looked at together, tick after tick: a set up look costs a third of a new one."""

    def __init__(self, descriptors: Sequence[int], fed: Sequence[int], hil: int) -> None:
        """Watch descriptors; those that are not `fed` may end a wait for the HIL."""
        self.lines = sum(1 << line for line, descriptor in enumerate(fed) if descriptor in descriptors)
        self._descriptors = descriptors
        self._hil = hil
        self._all, self._waking = select.poll(), select.poll()
        for descriptor in descriptors:
            self._all.register(descriptor, select.POLLIN)
        for descriptor in {hil, *descriptors}.difference(fed):
            self._waking.register(descriptor, select.POLLIN)

    def ready(self, *, fed: bool) -> list[int]:
        """Return the readable descriptors in their order of registration, with or without the lines of the harness."""
        ready = {descriptor for descriptor, _ in (self._all if fed else self._waking).poll(0)}
        return [descriptor for descriptor in self._descriptors if descriptor in ready]

    def hil_has_answered(self, look_s: float) -> bool:
        """Wait for the HIL or for anybody else; return whether it was the HIL.

        For look_s, which the HIL says, it is looked for again and again: where nobody else wants the core, to be woken
        takes longer than what the HIL does meanwhile.
        """
        end_s = time.monotonic() + look_s
        while not (ready := self._waking.poll(0)) and time.monotonic() < end_s:
            os.sched_yield()
        return any(descriptor == self._hil for descriptor, _ in ready or self._waking.poll())


class TickTimer:
    """Absolute deadlines at a fixed rate, skipped in phase and never caught up.

    The phase may drift slowly towards the arrivals of an outside event (a compass
    sample); without arrivals it runs free.
    """

    def __init__(self, start_s: float, rate_hz: float) -> None:
        """Make the first deadline start_s."""
        self._deadline_s = start_s
        self._rate_hz = rate_hz
        self._shift_s = 0.0

    @property
    def rate_hz(self) -> float:
        """The nominal rate."""
        return self._rate_hz

    @property
    def deadline_s(self) -> float:
        """The deadline that is due next."""
        return self._deadline_s

    def set_rate(self, rate_hz: float) -> None:
        """Change the rate from the deadline after the next one on."""
        self._rate_hz = rate_hz

    def lock(self, arrival_s: float) -> None:
        """Move the next deadlines a little towards a whole number of periods after arrival_s."""
        period_s = 1.0 / self._rate_hz
        ahead_s = self._deadline_s - (arrival_s + LOCK_MARGIN_S)
        error_s = ahead_s - period_s * math.floor(ahead_s / period_s + 0.5)
        self._shift_s = clamp(-LOCK_GAIN * error_s, -LOCK_SLEW * period_s, LOCK_SLEW * period_s)

    def advance(self, now_s: float) -> int:
        """Set the next deadline after a tick done at now_s; return how many were skipped.

        A deadline less than half a period gone is still served, late; older ones are skipped.
        """
        period_s = 1.0 / self._rate_hz
        self._deadline_s += period_s + self._shift_s
        self._shift_s = 0.0
        behind_s = now_s - self._deadline_s
        if behind_s < 0.5 * period_s:
            return 0
        skipped = math.floor(behind_s / period_s + 0.5)
        self._deadline_s += skipped * period_s
        return skipped
