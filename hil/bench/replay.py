"""What a log's tick takes to read and recompute, beside calls of a Python function."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from firmware_py.log.disk import log_files
from hil.bench.figure import Figure, Finding
from hil.bench.onboard import STATE, logged
from hil.bench.setting import Setting
from hil.bench.turns import Turns, in_turns
from hil.errors import HilError
from hil.ship.scenarios import named
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run

SEA, SECONDS = "sea", 300.0
CALLS, THOUSANDS = "one = 0.0\nfor _ in range(5_000_000): one = abs(one)", 5_000
MICROSECONDS = 1e6


def measure(setting: Setting) -> Finding:
    """Sail some minutes in lockstep; then replay the log and make calls, by turns, each in a process of its own."""
    out = setting.directory / "replay"
    run(RunOptions(named(SEA), SECONDS, out, math.inf, 1, (Goal(0.0, 0.0),)))
    ticks = sum(1 for _ in logged(out))
    (log,) = log_files(out / STATE / "logs").values()
    recompute = ("-m", "firmware_py", "replay", str(log))
    turns = in_turns(
        lambda _: processor_s(recompute, setting.directory) / ticks,
        lambda _: processor_s(("-c", CALLS), setting.directory) / THOUSANDS,
        setting.pairs,
    )
    notes = (
        f"rambler replay of {ticks} ticks of {SEA}, its start and the reading of the log among them; processor time",
        "bare: a thousand calls of abs in Python, by turns",
    )
    return Finding("Replay", (figure_of(turns),), notes)


def figure_of(turns: Turns) -> Figure:
    """Return the figure; the turns are in seconds per tick and per thousand calls."""
    return turns.figure("a tick recomputed", "us", MICROSECONDS)


def processor_s(arguments: Sequence[str], directory: Path) -> float:
    """Run Python with arguments in a directory; return its seconds of processor, or raise HilError when it fails."""
    process = subprocess.Popen([sys.executable, *arguments], cwd=directory, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise HilError(f"python {' '.join(arguments[:3])} ended with {process.returncode}")
    return used.ru_utime + used.ru_stime
