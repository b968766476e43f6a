"""How long each measurement takes, and where it may write."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Setting:
    """Seconds and counts of all measurements.

    `lateness_s` is by rate in Hz. A sense-to-actuate run counts from `lock_s` on: the
    ticks approach the compass by 0.5 ms a tick, half a period at most, and the last
    of the way takes a time constant of ten ticks.
    """

    directory: Path
    lateness_s: dict[int, float]
    lock_s: float
    sense_s: float
    echoes: int
    load_s: float
    bare_load_s: float
    starts: int
    trips: int


def quick(directory: Path) -> Setting:
    """About a minute and a half for everything."""
    return Setting(
        directory,
        lateness_s={10: 6.0, 50: 6.0},
        lock_s=15.0,
        sense_s=8.0,
        echoes=20,
        load_s=10.0,
        bare_load_s=3.0,
        starts=3,
        trips=100,
    )


def thorough(directory: Path) -> Setting:
    """About five minutes for everything."""
    return Setting(
        directory,
        lateness_s={10: 45.0, 50: 25.0},
        lock_s=25.0,
        sense_s=30.0,
        echoes=50,
        load_s=30.0,
        bare_load_s=10.0,
        starts=5,
        trips=300,
    )
