"""Interface of the engines that simulate runs, and a batch of runs."""

from __future__ import annotations

import hashlib
import importlib
import platform
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Protocol, cast

import firmware_py
import hil
from hil.lab.campaign.row import Outcome, Result, Row, rows
from hil.lab.campaign.spec import COMPILED, FIRMWARE, Spec

# Imported by name: runs of the autopilot process do not need the compiled engine.
MODULES = {FIRMWARE: "hil.lab.campaign.firmware_engine", COMPILED: "hil.lab.campaign.compiled_engine"}
PACKAGES = ("rambler-autopilot", "numpy", "numba", "pymavlink", "pyarrow")


class Engine(Protocol):
    """A module that simulates runs; `BATCH` is the number of runs given to a worker at a time."""

    BATCH: int

    def refusals(self, spec: Spec) -> list[str]:
        """Return a line for each item of a specification that this engine does not support."""
        ...

    def make_ready(self, row: Row) -> None:
        """Do once what every worker needs: compile the functions for such a run."""
        ...

    def simulate(self, rows: Iterable[Row]) -> Iterator[Outcome]:
        """Simulate runs and yield their outcomes, in order."""
        ...


def engine_of(spec: Spec) -> Engine:
    """Return the engine of a campaign."""
    return cast("Engine", importlib.import_module(MODULES[spec.engine]))


def run_batch(spec: Spec, first: int, last: int) -> tuple[dict[str, str], list[Result]]:
    """Simulate the runs [first, last) in any process; return the versions of that process, and the results."""
    batch = list(rows(spec, first, last))
    return versions(), list(map(Result, batch, engine_of(spec).simulate(batch)))


@cache
def versions() -> dict[str, str]:
    """Return all versions that a result depends on, with a digest of the sources of both programs."""
    # The bits of exp, sin and similar functions depend on the C library.
    found = {"python": platform.python_version(), "sources": _sources(), "libc": " ".join(platform.libc_ver())}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _sources() -> str:
    digest = hashlib.sha256()
    for package in (firmware_py, hil):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
