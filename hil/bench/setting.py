"""How long each measurement takes, and where it may write."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Setting:
    """Seconds and counts of all measurements.

    `lateness_s` is by rate in Hz. A sense-to-actuate run counts from `lock_s` after the first goal on: the
    ticks approach the compass by 0.5 ms a tick, half a period at most, and the last
    of the way takes a time constant of ten ticks. What is compared with a program of others runs
    in `pairs`, one after the other; `fish_evaluations` and `plain_evaluations` are those of a search with
    a compiled objective and with one in Python.
    """

    directory: Path
    lateness_s: dict[int, float]
    lock_s: float
    sense_s: float
    echoes: int
    load_s: float
    bare_load_s: float
    starts: int
    lockstep_s: float
    trips: int
    pairs: int
    fish_evaluations: int
    plain_evaluations: int

    def within(self, directory: Path) -> Setting:
        """Return it with another directory."""
        return replace(self, directory=directory)


def quick(directory: Path) -> Setting:
    """About four minutes for everything."""
    return Setting(
        directory,
        lateness_s={10: 6.0, 50: 6.0},
        lock_s=15.0,
        sense_s=8.0,
        echoes=20,
        load_s=10.0,
        bare_load_s=3.0,
        starts=3,
        lockstep_s=120.0,
        trips=100,
        pairs=5,
        fish_evaluations=10_000,
        plain_evaluations=2000,
    )


def thorough(directory: Path) -> Setting:
    """About ten minutes for everything."""
    return Setting(
        directory,
        lateness_s={10: 45.0, 50: 25.0},
        lock_s=25.0,
        sense_s=30.0,
        echoes=50,
        load_s=30.0,
        bare_load_s=10.0,
        starts=5,
        lockstep_s=300.0,
        trips=300,
        pairs=9,
        fish_evaluations=20_000,
        plain_evaluations=4000,
    )
