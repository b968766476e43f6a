"""The onboard log of an autopilot that the bench has run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from firmware_py.common.records import Inputs
from firmware_py.log.disk import log_files
from firmware_py.log.reader import read_log

STATE = "state"


def logged(out: Path) -> Iterator[Inputs]:
    """Yield what each tick computed from, in order, from the state in a run's directory; after its end."""
    for _, path in sorted(log_files(out / STATE / "logs").items()):
        yield from (tick.inputs for tick in read_log(path))
