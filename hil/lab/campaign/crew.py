"""Who sails the batches: processes of this computer, or a dask cluster; what a killed one had in hand is not lost."""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain
from typing import Any

from hil.errors import HilError, UsageError
from hil.lab.campaign.engines import sail_batch, versions
from hil.lab.campaign.extra import imported
from hil.lab.campaign.outcome import Result
from hil.lab.campaign.spec import Spec
from hil.lab.processes import in_process, processes

WAITING = 2  # batches for each worker: one is there when another is done
LOSSES = 3  # of workers, one after another without a batch between them
PATIENCE_S = 10.0
ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+")
GO_ON = "go on with --resume"

Batch = tuple[int, int]
Sailed = tuple[Batch, list[Result]]


def sail_here(spec: Spec, batches: Iterator[Batch], workers: int) -> Iterator[Sailed]:
    """Yield the batches as so many processes sail them; what one that was killed had in hand is sailed anew."""
    losses = 0
    while True:
        waiting: dict[Future[Any], Batch] = {}
        try:
            with processes(workers) as pool:
                for sailed in _sailed(pool, _sail_in_process, spec, batches, lambda: workers, waiting):
                    losses = 0
                    yield sailed
        except BrokenProcessPool:
            losses += 1
            if losses == LOSSES:
                raise HilError(f"{losses} worker processes were killed, one after another; {GO_ON}") from None
            batches = chain(list(waiting.values()), batches)
        else:
            return


def check_address(address: str) -> None:
    """UsageError for what is no address of a scheduler."""
    if ADDRESS.fullmatch(address) is None:
        raise UsageError(f"--scheduler {address[:60]}: write tcp://HOST:PORT")


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """Have a dask scheduler that answers, and be done with it in the end; UsageError where there is none."""
    check_address(address)
    distributed = imported("distributed")
    # What goes wrong is told here, in one line.
    logging.disable(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {address}: no dask scheduler answers: {_line(error)}") from None
    with client:
        yield client


def sail_on(client: Any, spec: Spec, batches: Iterator[Batch]) -> Iterator[Sailed]:
    """Yield the batches as the workers of a dask scheduler sail them."""
    distributed, address = imported("distributed"), client.scheduler.address
    with client.get_executor() as pool:
        try:
            yield from _sailed(pool, sail_batch, spec, batches, lambda: len(client.ncores()), {})
        except (HilError, GeneratorExit, KeyboardInterrupt):
            pool.shutdown(wait=False)
            raise
        except (CancelledError, ImportError, OSError, RuntimeError, distributed.KilledWorker) as error:
            pool.shutdown(wait=False)
            raise HilError(f"--scheduler {address}: {type(error).__name__}: {_line(error)}; {GO_ON}") from None


def _sailed(
    pool: Executor,
    work: Callable[[Spec, int, int], Any],
    spec: Spec,
    batches: Iterator[Batch],
    workers: Callable[[], int],
    waiting: dict[Future[Any], Batch],
) -> Iterator[Sailed]:
    """Yield what has been sailed, however soon; `waiting` has what was given out and has not been yielded."""
    own, told = versions(), False
    while True:
        while len(waiting) < WAITING * max(1, workers()) and (batch := next(batches, None)) is not None:
            waiting[pool.submit(work, spec, *batch)] = batch
        if not waiting:
            return
        done = wait(waiting, PATIENCE_S, FIRST_COMPLETED).done
        if not (done or told or workers()):
            told = True
            print("rambler-hil: the scheduler has no workers; it goes on when there are some", file=sys.stderr)
        for future in done:
            found, results = future.result()
            if found != own:
                differs = sorted(name for name in own | found if own.get(name) != found.get(name))
                raise HilError(f"a worker has other versions than this computer: {', '.join(differs)}; {GO_ON}")
            yield waiting.pop(future), results


def _sail_in_process(spec: Spec, first: int, last: int) -> tuple[dict[str, str], list[Result]]:
    return in_process(sail_batch, spec, first, last)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
