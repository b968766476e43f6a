"""What became of a run of a campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from hil.lab.campaign.row import Row
from hil.lab.campaign.scores import Scores
from hil.sim.run_file import FINISHED


@dataclass(frozen=True, slots=True)
class Outcome:
    """A run that is over; `digest` is of truth.csv; with the compiled engine, of heading and rudder.

    `faults` are the warnings that she told, None where nobody could have told any; without scores she did not finish,
    or no goal lasted.
    """

    digest: str
    scores: Scores | None
    faults: tuple[str, ...] | None = None
    ended: str = FINISHED


def failure(outcome: Outcome, limits: Mapping[str, float]) -> str:
    """Say why a run counts as failed; empty for one that does not."""
    if outcome.ended != FINISHED:
        return outcome.ended
    if outcome.scores is None:
        return "no goal lasted" if limits else ""
    values = {name: getattr(outcome.scores, name) for name in limits}
    # Written so that NaN fails.
    over = [name for name, value in values.items() if not abs(value) <= limits[name]]
    return ", ".join(f"{name} {_shown(values[name])}" for name in over)


def _shown(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "never"


@dataclass(frozen=True, slots=True)
class Result:
    """A run and what became of it."""

    row: Row
    outcome: Outcome
