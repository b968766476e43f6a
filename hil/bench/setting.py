"""The duration of each measurement, and the directory that it may write to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Setting:
    """Durations and counts of all measurements.

    The latency is measured for `sense_s`, from `lock_s` after the first goal: the ticks approach the compass samples by
    0.5 ms per tick, by half a period at most, and the end of the approach has a time constant of ten ticks.

    `load_s`, `bare_load_s`: duration of the load measurement of the autopilot and of a minimal Python process.
    `starts`: starts of the autopilot, and lockstep runs. `lockstep_s`: simulated time of each lockstep run.
    `pairs`: alternating runs of each of two compared programs, and repeated runs of an offline tool.
    `evaluations`: evaluations of the objective in one run of the fish swarm.
    """

    directory: Path
    lock_s: float
    sense_s: float
    load_s: float
    bare_load_s: float
    starts: int
    lockstep_s: float
    pairs: int
    evaluations: int

    def with_directory(self, directory: Path) -> Setting:
        """Return the setting with another directory."""
        return replace(self, directory=directory)


def quick(directory: Path) -> Setting:
    """Return the setting for a bench of about three minutes."""
    return Setting(
        directory,
        lock_s=15.0,
        sense_s=8.0,
        load_s=10.0,
        bare_load_s=3.0,
        starts=3,
        lockstep_s=120.0,
        pairs=5,
        evaluations=50_000,
    )


def thorough(directory: Path) -> Setting:
    """Return the setting for a bench of about six minutes."""
    return Setting(
        directory,
        lock_s=25.0,
        sense_s=30.0,
        load_s=30.0,
        bare_load_s=10.0,
        starts=5,
        lockstep_s=300.0,
        pairs=9,
        evaluations=200_000,
    )
