"""How steadily the control loop ran, from the autopilot's own log."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_py.common.records import Tick
from firmware_py.log.dataflash import LogError
from firmware_py.log.disk import log_files
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


def loop_health(ticks: Iterable[Tick], *, lockstep: bool) -> LoopHealth:
    """Sum up the ticks of a run; 8 bytes are kept of each where lateness is measured."""
    count = skipped = 0
    late_s = array("d")
    for tick in ticks:
        count += 1
        skipped += tick.skipped
        if not lockstep:
            late_s.append(tick.late_s)
    if lockstep:
        return LoopHealth(count, skipped, None, "in lockstep time stands still while the autopilot computes")
    if not count:
        return LoopHealth(0, 0, None, "no ticks in the onboard log")
    late_us = np.asarray(late_s) * MICROSECONDS
    figures = {name: round(float(np.percentile(late_us, part)), 1) for name, part in PERCENTILES}
    return LoopHealth(count, skipped, figures)


def from_logs(directory: Path, *, lockstep: bool) -> LoopHealth | None:
    """Read every onboard log of a run; None when there is none."""
    paths = [path for _, path in sorted(log_files(directory).items())] if directory.is_dir() else []
    if not paths:
        return None
    try:
        return loop_health((logged.inputs.tick for path in paths for logged in read_log(path)), lockstep=lockstep)
    except LogError as error:
        return LoopHealth(0, 0, None, f"the onboard log cannot be read: {error}")
