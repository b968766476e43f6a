"""The engines behind one interface: what a specification may ask of each, and a batch of runs sailed."""

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
from hil.lab.campaign.outcome import Outcome, Result
from hil.lab.campaign.row import Row, rows
from hil.lab.campaign.spec import COMPILED, FIRMWARE, Spec

# Imported by name: the compiled engine imports numba, which runs of the autopilot itself do not need.
MODULES = {FIRMWARE: "hil.lab.campaign.firmware_engine", COMPILED: "hil.lab.campaign.compiled_engine"}
PACKAGES = ("rambler-autopilot", "numpy", "numba", "pymavlink", "pyarrow")


class Engine(Protocol):
    """What sails runs; each is a module. `BATCH` is how many are worth being handed over and kept at a time."""

    BATCH: int

    def refusals(self, spec: Spec) -> list[str]:
        """Return a line for each thing of a specification that this engine cannot sail."""
        ...

    def make_ready(self, row: Row) -> None:
        """Do what all workers would do each, and what they find done: compile what sails such runs."""
        ...

    def sail(self, rows: Iterable[Row]) -> Iterator[Outcome]:
        """Sail runs and yield what became of them, in order."""
        ...


def engine_of(spec: Spec) -> Engine:
    """Return the engine of a campaign."""
    return cast("Engine", importlib.import_module(MODULES[spec.engine]))


def sail_batch(spec: Spec, first: int, last: int) -> tuple[dict[str, str], list[Result]]:
    """Sail the runs [first, last), in any process of any machine; return the versions there, and the results."""
    batch = list(rows(spec, first, last))
    return versions(), list(map(Result, batch, engine_of(spec).sail(batch)))


@cache
def versions() -> dict[str, str]:
    """Return all versions that a result depends on; of the programs themselves, a digest of their sources."""
    # Of the C library are the bits of exp, sin and their kin.
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
