"""The results of a campaign as columns, read from its directory by whichever version."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.campaign import store
from hil.lab.campaign.scores import LIMITED
from hil.sim.truth import Array

AFTER = ("faults", "ended", "failed", "digest")  # behind the scores


@dataclass(frozen=True, slots=True)
class Results:
    """Columns of all runs of a campaign, sorted by the run; scores are NaN where there are none."""

    directory: Path
    spec: str
    identity: Mapping[str, Any]
    seeds: NDArray[np.int64]
    drawn: Mapping[str, NDArray[Any]]
    scores: Mapping[str, Array]
    faults: NDArray[Any]
    failed: NDArray[Any]

    @property
    def runs(self) -> int:
        """How many there are."""
        return int(self.seeds.size)

    @property
    def failures(self) -> int:
        """How many of them failed."""
        return int(np.count_nonzero(self.failed != ""))

    def text_of(self, name: str, row: int) -> str:
        """Return what a run drew, in words."""
        value = self.drawn[name][row]
        return value if isinstance(value, str) else f"{value:g}"


def read(directory: Path) -> Results:
    """Read the results of a campaign that is over, or raise UsageError."""
    identity = store.read_identity(directory)
    if not (directory / store.RUNS).exists():
        raise UsageError(f"{directory}: the campaign is not over; go on with --resume")
    table = store.read_table(directory / store.RUNS)
    names = table.column_names
    drawn = [name for name in names if name not in {"row", "seed", *LIMITED, *AFTER}]

    def column(name: str) -> NDArray[Any]:
        return np.asarray(table.column(name).to_numpy())

    return Results(
        directory,
        (directory / store.SPEC).read_text(encoding="utf-8"),
        identity,
        column("seed"),
        {name: column(name) for name in drawn},
        {name: column(name) for name in LIMITED if name in names},
        column("faults"),
        column("failed"),
    )
