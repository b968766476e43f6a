"""Processes that sail runs for this one, and do not outlive it."""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import ParamSpec, TypeVar

from hil.sim.signals import interruptible

PATIENCE_S = 10.0
PR_SET_PDEATHSIG = 1
Given = ParamSpec("Given")
Result = TypeVar("Result")


@contextmanager
def processes(count: int, start: str = "spawn") -> Iterator[Executor]:
    """Have processes that end with this one, however it ends, and whose runs end in good order when it is told to.

    What they do is to be done by `in_process`. A fresh interpreter inherits no half of this one's threads; `start`
    is another way to begin them.
    """
    pool = ProcessPoolExecutor(count, get_context(start), initializer=_begin, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        children = active_children()
        for child in children:
            child.terminate()
        for child in children:
            child.join(PATIENCE_S)
            child.kill()
        # Waited for: a Python of 3.11 that ends meanwhile may wake its thread by a pipe that it has just closed.
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then ends its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a fork has the parent's
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # it died before that
        os._exit(1)


def in_process(work: Callable[Given, Result], *words: Given.args, **more: Given.kwargs) -> Result:
    """Do a piece of work in such a process; told to end, it ends once the run has ended in good order."""
    with interruptible():
        try:
            return work(*words, **more)
        except KeyboardInterrupt:
            os._exit(1)  # nobody waits for more
