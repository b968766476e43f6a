"""Interface of the engines that simulate runs, selection of the engine, and its versions."""

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
    """A module that simulates runs; `BATCH` is the maximum number of runs in a batch for a worker."""

    BATCH: int

    def refusals(self, spec: Spec) -> list[str]:
        """Return a line for each item of a specification that this engine does not support."""
        ...

    def make_ready(self, row: Row) -> None:
        """Compile the functions that such a run needs, before workers start."""
        ...

    def simulate(self, rows: Iterable[Row]) -> Iterator[Outcome]:
        """Simulate runs and yield their outcomes, in order."""
        ...


def engine_of(spec: Spec) -> Engine:
    """Return the engine of a campaign."""
    return cast("Engine", importlib.import_module(MODULES[spec.engine]))


def run_batch(spec: Spec, first: int, last: int) -> tuple[dict[str, str], list[Result]]:
    """Simulate the runs [first, last); return the versions of this process and the results."""
    batch = list(rows(spec, first, last))
    return versions(), list(map(Result, batch, engine_of(spec).simulate(batch)))


@cache
def versions() -> dict[str, str]:
    """Return all versions on which a result depends, and a digest of the sources of both programs."""
    # The bits of exp, sin and similar functions depend on the C library.
    result = {"python": platform.python_version(), "sources": _sources(), "libc": " ".join(platform.libc_ver())}
    for name in PACKAGES:
        try:
            result[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return result


def _sources() -> str:
    digest = hashlib.sha256()
    for package in (firmware_py, hil):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
