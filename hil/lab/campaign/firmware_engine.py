"""Runs of a campaign by the autopilot itself, in lockstep: a process of its own for each, as `rambler-hil run` has."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from hil.errors import HilError
from hil.lab.campaign import faulted
from hil.lab.campaign.faulted import Text
from hil.lab.campaign.outcome import Outcome
from hil.lab.campaign.row import Row
from hil.lab.campaign.scores import scores_of
from hil.lab.campaign.spec import Spec
from hil.sim import run_file, runner
from hil.sim.run_directory import TRUTH_FILE
from hil.sim.run_file import FINISHED
from hil.sim.truth import read
from hil.sim.vehicle_file import standard_vehicle

BATCH = 1
TRIES = 4
WARNING = 4  # MAV_SEVERITY_WARNING; graver ones have smaller numbers
# The log looks on from the side: what nobody will read need not be written.
UNLOGGED = {"LOG_ENABLE": 0.0}
REFUSED = "cannot be had together with [fault]; leave one out"
PATHS = re.compile(r"(?<![\w/])/[\w./-]+")


def refusals(spec: Spec) -> list[str]:
    """Return a line for each thing of a specification that the autopilot cannot sail."""
    if "fault.what" not in spec.draws:
        return []
    lines = [f"with.{name}: {REFUSED}" for name in faulted.UNKNOWN_OPTIONS if name in spec.options]
    lines += [f"{name}: {REFUSED}" for name in ("compass", "servo") if name in spec.draws]
    return lines + ([f"vehicle: {REFUSED}"] if spec.vehicle != standard_vehicle() else [])


def make_ready(row: Row) -> None:
    """Do nothing: the autopilot is ready."""


def sail(rows: Iterable[Row]) -> Iterator[Outcome]:
    """Sail runs and yield what became of them, in order."""
    yield from map(_believed, rows)


def _believed(row: Row) -> Outcome:
    """Sail a run; a failure is believed when it comes twice the same, for a busy machine can end a run as well."""
    outcome = _sailed_unlogged(row)
    for _ in range(TRIES):
        if outcome.ended == FINISHED:
            return outcome
        before, outcome = outcome, _sailed_unlogged(row)
        if outcome == before:
            return outcome
    raise HilError(f"run {row.index} ends differently each time: {outcome.ended}")


def _sailed_unlogged(row: Row) -> Outcome:
    with tempfile.TemporaryDirectory(prefix="rambler-campaign-") as directory:
        return sail_into(row, Path(directory) / "run", full=False)


def sail_into(row: Row, out: Path, *, full: bool) -> Outcome:
    """Sail a run into a directory, in full with its log and live on a terminal; it comes to the same without."""
    try:
        texts, ended = _sailed(row, out, full=full), FINISHED
    except HilError as error:
        # A run that could not even begin has nothing to be judged.
        if not (out / run_file.NAME).exists():
            raise
        texts, ended = (), PATHS.sub("...", str(error))
    content = (out / TRUTH_FILE).read_bytes()
    warnings = tuple(dict.fromkeys(text for _, grade, text in texts if grade <= WARNING))
    scores = None
    if ended == FINISHED:
        truth = read(out / TRUTH_FILE)
        scores = scores_of(truth.heading_low_rad, truth.rudder_rad, truth.goal_rad)
    return Outcome(hashlib.sha256(content).hexdigest(), scores, warnings, ended)


def _sailed(row: Row, out: Path, *, full: bool) -> tuple[Text, ...]:
    if row.fault is not None:
        # What breaks may be the log itself.
        return faulted.sail(row, row.fault, out)
    options = row.options(out)
    if not full:
        options = replace(options, settings={**UNLOGGED, **options.settings}, shown=False)
    return runner.run(options).texts
