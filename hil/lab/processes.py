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
    """Start worker processes that end with this process, however it ends; SIGTERM closes their runs before they end.

    Submit only calls of `in_process`. The start method "spawn" does not copy the threads of this process.
    """
    pool = ProcessPoolExecutor(count, get_context(start), initializer=_initialise_worker, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        children = active_children()
        for child in children:
            child.terminate()
        for child in children:
            child.join(END_TIMEOUT_S)
            child.kill()
        # Wait for the pool's thread; otherwise Python 3.11 may write to a closed pipe when it exits.
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _initialise_worker(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the parent, which ends its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a forked process inherits the parent's handler
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # the parent has already ended
        os._exit(1)


def in_process(work: Callable[Arguments, Result], *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
    """Call a function in a worker process; SIGTERM ends the process after the run has been closed."""
    with interruptible():
        try:
            return work(*args, **kwargs)
        except KeyboardInterrupt:
            os._exit(1)  # the parent expects no result
