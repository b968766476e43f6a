"""The machine and its processes: scheduling, processor time and memory (proc(5), clock_getcpuclockid(3))."""

from __future__ import annotations

import ctypes
import gc
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROC = Path("/proc")
KIB_PER_MIB = 1024.0
PRIORITY = 40  # that of the autopilot
_PR_SET_TIMERSLACK = 29
_DEFAULT_SLACK = 0
_SHORTEST_SLACK_NS = 1
_SCHEDULED_TIME = 2  # of the clocks of a process: that of all its threads, in nanoseconds


def circumstances() -> dict[str, Any]:
    """Return the machine, its load average now and whether SCHED_FIFO is allowed."""
    with steady() as real_time:
        allowed = real_time
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "sched_fifo": allowed,
        "load_average": os.getloadavg()[0],
    }


def text_of(found: dict[str, Any]) -> str:
    """Return the circumstances in one line."""
    scheduling = "SCHED_FIFO" if found["sched_fifo"] else "SCHED_FIFO not allowed"
    return (
        f"{found['processor']}, {found['cores']} cores, Linux {found['kernel']}, Python {found['python']}, "
        f"{scheduling}, load {found['load_average']:.2f} before the start"
    )


def same_machine(text: str, found: dict[str, Any]) -> bool:
    """Return whether a line of circumstances has the same processor, number of cores and Python as those found."""
    return {found["processor"], f"{found['cores']} cores", f"Python {found['python']}"} <= set(text.split(", "))


def same_python(text: str, found: dict[str, Any]) -> bool:
    """Return whether a line of circumstances has the same Python as those found, except for the patch number."""
    series = found["python"].rpartition(".")[0]
    return any(part.startswith(f"Python {series}.") for part in text.split(", "))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.lower().startswith(("model name", "hardware"))]
    return names[0] if names else platform.machine()


@contextmanager
def steady() -> Iterator[bool]:
    """Run with the autopilot's scheduling: SCHED_FIFO, exact timers, no garbage collector.

    Yields whether SCHED_FIFO was allowed. Child processes start with the ordinary scheduling.
    """
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_TIMERSLACK, _SHORTEST_SLACK_NS, 0, 0, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        real_time = True
    except OSError:
        real_time = False
    gc.collect()
    gc.disable()
    try:
        yield real_time
    finally:
        gc.enable()
        if real_time:
            os.sched_setscheduler(0, policy, parameters)
        libc.prctl(_PR_SET_TIMERSLACK, _DEFAULT_SLACK, 0, 0, 0)


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of a process in MiB: now, and the largest so far."""

    now_mib: float
    most_mib: float


def memory(status: str) -> Memory:
    """Return VmRSS and VmHWM from the text of /proc/PID/status."""
    rows = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    now_kib, most_kib = (int(rows[name].split()[0]) for name in ("VmRSS", "VmHWM"))
    return Memory(now_kib / KIB_PER_MIB, most_kib / KIB_PER_MIB)


def memory_of(pid: int) -> Memory:
    """Return the memory of a process; OSError when it has ended."""
    return memory((PROC / str(pid) / "status").read_text())


def cpu_of(pid: int) -> float:
    """Return the processor time of a process and its threads, in seconds; OSError when it has ended."""
    # The number of the clock as clock_getcpuclockid computes it; /proc/PID/stat has the same in steps of 10 ms.
    return time.clock_gettime(~pid << 3 | _SCHEDULED_TIME)


def parent(stat: str) -> int:
    """Return the parent's process id from the text of /proc/PID/stat."""
    # The second field, the name in brackets, may contain anything.
    return int(stat.rpartition(")")[2].split()[1])


def children_of(pid: int) -> list[int]:
    """Return the ids of the running child processes of a process."""
    processes = []
    for path in PROC.glob("[0-9]*/stat"):
        try:
            if parent(path.read_text()) == pid:
                processes.append(int(path.parent.name))
        except OSError:
            continue  # it has ended meanwhile
    return processes
