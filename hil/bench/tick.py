"""The cost of a tick: processor time in the replay of a log, and Python instructions of the step."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeVar

from firmware_py.common.records import Inputs
from firmware_py.log.disk import log_files
from firmware_py.log.reader import read_log
from hil.bench.figure import Figure, Finding, paired_figure
from hil.bench.setting import Setting
from hil.errors import HilError
from hil.report.figure_file import COUNTED
from hil.ship.scenarios import find_scenario
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run

STATE = "state"
SEA = "sea"
REPLAY_S, WORK_S = 300.0, 60.0
MICROSECONDS = 1e6
# A program for comparison, and its number of calls in thousands.
CALLS, THOUSANDS = "one = 0.0\nfor _ in range(5_000_000): one = abs(one)", 5_000
WARM_UP_TICKS, TICKS_PER_COUNT = 100, 7  # the first ticks fill caches; then every seventh tick is counted
Result = TypeVar("Result")

# Program for a separate process, which has empty caches.
RECOUNT: Final = """
import sys
from pathlib import Path
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.log.replay import replay_log
from hil.bench.tick import counting
counts = []
replay_log(Path(sys.argv[1]), state_from_text, counting(step, counts))
print(len(counts), sum(counts))
"""


def logged_inputs(out: Path) -> Iterator[Inputs]:
    """Yield the inputs of each tick, in order, from the onboard log of a run's directory."""
    for _, path in sorted(log_files(out / STATE / "logs").items()):
        yield from (tick.inputs for tick in read_log(path))


def record_log(out: Path, seconds: float) -> Path:
    """Run the autopilot in lockstep and return the path of its log."""
    run(RunOptions(find_scenario(SEA), seconds, out, math.inf, 1, (Goal(0.0, 0.0),)))
    (log,) = log_files(out / STATE / "logs").values()
    return log


def replay(setting: Setting) -> Finding:
    """Measure the processor time of a tick in `rambler replay`, in turns with calls of a Python function."""
    out = setting.directory / "replay"
    log = record_log(out, REPLAY_S)
    ticks = sum(1 for _ in logged_inputs(out))
    recompute = ("-m", "firmware_py", "replay", str(log))
    figure = paired_figure(
        "a tick recomputed",
        "us",
        lambda: processor_s(recompute, setting.directory) / ticks,
        lambda: processor_s(("-c", CALLS), setting.directory) / THOUSANDS,
        setting.pairs,
        MICROSECONDS,
    )
    notes = (
        f"processor time of rambler replay for {ticks} ticks of {SEA}, start-up and reading of the log included",
        "bare: a thousand calls of abs in Python, in turns",
    )
    return Finding("Replay", (figure,), notes)


def processor_s(arguments: Sequence[str], directory: Path) -> float:
    """Run Python with arguments in a directory; return its processor time in seconds, or raise HilError."""
    process = subprocess.Popen([sys.executable, *arguments], cwd=directory, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise HilError(f"python {' '.join(arguments[:3])} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime


def work(setting: Setting) -> Finding:
    """Count the Python instructions of the step over the log of a run."""
    log = record_log(setting.directory / "work", WORK_S)
    process = subprocess.run([sys.executable, "-c", RECOUNT, str(log)], capture_output=True, text=True, check=False)
    if process.returncode != 0:
        raise HilError(f"the log of the run cannot be recomputed: {' '.join(process.stderr.split())[-200:]}")
    ticks, count = map(int, process.stdout.split())
    bare, _ = instructions(_thousand_calls)
    notes = (
        f"Python instructions in the step, counted in {ticks} ticks of {SEA}; a call of numpy counts as one",
        "bare: a thousand calls of abs in Python",
    )
    return Finding("Work", (Figure("a tick", COUNTED, count / ticks, float(bare)),), notes)


def counting(step: Callable[[Any, Any], Result], counts: list[int]) -> Callable[[Any, Any], Result]:
    """Return a step with the same results that appends the instructions of some of its ticks to `counts`."""
    ticks = 0

    def counted_step(state: Any, inputs: Any) -> Result:
        nonlocal ticks
        ticks += 1
        if ticks <= WARM_UP_TICKS or ticks % TICKS_PER_COUNT:
            return step(state, inputs)
        count, result = instructions(lambda: step(state, inputs))
        counts.append(count)
        return result

    return counted_step


def instructions(function: Callable[[], Result]) -> tuple[int, Result]:
    """Return the number of instructions that Python executes in a call, and the result of the call."""
    count = 0

    def trace(frame: FrameType, event: str, _argument: object) -> Callable[..., Any]:
        nonlocal count
        if event == "call":
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    previous = sys.gettrace()
    sys.settrace(trace)
    try:
        result = function()
    finally:
        sys.settrace(previous)
    return count, result


def _thousand_calls() -> None:
    value = 0.0
    for _ in range(1000):
        value = abs(value)
