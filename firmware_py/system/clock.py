"""Clocks of the computer and of the HIL, and the timer of the ticks. No other module reads the time."""

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

# Delay from the arrival of a compass sample to its tick: longer than the jitter of a compass, short compared with the
# response of the boat.
LOCK_MARGIN_S = 0.002
# In periods per tick; a larger step would change the rate noticeably.
MAX_PHASE_STEP = 0.005
LOCK_GAIN = 0.1
MAX_POLL_SETS = 16
LOCKSTEP_PROTOCOL = 2
REPLY = struct.Struct("<ddd")  # new time, step of UTC, time of busy waiting for the next reply
LINE_EVENT = struct.Struct("<dQ")  # time, number of the line
MAX_REPLY_BYTES = 4096
BOOT_ID = "RAMBLER_BOOT_ID"  # environment variable that the service unit sets
LOCKSTEP_BOOT = "lockstep"  # used as boot id, because the clock of the HIL is independent of boots


class ClockError(RuntimeError):
    """The connection to the clock of the HIL is lost."""


class RealClock:
    """The computer's monotonic clock, counted from the start of the process."""

    def __init__(self) -> None:
        """Start the clock at 0."""
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Return the seconds since the start."""
        return time.monotonic() - self._start_s

    def utc_s(self) -> float:
        """Return the seconds since 1970-01-01 UTC by the computer's clock."""
        return time.time()

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Sleep until the deadline or until a descriptor is readable; return the readable ones."""
        remaining_s = deadline_s - (time.monotonic() - self._start_s)
        return select.select(descriptors, [], [], max(0.0, remaining_s))[0]


def machine_s() -> float:
    """Return the seconds since the boot, including suspended time; the same for all processes."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def boot_id(path: Path = Path("/proc/sys/kernel/random/boot_id"), environment: Mapping[str, str] = os.environ) -> str:
    """Return the boot id, empty if it is unknown; a service has no access to /proc/sys and uses BOOT_ID."""
    try:
        # A codec name would load a module from the disk.
        return (environment.get(BOOT_ID) or path.read_bytes().decode()).strip().replace("-", "")
    except (OSError, UnicodeDecodeError):
        return ""


def set_utc_s(utc_s: float) -> bool:
    """Set the computer's calendar clock, which is not used for deadlines; return False if that is not permitted."""
    try:
        time.clock_settime(time.CLOCK_REALTIME, utc_s)
    except OSError:
        return False
    return True


