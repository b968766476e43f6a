"""The scheduling that the autopilot asks for, for those who are compared with it and those who measure it."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 40  # the autopilot's own
_PR_SET_TIMERSLACK = 29
_DEFAULT_SLACK = 0
_SHORTEST_SLACK_NS = 1


@contextmanager
def steady() -> Iterator[bool]:
    """Run with SCHED_FIFO, exact timers and no garbage collector; yields whether SCHED_FIFO was allowed.

    Processes that are started meanwhile begin with the ordinary scheduling.
    """
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_TIMERSLACK, _SHORTEST_SLACK_NS, 0, 0, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        real_time = True
    except OSError:
        real_time = False
    gc.collect()
    gc.disable()
    try:
        yield real_time
    finally:
        gc.enable()
        if real_time:
            os.sched_setscheduler(0, policy, parameters)
        libc.prctl(_PR_SET_TIMERSLACK, _DEFAULT_SLACK, 0, 0, 0)
