"""A campaign from its specification to its results: what is still to be sailed is sailed and kept, batch by batch."""

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
from hil.lab.campaign import crew, page, spec, store, table
from hil.lab.campaign.engines import engine_of, versions
from hil.lab.campaign.faulted import FAULTS
from hil.lab.campaign.row import extremes, rows
from hil.lab.campaign.spec import Spec
from hil.lab.campaign.store import Store
from hil.sim.run_directory import held
from hil.sim.signals import interruptible

BATCHES = 64  # of a small campaign, so that no worker has much to do when the others are done

Tell = Callable[[int, int, int], None]  # runs that are done, of all; how many of them by now


@dataclass(frozen=True, slots=True)
class Crew:
    """Who sails: so many processes of this computer, or the workers of a dask scheduler."""

    workers: int = os.cpu_count() or 1
    scheduler: str | None = None


def read_spec(path: Path, beside: Path | None = None) -> Spec:
    """Read a specification that its engine can sail, or raise UsageError with a line for each error.

    A vehicle file is looked for beside it, or in a directory.
    """
    found = spec.read(path, tuple(FAULTS), lambda found: engine_of(found).refusals(found), beside)
    try:
        list(extremes(found))
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None
    return found


def run(found: Spec, beside: Path, out: Path, who: Crew, tell: Tell, *, resume: bool) -> dict[str, Any]:
    """Run what is left of a campaign, whose specification came from a directory; return the figures of summary.json."""
    with interruptible(), _cluster(who) as cluster, held(out):
        kept = Store(out, found, versions(), beside)
        kept.begin(resume=resume)
        finished = kept.finished()
        begun = sum(last - first for first, last in finished)
        begun_s, done = time.monotonic(), begun
        for (first, last), results in _sailed(found, who, cluster, store.missing(found.runs, finished, _batch(found))):
            kept.add(first, last, results)
            done += last - first
            tell(done, found.runs, done - begun)
        kept.finish()
        known = table.read(out)
        figures = _figures(found, known.failures, done - begun, time.monotonic() - begun_s, who)
        store.put(out / store.SUMMARY, (json.dumps(figures, indent=2) + "\n").encode())
        store.put(out / store.PAGE, page.text(known, found.notes).encode())
    return figures


def _batch(found: Spec) -> int:
    """Return how many runs are handed over at a time."""
    return min(engine_of(found).BATCH, max(1, found.runs // BATCHES))


def _cluster(who: Crew) -> AbstractContextManager[Any]:
    """Have the scheduler that was named, before anything is begun; None without one."""
    return nullcontext() if who.scheduler is None else crew.cluster(who.scheduler)


def _sailed(found: Spec, who: Crew, cluster: Any, batches: Iterator[crew.Batch]) -> Iterator[crew.Sailed]:
    if cluster is not None:
        yield from crew.sail_on(cluster, found, batches)
        return
    if (first := next(batches, None)) is not None:
        engine_of(found).make_ready(next(rows(found, *first)))
        yield from crew.sail_here(found, chain([first], batches), who.workers)


def _figures(found: Spec, failed: int, sailed: int, wall_s: float, who: Crew) -> dict[str, Any]:
    """Return how long the runs of this time took; what of it the processors of this computer worked."""
    used = [resource.getrusage(one) for one in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "engine": found.engine,
        "runs": found.runs,
        "seconds": found.seconds,
        "failed": failed,
        "sailed_now": sailed,
        "workers": None if who.scheduler else who.workers,
        "scheduler": who.scheduler,
        "wall_s": round(wall_s, 3),
        "processor_s": round(sum(one.ru_utime + one.ru_stime for one in used), 3),
        "runs_per_s": round(sailed / wall_s, 3) if wall_s else None,
    }
