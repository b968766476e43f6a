"""Worker processes that end with their parent."""

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

END_TIMEOUT_S = 10.0
PR_SET_PDEATHSIG = 1
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@contextmanager
def processes(count: int, start: str = "spawn") -> Iterator[Executor]:
    """Start worker processes that end with this one, however it ends; SIGTERM ends their runs in good order.

    Their work must be done by `in_process`. The start method "spawn" does not copy the threads of this process.
    """
    pool = ProcessPoolExecutor(count, get_context(start), initializer=_begin, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        children = active_children()
        for child in children:
            child.terminate()
        for child in children:
            child.join(END_TIMEOUT_S)
            child.kill()
        # Wait for its thread: at its exit Python 3.11 may otherwise write to a pipe that is already closed.
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begin(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the parent, which ends its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a forked process inherits the parent's handler
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # the parent has already ended
        os._exit(1)


def in_process(work: Callable[Arguments, Result], *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
    """Do a piece of work in a worker process; SIGTERM ends it after the run has been closed."""
    with interruptible():
        try:
            return work(*args, **kwargs)
        except KeyboardInterrupt:
            os._exit(1)  # the parent does not wait for a result
