"""How steadily the control loop ran, from the autopilot's own log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import read_log

MICROSECONDS = 1e6
PERCENTILES = (("p50", 50.0), ("p99", 99.0), ("p99.9", 99.9), ("max", 100.0))


@dataclass(frozen=True, slots=True)
class LoopHealth:
    """Ticks run, deadlines skipped, and how late ticks began; lateness_us is None where it means nothing."""

    ticks: int
    skipped: int
    lateness_us: dict[str, float] | None
    note: str = ""


def loop_health(late_s: Sequence[float], skipped: Sequence[int], *, lockstep: bool) -> LoopHealth:
    """Sum up the ticks of a run."""
    if lockstep:
        return LoopHealth(len(late_s), sum(skipped), None, "in lockstep time stands still while the autopilot computes")
    if not late_s:
        return LoopHealth(0, 0, None, "no ticks in the onboard log")
    late_us = np.asarray(late_s) * MICROSECONDS
    figures = {name: round(float(np.percentile(late_us, part)), 1) for name, part in PERCENTILES}
    return LoopHealth(len(late_s), sum(skipped), figures)


def from_logs(directory: Path, *, lockstep: bool) -> LoopHealth | None:
    """Read every onboard log of a run; None when there is none."""
    paths = sorted(directory.glob("*.BIN"))
    if not paths:
        return None
    try:
        ticks = [logged.inputs.tick for path in paths for logged in read_log(path)]
    except LogError as error:
        return LoopHealth(0, 0, None, f"the onboard log cannot be read: {error}")
    return loop_health([tick.late_s for tick in ticks], [tick.skipped for tick in ticks], lockstep=lockstep)
