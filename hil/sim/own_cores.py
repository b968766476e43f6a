"""Cores of its own for a run in lockstep, whose two processes take turns.

On one core the second goes on where the first has stopped; on two, each has its own caches and need not be woken if
it looks for the other's answer meanwhile. That is quicker, and takes both cores whole: it is for a run that somebody
waits for. Runs beside one another take a core each, and one that finds none left goes without.
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

LOOK_S = 0.002  # longer than either program needs for its part of a tick
CROWDED_S = 0.0005  # who gives way and comes back so late has met somebody else on the core
PAUSE_S, LONGEST_PAUSE_S = 0.05, 1.6  # twice as long each time that it was too short
GOOD_LOOKS = 50  # in a row: nobody else is on the cores


class Turns:
    """How two programs that take turns share the cores of a run.

    With two cores each keeps to its own and looks for the other's answer before it sleeps, for to be woken takes
    longer than most answers. Where somebody else wants one of them, both keep to the first for a while.
    """

    def __init__(self, cores: Sequence[int] = ()) -> None:
        """Take what `own_cores` has yielded."""
        self._cores = cores if len(cores) > 1 else ()
        self._apart_s = math.inf  # from then on they are apart
        self._apart = False
        self._pause_s = PAUSE_S
        self._good_looks = 0
        self._other = 0
        self._answers = select.poll()

    def begin(self, connection: socket.socket) -> None:
        """Take turns with the program at the other end of a Unix socket."""
        self._other = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
        self._answers = select.poll()
        self._answers.register(connection, select.POLLIN)
        self._apart = False
        self._apart_s = -math.inf if self._cores else math.inf

    def look_s(self) -> float:
        """For how long the other is to look for the answer that it is about to get next; 0 where it sleeps at once."""
        if not self._apart and time.monotonic() >= self._apart_s:
            self._part(True)
        return LOOK_S if self._apart else 0.0

    def look(self) -> None:
        """Return when the other has answered, or when it is better to sleep until then."""
        if not self._apart:
            return
        begun_s = before_s = time.monotonic()
        while not self._answers.poll(0):
            os.sched_yield()
            now_s = time.monotonic()
            if now_s - before_s > CROWDED_S or now_s - begun_s > LOOK_S:
                self._pause_s = PAUSE_S if self._good_looks >= GOOD_LOOKS else min(2.0 * self._pause_s, LONGEST_PAUSE_S)
                self._good_looks = 0
                self._apart_s = now_s + self._pause_s
                self._part(False)
                return
            before_s = now_s
        self._good_looks += 1

    def _part(self, apart: bool) -> None:  # noqa: FBT001 - which of two states
        self._apart = apart
        with contextlib.suppress(OSError):  # it has ended, or is none of ours
            os.sched_setaffinity(self._other, {self._cores[apart]})


@contextmanager
def own_cores(most: int = 1) -> Iterator[tuple[int, ...]]:
    """Keep this process, and those that it starts meanwhile, on the first of the cores that it yields.

    These are at most so many, and no other run keeps to them; none where there is but one or none is left.
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
    """Claim a core by a name in no directory, which is free again when the process ends, however it ends."""
    try:
        claim.bind(f"\0rambler-lockstep-core-{core}")
    except OSError:
        return False
    return True
