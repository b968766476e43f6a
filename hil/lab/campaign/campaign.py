"""Run a campaign: simulate the missing runs and store them batch by batch."""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from hil.errors import UsageError
from hil.lab.campaign import page, store, workers
from hil.lab.campaign.engines import engine_of, versions
from hil.lab.campaign.firmware_engine import FAULTS
from hil.lab.campaign.row import extremes, rows
from hil.lab.campaign.spec import Spec, read_spec_file
from hil.lab.campaign.store import Store
from hil.sim.run_directory import locked_directory
from hil.sim.signals import interruptible

MIN_BATCHES = 64  # so that all workers of a small campaign finish at about the same time

Report = Callable[[int, int, int], None]  # finished runs, all runs, runs finished by this process


@dataclass(frozen=True, slots=True)
class Workers:
    """Number of processes on this computer, or the address of a dask scheduler."""

    count: int = os.cpu_count() or 1
    scheduler: str | None = None


def read_spec(path: Path, beside: Path | None = None) -> Spec:
    """Read a specification and check it for its engine, or raise UsageError with a line for each error.

    The path of a vehicle file is relative to `beside`, by default the directory of the specification.
    """
    spec = read_spec_file(path, tuple(FAULTS), lambda spec: engine_of(spec).refusals(spec), beside)
    try:
        list(extremes(spec))
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None
    return spec


def run(spec: Spec, beside: Path, out: Path, worker_setup: Workers, report: Report, *, resume: bool) -> dict[str, Any]:
    """Run or resume a campaign; return the content of summary.json. `beside` is the directory of the specification."""
    with interruptible(), _cluster(worker_setup) as cluster, locked_directory(out):
        results = Store(out, spec, versions(), beside)
        results.begin(resume=resume)
        finished = results.finished()
        finished_before = sum(last - first for first, last in finished)
        started_s, finished_count = time.monotonic(), finished_before
        pending = store.pending_batches(spec.runs, finished, _batch_size(spec))
        for (first, last), batch in _run_batches(spec, worker_setup, cluster, pending):
            results.add(first, last, batch)
            finished_count += last - first
            report(finished_count, spec.runs, finished_count - finished_before)
        results.finish()
        table = store.read_results(out)
        figures = _figures(
            spec, table.failures, finished_count - finished_before, time.monotonic() - started_s, worker_setup
        )
        store.write_file(out / store.SUMMARY, (json.dumps(figures, indent=2) + "\n").encode())
        store.write_file(out / store.PAGE, page.text(table, spec.notes).encode())
    return figures


def _batch_size(spec: Spec) -> int:
    return min(engine_of(spec).BATCH, max(1, spec.runs // MIN_BATCHES))


def _cluster(worker_setup: Workers) -> AbstractContextManager[Any]:
    """Return the connection to the scheduler, or an empty context without a scheduler."""
    return nullcontext() if worker_setup.scheduler is None else workers.cluster(worker_setup.scheduler)


def _run_batches(
    spec: Spec, worker_setup: Workers, cluster: Any, batches: Iterator[workers.Batch]
) -> Iterator[workers.FinishedBatch]:
    if cluster is not None:
        yield from workers.run_on_cluster(cluster, spec, batches)
        return
    if (first := next(batches, None)) is not None:
        engine_of(spec).make_ready(next(rows(spec, *first)))
        yield from workers.run_locally(spec, chain([first], batches), worker_setup.count)


def _figures(spec: Spec, failed: int, runs_now: int, wall_s: float, worker_setup: Workers) -> dict[str, Any]:
    """Return the content of summary.json; the times are for the runs of this process on this computer."""
    usage = [resource.getrusage(target) for target in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "engine": spec.engine,
        "runs": spec.runs,
        "seconds": spec.seconds,
        "failed": failed,
        "sailed_now": runs_now,
        "workers": None if worker_setup.scheduler else worker_setup.count,
        "scheduler": worker_setup.scheduler,
        "wall_s": round(wall_s, 3),
        "processor_s": round(sum(entry.ru_utime + entry.ru_stime for entry in usage), 3),
        "runs_per_s": round(runs_now / wall_s, 3) if wall_s else None,
    }
