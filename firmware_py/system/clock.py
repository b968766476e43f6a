"""The only module that reads the time, from the machine or from the HIL, and the timer of the ticks."""

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

# Delay of a tick after the arrival of its compass sample: more than the jitter of a real compass, and short compared
# with the response of the boat.
LOCK_MARGIN_S = 0.002
# Maximum phase change per tick in periods, so that the rate stays constant.
LOCK_SLEW = 0.005
LOCK_GAIN = 0.1
MAX_WATCHES = 16
LOCKSTEP_PROTOCOL = 2
REPLY = struct.Struct("<ddd")  # new time, step of UTC, time of busy waiting for the next reply
LINE_EVENT = struct.Struct("<dQ")  # time, number of the line
MAX_REPLY_BYTES = 4096
BOOT_ID = "RAMBLER_BOOT_ID"  # environment variable set by the service unit
LOCKSTEP_BOOT = "lockstep"  # in place of the boot id: the clock of the HIL continues from run to run, or restarts


class ClockError(RuntimeError):
    """The connection to the clock of the HIL is lost."""


class RealClock:
    """The machine's monotonic clock, counted from the start of the process."""

    def __init__(self) -> None:
        """Start at 0."""
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Return the seconds since the start."""
        return time.monotonic() - self._start_s

    def utc_s(self) -> float:
        """Return the seconds since 1970-01-01 UTC by the machine's clock."""
        return time.time()

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Sleep until the deadline or until a descriptor is readable; return the readable ones."""
        remaining_s = deadline_s - (time.monotonic() - self._start_s)
        return select.select(descriptors, [], [], max(0.0, remaining_s))[0]


def machine_s() -> float:
    """Return the seconds since the boot including suspended time, the same for all processes."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def boot_id(path: Path = Path("/proc/sys/kernel/random/boot_id"), environment: Mapping[str, str] = os.environ) -> str:
    """Return the boot id, empty if unknown; a service has no access to /proc/sys and uses BOOT_ID."""
    try:
        # Without a codec name, because its module would be loaded from the disk.
        return (environment.get(BOOT_ID) or path.read_bytes().decode()).strip().replace("-", "")
    except (OSError, UnicodeDecodeError):
        return ""


def set_utc_s(utc_s: float) -> bool:
    """Set the machine's calendar clock, which is not used for deadlines; False if not permitted."""
    try:
        time.clock_settime(time.CLOCK_REALTIME, utc_s)
    except OSError:
        return False
    return True


