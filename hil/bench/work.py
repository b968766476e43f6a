"""How much Python a tick executes: counted, so that neither a busy hour nor another machine changes it."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, Final, TypeVar

from firmware_py.log.disk import log_files
from hil.bench.figure import Figure, Finding
from hil.bench.onboard import STATE
from hil.bench.setting import Setting
from hil.errors import HilError
from hil.report.figure_file import COUNTED
from hil.ship.scenarios import named
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run

SEA, SECONDS = "sea", 60.0
WARM, EACH = 100, 7  # the first ticks compute what is kept; of the others one in so many is counted
CALLS: Final = 1000
Result = TypeVar("Result")

# In a process of its own, where nothing is kept yet of what was computed before.
RECOUNT = """
import sys
from pathlib import Path
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.log.replay import replay_log
from hil.bench.work import counting
counts = []
replay_log(Path(sys.argv[1]), state_from_text, counting(step, counts))
print(len(counts), sum(counts))
"""


def measure(setting: Setting) -> Finding:
    """Sail a minute in lockstep; recompute its log and count what Python executes."""
    out = setting.directory / "work"
    run(RunOptions(named(SEA), SECONDS, out, math.inf, 1, (Goal(0.0, 0.0),)))
    (log,) = log_files(out / STATE / "logs").values()
    done = subprocess.run([sys.executable, "-c", RECOUNT, str(log)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise HilError(f"the log of the run cannot be recomputed: {' '.join(done.stderr.split())[-200:]}")
    ticks, count = map(int, done.stdout.split())
    bare, _ = instructions(_calls)
    notes = (
        f"Python's instructions in the step of {ticks} ticks of {SEA}, counted; all that numpy does in one is one",
        "bare: a thousand calls of abs in Python",
    )
    return Finding("Work", (Figure("a tick", COUNTED, count / ticks, float(bare)),), notes)


def counting(step: Callable[[Any, Any], Result], counts: list[int]) -> Callable[[Any, Any], Result]:
    """Return a step that does the same and notes how many instructions some of its ticks took."""
    ticks = 0

    def counted(state: Any, inputs: Any) -> Result:
        nonlocal ticks
        ticks += 1
        if ticks <= WARM or ticks % EACH:
            return step(state, inputs)
        count, result = instructions(lambda: step(state, inputs))
        counts.append(count)
        return result

    return counted


def instructions(work: Callable[[], Result]) -> tuple[int, Result]:
    """Return how many instructions Python executes in a call, and what the call returns."""
    count = 0

    def trace(frame: FrameType, event: str, _argument: object) -> Callable[..., Any]:
        nonlocal count
        if event == "call":
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        result = work()
    finally:
        sys.settrace(before)
    return count, result


def _calls() -> None:
    one = 0.0
    for _ in range(CALLS):
        one = abs(one)
