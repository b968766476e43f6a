"""Reserved processor cores for a lockstep run, whose two processes take turns.

On one core the two processes alternate. On two cores each process keeps its caches and polls for the reply of the
other, which avoids the time to wake up. This is faster but uses both cores fully, so only interactive runs use it.
Parallel runs reserve one core each; a run reserves none if none is left.
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

POLL_S = 0.002  # longer than either program needs in a tick
MAX_YIELD_S = 0.0005  # a longer yield shows another process on the core
PAUSE_S, MAX_PAUSE_S = 0.05, 1.6  # doubled each time it was too short
MIN_GOOD_POLLS = 50  # in a row: no other process uses the cores


class TurnTaking:
    """Core assignment of two programs that take turns.

    With two cores each program keeps its own and polls for the other's reply before it sleeps, because waking takes
    longer than most replies. While another process uses one of the cores, both programs share the first.
    """

    def __init__(self, cores: Sequence[int] = ()) -> None:
        """Use the cores from `reserved_cores`."""
        self._cores = cores if len(cores) > 1 else ()
        self._separate_s = math.inf  # time at which the programs use separate cores again
        self._has_separate_cores = False
        self._pause_s = PAUSE_S
        self._good_polls = 0
        self._other_pid = 0
        self._replies = select.poll()

    def begin(self, connection: socket.socket) -> None:
        """Start with the program at the other end of a Unix socket."""
        self._other_pid = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
        self._replies = select.poll()
        self._replies.register(connection, select.POLLIN)
        self._has_separate_cores = False
        self._separate_s = -math.inf if self._cores else math.inf

    def poll_time_s(self) -> float:
        """Return the time for which the other program polls for its next reply; 0 to sleep at once."""
        if not self._has_separate_cores and time.monotonic() >= self._separate_s:
            self._assign(True)
        return POLL_S if self._has_separate_cores else 0.0

    def poll(self) -> None:
        """Poll until the other program has replied or another process needs the core."""
        if not self._has_separate_cores:
            return
        start_s = previous_s = time.monotonic()
        while not self._replies.poll(0):
            os.sched_yield()
            now_s = time.monotonic()
            if now_s - previous_s > MAX_YIELD_S or now_s - start_s > POLL_S:
                self._pause_s = PAUSE_S if self._good_polls >= MIN_GOOD_POLLS else min(2.0 * self._pause_s, MAX_PAUSE_S)
                self._good_polls = 0
                self._separate_s = now_s + self._pause_s
                self._assign(False)
                return
            previous_s = now_s
        self._good_polls += 1

    def _assign(self, separate: bool) -> None:  # noqa: FBT001 - which of two states
        self._has_separate_cores = separate
        with contextlib.suppress(OSError):  # the other program has ended or belongs to another user
            os.sched_setaffinity(self._other_pid, {self._cores[separate]})


@contextmanager
def reserved_cores(max_cores: int = 1) -> Iterator[tuple[int, ...]]:
    """Yield up to `max_cores` reserved cores; keep this process and its new children on the first of them.

    No other run uses them. Yields none if there is only one core or none is left.
    """
    allowed = os.sched_getaffinity(0)
    with ExitStack() as claim_sockets:
        cores: list[int] = []
        for core in sorted(allowed):
            claim_socket = claim_sockets.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            if len(allowed) > 1 and len(cores) < max_cores and _claim(claim_socket, core):
                cores.append(core)
        os.sched_setaffinity(0, set(cores[:1]) or allowed)
        try:
            yield tuple(cores)
        finally:
            os.sched_setaffinity(0, allowed)


def _claim(claim_socket: socket.socket, core: int) -> bool:
    """Claim a core by an abstract socket name, which the kernel releases when the process ends."""
    try:
        claim_socket.bind(f"\0rambler-lockstep-core-{core}")
    except OSError:
        return False
    return True
