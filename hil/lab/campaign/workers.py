"""Run batches in processes of this computer or on a dask cluster; repeat the batches of killed workers."""

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
from hil.lab.campaign.engines import run_batch, versions
from hil.lab.campaign.row import Result
from hil.lab.campaign.spec import Spec
from hil.lab.campaign.store import import_extra
from hil.lab.processes import in_process, processes

QUEUED_BATCHES = 2  # per worker, so that no worker waits for its next batch
MAX_LOSSES = 3  # consecutive losses of workers without a finished batch
TIMEOUT_S = 10.0
ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+")
REMEDY = "continue with --resume"

Batch = tuple[int, int]
FinishedBatch = tuple[Batch, list[Result]]


def run_locally(spec: Spec, batches: Iterator[Batch], workers: int) -> Iterator[FinishedBatch]:
    """Yield the batches as worker processes finish them; repeat the batches of a killed process."""
    losses = 0
    while True:
        pending: dict[Future[Any], Batch] = {}
        try:
            with processes(workers) as pool:
                for batch in _run_batches(pool, _run_in_process, spec, batches, lambda: workers, pending):
                    losses = 0
                    yield batch
        except BrokenProcessPool:
            losses += 1
            if losses == MAX_LOSSES:
                raise HilError(f"{losses} worker processes were killed in a row; {REMEDY}") from None
            batches = chain(list(pending.values()), batches)
        else:
            return


def check_address(address: str) -> None:
    """Raise UsageError if `address` is not the address of a scheduler."""
    if ADDRESS.fullmatch(address) is None:
        raise UsageError(f"--scheduler {address[:60]}: write tcp://HOST:PORT")


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """Connect to a dask scheduler for the context; raise UsageError if no scheduler responds."""
    check_address(address)
    distributed = import_extra("distributed")
    # Dask logs several lines for an error; the handler below reports one.
    logging.disable(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {address}: no dask scheduler answers: {_one_line(error)}") from None
    with client:
        yield client


def run_on_cluster(client: Any, spec: Spec, batches: Iterator[Batch]) -> Iterator[FinishedBatch]:
    """Yield the batches as the workers of a dask scheduler finish them."""
    distributed, address = import_extra("distributed"), client.scheduler.address
    with client.get_executor() as pool:
        try:
            yield from _run_batches(pool, run_batch, spec, batches, lambda: len(client.ncores()), {})
        except (HilError, GeneratorExit, KeyboardInterrupt):
            pool.shutdown(wait=False)
            raise
        except (CancelledError, ImportError, OSError, RuntimeError, distributed.KilledWorker) as error:
            pool.shutdown(wait=False)
            raise HilError(f"--scheduler {address}: {type(error).__name__}: {_one_line(error)}; {REMEDY}") from None


def _run_batches(
    pool: Executor,
    work: Callable[[Spec, int, int], Any],
    spec: Spec,
    batches: Iterator[Batch],
    workers: Callable[[], int],
    pending: dict[Future[Any], Batch],
) -> Iterator[FinishedBatch]:
    """Yield the batches in the order of their completion; `pending` contains those submitted and not yielded."""
    own_versions, has_warned = versions(), False
    while True:
        while len(pending) < QUEUED_BATCHES * max(1, workers()) and (batch := next(batches, None)) is not None:
            pending[pool.submit(work, spec, *batch)] = batch
        if not pending:
            return
        done_futures = wait(pending, TIMEOUT_S, FIRST_COMPLETED).done
        if not (done_futures or has_warned or workers()):
            has_warned = True
            print("rambler-hil: the scheduler has no workers; waiting for workers", file=sys.stderr)
        for future in done_futures:
            worker_versions, results = future.result()
            if worker_versions != own_versions:
                differing = sorted(
                    name
                    for name in own_versions | worker_versions
                    if own_versions.get(name) != worker_versions.get(name)
                )
                raise HilError(f"a worker has other versions than this computer: {', '.join(differing)}; {REMEDY}")
            yield pending.pop(future), results


def _run_in_process(spec: Spec, first: int, last: int) -> tuple[dict[str, str], list[Result]]:
    return in_process(run_batch, spec, first, last)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
