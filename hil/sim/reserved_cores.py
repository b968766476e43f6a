"""Reserved processor cores for a lockstep run, whose two processes take turns.

On one core the second process continues where the first has stopped. On two, each keeps its caches and polls for the
other's reply, so it need not be woken. That is faster but occupies both cores fully, so it is for a run that a person
waits for. Parallel runs take a core each; a run that finds none left reserves none.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

POLL_S = 0.002  # longer than either program needs for its part of a tick
CROWDED_S = 0.0005  # a yield this long shows another process on the core
PAUSE_S, MAX_PAUSE_S = 0.05, 1.6  # doubled each time that it was too short
GOOD_POLLS = 50  # in a row: no other process uses the cores


class TurnTaking:
    """Core assignment of two programs that take turns.

    With two cores each program keeps its own and polls for the other's reply before it sleeps, because waking takes
    longer than most replies. While another process uses one of the cores, both programs share the first.
    """

    def __init__(self, cores: Sequence[int] = ()) -> None:
        """Take the cores from `reserved_cores`."""
        self._cores = cores if len(cores) > 1 else ()
        self._separate_s = math.inf  # when they use separate cores again
        self._separate = False
        self._pause_s = PAUSE_S
        self._good_polls = 0
        self._other = 0
        self._answers = select.poll()

    def begin(self, connection: socket.socket) -> None:
        """Start with the program at the other end of a Unix socket."""
        self._other = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
        self._answers = select.poll()
        self._answers.register(connection, select.POLLIN)
        self._separate = False
        self._separate_s = -math.inf if self._cores else math.inf

    def poll_time_s(self) -> float:
        """Return the time for which the other program polls for its next reply; 0 to sleep at once."""
        if not self._separate and time.monotonic() >= self._separate_s:
            self._assign(True)
        return POLL_S if self._separate else 0.0

    def poll(self) -> None:
        """Return when the other program has replied, or when it is better to sleep until then."""
        if not self._separate:
            return
        begun_s = before_s = time.monotonic()
        while not self._answers.poll(0):
            os.sched_yield()
            now_s = time.monotonic()
            if now_s - before_s > CROWDED_S or now_s - begun_s > POLL_S:
                self._pause_s = PAUSE_S if self._good_polls >= GOOD_POLLS else min(2.0 * self._pause_s, MAX_PAUSE_S)
                self._good_polls = 0
                self._separate_s = now_s + self._pause_s
                self._assign(False)
                return
            before_s = now_s
        self._good_polls += 1

    def _assign(self, separate: bool) -> None:  # noqa: FBT001 - which of two states
        self._separate = separate
        with contextlib.suppress(OSError):  # the other program has ended or belongs to another user
            os.sched_setaffinity(self._other, {self._cores[separate]})


@contextmanager
def reserved_cores(most: int = 1) -> Iterator[tuple[int, ...]]:
    """Yield up to `most` reserved cores; keep this process and its new children on the first of them.

    No other run uses them. Yields none if there is only one core or none is left.
    """
    allowed = os.sched_getaffinity(0)
    with ExitStack() as claims:
        cores: list[int] = []
        for core in sorted(allowed):
            claim = claims.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            if len(allowed) > 1 and len(cores) < most and _claimed(claim, core):
                cores.append(core)
        os.sched_setaffinity(0, set(cores[:1]) or allowed)
        try:
            yield tuple(cores)
        finally:
            os.sched_setaffinity(0, allowed)


def _claimed(claim: socket.socket, core: int) -> bool:
    """Claim a core by an abstract socket name, which the kernel releases when the process ends."""
    try:
        claim.bind(f"\0rambler-lockstep-core-{core}")
    except OSError:
        return False
    return True