class LockstepClock:
    """The clock of the HIL: simulated time stops while the autopilot computes.

    Each wait sends one packet (deadline, serial lines to wait for, bytes written so far on each line) and receives one
    (new time, step of UTC, and earlier data on read-only lines). Before the reply, the HIL has read the written bytes,
    advanced the simulation to the deadline or to the first data on a line to wait for, and written these data into the
    serial lines. Data on read-only lines need no reply: the HIL continues after them, and the waits return at their
    times first. All other code is the same as at sea.
    """

    def __init__(
        self,
        path: str,
        lines: Sequence[str],
        written: Callable[[], Sequence[int]],
        settle: Callable[[], bool] = lambda: False,
        fed: Callable[[], Sequence[int]] = tuple,
    ) -> None:
        """Connect to the socket of the HIL with the names of the serial lines; `written` returns their byte counts.

        `settle` waits for the disk, which takes no simulated time, and returns whether callbacks are due. `fed` returns
        the descriptors of the lines, which only the HIL makes readable.
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
        self._coming: list[tuple[float, int]] = []  # times and lines of reported data, the last one first with line -1

    def close(self) -> None:
        """Close the connection to the HIL."""
        self._socket.close()

    def now_s(self) -> float:
        """Return the time of the HIL in seconds."""
        return self._now_s

    def utc_s(self) -> float:
        """Return the seconds since 1970-01-01 UTC by the clock of the HIL."""
        return self._utc_offset_s + self._now_s

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Advance the simulation; return the descriptors that are readable then.

        Returns early, at the same time, for a descriptor that the HIL does not feed (the socket of an external ground
        station), and then for no other: the bytes that the HIL writes into its lines belong to a later time.
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
        """Return the cached poll objects of a set of descriptors."""
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
            raise ClockError(f"connection to the HIL lost: {error.strerror}") from None
        self._outstanding = True

    def _receive(self) -> None:
        try:
            packet = self._socket.recv(MAX_REPLY_BYTES)
        except OSError as error:
            raise ClockError(f"connection to the HIL lost: {error.strerror}") from None
        if not packet:
            raise ClockError("the HIL has ended the run")
        now_s, step_s, self._look_s = REPLY.unpack_from(packet)
        self._utc_offset_s += step_s
        self._coming = [(now_s, -1), *reversed([*LINE_EVENT.iter_unpack(packet[REPLY.size :])])]
        self._outstanding = False


class _Watch:
    """Poll objects for a set of descriptors; reusing them costs a third of creating them."""

    def __init__(self, descriptors: Sequence[int], fed: Sequence[int], hil: int) -> None:
        """Register descriptors; those not in `fed` may end a wait for the HIL."""
        self.lines = sum(1 << line for line, descriptor in enumerate(fed) if descriptor in descriptors)
        self._descriptors = descriptors
        self._hil = hil
        self._all, self._waking = select.poll(), select.poll()
        for descriptor in descriptors:
            self._all.register(descriptor, select.POLLIN)
        for descriptor in {hil, *descriptors}.difference(fed):
            self._waking.register(descriptor, select.POLLIN)

    def ready(self, *, fed: bool) -> list[int]:
        """Return the readable descriptors in order of registration, with or without the lines of the HIL."""
        ready = {descriptor for descriptor, _ in (self._all if fed else self._waking).poll(0)}
        return [descriptor for descriptor in self._descriptors if descriptor in ready]

    def hil_has_answered(self, look_s: float) -> bool:
        """Wait for the HIL or another descriptor; return whether the HIL has replied.

        For look_s, set by the HIL, the wait is a busy one: on a free core, waking up takes longer than the work of the
        HIL.
        """
        end_s = time.monotonic() + look_s
        while not (ready := self._waking.poll(0)) and time.monotonic() < end_s:
            os.sched_yield()
        return any(descriptor == self._hil for descriptor, _ in ready or self._waking.poll())


class TickTimer:
    """Absolute deadlines at a fixed rate; missed deadlines are skipped, not caught up.

    The phase can be locked slowly to an external event (the arrival of a compass sample); without events it runs free.
    """

    def __init__(self, start_s: float, rate_hz: float) -> None:
        """Set the first deadline to start_s."""
        self._deadline_s = start_s
        self._rate_hz = rate_hz
        self._shift_s = 0.0

    @property
    def rate_hz(self) -> float:
        """The nominal rate."""
        return self._rate_hz

    @property
    def deadline_s(self) -> float:
        """The next deadline."""
        return self._deadline_s

    def set_rate(self, rate_hz: float) -> None:
        """Change the rate after the next deadline."""
        self._rate_hz = rate_hz

    def lock(self, arrival_s: float) -> None:
        """Shift the deadlines slightly towards a whole number of periods plus LOCK_MARGIN_S after arrival_s."""
        period_s = 1.0 / self._rate_hz
        ahead_s = self._deadline_s - (arrival_s + LOCK_MARGIN_S)
        error_s = ahead_s - period_s * math.floor(ahead_s / period_s + 0.5)
        self._shift_s = clamp(-LOCK_GAIN * error_s, -LOCK_SLEW * period_s, LOCK_SLEW * period_s)

    def advance(self, now_s: float) -> int:
        """Set the next deadline after a tick that ended at now_s; return the number of skipped ones.

        A deadline that is less than half a period late is still served; older ones are skipped.
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
