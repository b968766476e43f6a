"""A core of its own for a run in lockstep, whose two processes take turns.

On one core the second goes on where the first has stopped, with what it needs still in the core's caches; on two, each
turn wakes a core that sleeps. Runs beside one another take a core each, and one that finds none left goes without.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process, and those that it starts meanwhile, on a core that no other run keeps to."""
    allowed = os.sched_getaffinity(0)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        core = next((core for core in sorted(allowed) if _claimed(claim, core)), None)
        if core is None or len(allowed) == 1:
            yield
            return
        os.sched_setaffinity(0, {core})
        try:
            yield
        finally:
            os.sched_setaffinity(0, allowed)


def _claimed(claim: socket.socket, core: int) -> bool:
    """Claim a core by a name in no directory, which is free again when the process ends, however it ends."""
    try:
        claim.bind(f"\0rambler-lockstep-core-{core}")
    except OSError:
        return False
    return True