class LockstepClock:
    """The clock of the HIL: simulated time stops while the autopilot computes.

    Each wait sends one packet (deadline, serial lines to wait for, bytes written so far on each line) and receives one
    (new time, step of UTC, times of data on read-only lines before that). Before the reply, the HIL has read the
    written bytes, advanced the simulation to the deadline or to the first data on a line to wait for, and written these
    data to the serial lines. The HIL does not stop for data on read-only lines; the following waits return at their
    times. All other code is the same as at sea.
    """

    def __init__(
        self,
        path: str,
        lines: Sequence[str],
        written: Callable[[], Sequence[int]],
        settle: Callable[[], bool] = lambda: False,
        fed: Callable[[], Sequence[int]] = tuple,
    ) -> None:
        """Connect to the socket of the HIL; `written` returns the byte counts of the serial lines named in `lines`.

        `settle` waits for the disk without simulated time and returns whether callbacks are due. `fed` returns the
        descriptors of the lines, which only the HIL makes readable.
        """
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(path)
            self._socket.sendall(json.dumps({"protocol": LOCKSTEP_PROTOCOL, "lines": list(lines)}).encode())
            handshake = json.loads(self._socket.recv(65536))
        except OSError as error:
            self._socket.close()
            raise ClockError(f"lockstep socket {path}: {error.strerror}; is the HIL running?") from None
        self._now_s = float(handshake["start_s"])
        self._utc_offset_s = float(handshake["utc_s"]) - self._now_s
        self._written = written
        self._settle = settle
        self._fed = fed
        self._poll_sets: dict[tuple[tuple[int, ...], tuple[int, ...]], _PollSet] = {}
        self._packet = struct.Struct(f"<d{1 + len(lines)}Q")
        self._awaits_reply = False
        self._busy_wait_s = 0.0
        # Times and lines of data, latest first; the end of the wait has line -1.
        self._pending_events: list[tuple[float, int]] = []

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

        A descriptor that the HIL does not feed (the socket of an external ground station) ends the wait without an
        advance of time. Then no line of the HIL is returned, because its bytes belong to a later time.
        """
        poll_set = self._poll_set(tuple(descriptors), tuple(self._fed()))
        if self._settle() and (ready := self._readable(poll_set)):
            return ready
        if deadline_s > self._now_s and not (self._awaits_reply or self._pending_events):
            self._send(deadline_s, poll_set.line_bits)
        if self._awaits_reply and poll_set.wait_for_hil(self._busy_wait_s):
            self._receive()
        if deadline_s > self._now_s and self._pending_events:
            self._now_s, line = self._pending_events.pop()
            if line >= 0:
                return [descriptor for descriptor in (self._fed()[line],) if descriptor in descriptors]
        return self._readable(poll_set)

    def _readable(self, poll_set: _PollSet) -> Sequence[int]:
        return poll_set.ready(fed=not (self._awaits_reply or self._pending_events))

    def _poll_set(self, descriptors: tuple[int, ...], fed: tuple[int, ...]) -> _PollSet:
        """Return the cached poll objects for the descriptors."""
        poll_set = self._poll_sets.get((descriptors, fed))
        if poll_set is None:
            if len(self._poll_sets) >= MAX_POLL_SETS:
                self._poll_sets.clear()
            poll_set = self._poll_sets[descriptors, fed] = _PollSet(descriptors, fed, self._socket.fileno())
        return poll_set

    def _send(self, deadline_s: float, line_bits: int) -> None:
        try:
            self._socket.sendall(self._packet.pack(deadline_s, line_bits, *self._written()))
        except OSError as error:
            raise ClockError(f"connection to the HIL lost: {error.strerror}") from None
        self._awaits_reply = True

    def _receive(self) -> None:
        try:
            packet = self._socket.recv(MAX_REPLY_BYTES)
        except OSError as error:
            raise ClockError(f"connection to the HIL lost: {error.strerror}") from None
        if not packet:
            raise ClockError("the HIL has ended the run")
        now_s, step_s, self._busy_wait_s = REPLY.unpack_from(packet)
        self._utc_offset_s += step_s
        self._pending_events = [(now_s, -1), *reversed([*LINE_EVENT.iter_unpack(packet[REPLY.size :])])]
        self._awaits_reply = False


class _PollSet:
    """Poll objects for a set of descriptors; reuse needs a third of the time of creation."""

    def __init__(self, descriptors: Sequence[int], fed: Sequence[int], hil: int) -> None:
        """Register the descriptors; those not in `fed` may end a wait for the HIL."""
        self.line_bits = sum(1 << line for line, descriptor in enumerate(fed) if descriptor in descriptors)
        self._descriptors = descriptors
        self._hil = hil
        self._full_poll, self._wake_poll = select.poll(), select.poll()
        for descriptor in descriptors:
            self._full_poll.register(descriptor, select.POLLIN)
        for descriptor in {hil, *descriptors}.difference(fed):
            self._wake_poll.register(descriptor, select.POLLIN)

    def ready(self, *, fed: bool) -> list[int]:
        """Return the readable descriptors in order of registration, with or without the lines of the HIL."""
        ready = {descriptor for descriptor, _ in (self._full_poll if fed else self._wake_poll).poll(0)}
        return [descriptor for descriptor in self._descriptors if descriptor in ready]

    def wait_for_hil(self, busy_wait_s: float) -> bool:
        """Wait for the HIL or another descriptor; return whether the HIL has replied.

        The first `busy_wait_s`, set by the HIL, are a busy wait: on a free core, a wake-up takes longer than the work
        of the HIL.
        """
        end_s = time.monotonic() + busy_wait_s
        while not (ready := self._wake_poll.poll(0)) and time.monotonic() < end_s:
            os.sched_yield()
        return any(descriptor == self._hil for descriptor, _ in ready or self._wake_poll.poll())


class TickTimer:
    """Absolute deadlines at a fixed rate; missed deadlines are skipped.

    The phase can be locked slowly to an external event (the arrival of a compass sample); otherwise it is free.
    """

    def __init__(self, start_s: float, rate_hz: float) -> None:
        """Set the first deadline to `start_s`."""
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
        """Shift the deadlines by a limited step towards LOCK_MARGIN_S after `arrival_s`, modulo the period."""
        period_s = 1.0 / self._rate_hz
        ahead_s = self._deadline_s - (arrival_s + LOCK_MARGIN_S)
        error_s = ahead_s - period_s * math.floor(ahead_s / period_s + 0.5)
        self._shift_s = clamp(-LOCK_GAIN * error_s, -MAX_PHASE_STEP * period_s, MAX_PHASE_STEP * period_s)

    def advance(self, now_s: float) -> int:
        """Set the next deadline after a tick that ended at `now_s`; return the number of skipped deadlines.

        A deadline is skipped if it is at least half a period in the past.
        """
        period_s = 1.0 / self._rate_hz
        self._deadline_s += period_s + self._shift_s
        self._shift_s = 0.0
        late_s = now_s - self._deadline_s
        if late_s < 0.5 * period_s:
            return 0
        skipped = math.floor(late_s / period_s + 0.5)
        self._deadline_s += skipped * period_s
        return skipped
