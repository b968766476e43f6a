"""Asks the kernel and the interpreter for steady timing, and says what was not granted."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

PRIORITY = 40
_MCL_CURRENT = 1
_MCL_ONFAULT = 4  # only what is touched, so that whole libraries are not drawn into memory
_PR_SET_TIMERSLACK = 29
# A background thread that computes gives the interpreter up after this long.
SWITCH_INTERVAL_S = 0.0005


def prepare() -> tuple[str, ...]:
    """Set real-time priority, lock memory, tighten timers, freeze the collector; return what failed."""
    refused = []
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        refused.append(f"SCHED_FIFO not allowed ({error.strerror}): ticks may come late under load")
    if libc.mlockall(_MCL_CURRENT | _MCL_ONFAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
        refused.append(f"mlockall not allowed ({reason}): a page fault may delay a tick")
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    gc.disable()
    return tuple(refused)
