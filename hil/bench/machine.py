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
_MIN_SLACK_NS = 1
_CPU_CLOCK = 2  # of the clocks of a process: that of all its threads, in nanoseconds


def circumstances() -> dict[str, Any]:
    """Return the machine, its load average and whether SCHED_FIFO is allowed."""
    with autopilot_scheduling() as has_real_time:
        is_real_time = has_real_time
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "sched_fifo": is_real_time,
        "load_average": os.getloadavg()[0],
    }


def text_of(machine: dict[str, Any]) -> str:
    """Return the circumstances in one line."""
    scheduling = "SCHED_FIFO" if machine["sched_fifo"] else "SCHED_FIFO not allowed"
    return (
        f"{machine['processor']}, {machine['cores']} cores, Linux {machine['kernel']}, Python {machine['python']}, "
        f"{scheduling}, load {machine['load_average']:.2f} before the start"
    )


def same_machine(text: str, machine: dict[str, Any]) -> bool:
    """Return whether a line of circumstances has the processor, number of cores and Python of this machine."""
    return {machine["processor"], f"{machine['cores']} cores", f"Python {machine['python']}"} <= set(text.split(", "))


def same_python(text: str, machine: dict[str, Any]) -> bool:
    """Return whether a line of circumstances has the Python of this machine, except for the patch number."""
    series = machine["python"].rpartition(".")[0]
    return any(part.startswith(f"Python {series}.") for part in text.split(", "))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.lower().startswith(("model name", "hardware"))]
    return names[0] if names else platform.machine()


@contextmanager
def autopilot_scheduling() -> Iterator[bool]:
    """Run with the scheduling of the autopilot: SCHED_FIFO, exact timers, no garbage collector.

    Yields whether SCHED_FIFO was allowed. Child processes start with the ordinary scheduling.
    """
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_TIMERSLACK, _MIN_SLACK_NS, 0, 0, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        has_real_time = True
    except OSError:
        has_real_time = False
    gc.collect()
    gc.disable()
    try:
        yield has_real_time
    finally:
        gc.enable()
        if has_real_time:
            os.sched_setscheduler(0, policy, parameters)
        libc.prctl(_PR_SET_TIMERSLACK, _DEFAULT_SLACK, 0, 0, 0)


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of a process in MiB: now, and the maximum so far."""

    now_mib: float
    max_mib: float


def memory(status: str) -> Memory:
    """Return VmRSS and VmHWM from the text of /proc/PID/status."""
    rows = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    now_kib, max_kib = (int(rows[name].split()[0]) for name in ("VmRSS", "VmHWM"))
    return Memory(now_kib / KIB_PER_MIB, max_kib / KIB_PER_MIB)


def memory_of(pid: int) -> Memory:
    """Return the memory of a process; raise OSError if it has ended."""
    return memory((PROC / str(pid) / "status").read_text())


def cpu_of(pid: int) -> float:
    """Return the processor time of a process and its threads, in seconds; raise OSError if it has ended."""
    # Clock number as computed by clock_getcpuclockid; /proc/PID/stat has only a resolution of 10 ms.
    return time.clock_gettime(~pid << 3 | _CPU_CLOCK)


def parent(stat: str) -> int:
    """Return the process id of the parent from the text of /proc/PID/stat."""
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
            continue  # the process has ended
    return processes
