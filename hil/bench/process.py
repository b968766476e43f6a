"""A process looked at from outside (see proc(5) and clock_getcpuclockid(3))."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
KIB_PER_MIB = 1024.0
_SCHEDULED_TIME = 2  # of the clocks of a process: all its threads, in nanoseconds


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of a process, now and at most so far, in MiB."""

    now_mib: float
    most_mib: float


def parent(stat: str) -> int:
    """Return the parent's number from the text of /proc/PID/stat."""
    # The name in brackets, which may hold anything, is the second field.
    return int(stat.rpartition(")")[2].split()[1])


def memory(status: str) -> Memory:
    """Return VmRSS and VmHWM from the text of /proc/PID/status."""
    rows = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    now_kib, most_kib = (int(rows[name].split()[0]) for name in ("VmRSS", "VmHWM"))
    return Memory(now_kib / KIB_PER_MIB, most_kib / KIB_PER_MIB)


def cpu_of(pid: int) -> float:
    """Return the processor time of a process and its threads, in seconds; OSError when it has gone."""
    # The number of the clock, as clock_getcpuclockid makes it; /proc/PID/stat has the same in steps of 10 ms.
    return time.clock_gettime(~pid << 3 | _SCHEDULED_TIME)


def memory_of(pid: int) -> Memory:
    """Return the memory of a process; OSError when it has gone."""
    return memory((PROC / str(pid) / "status").read_text())


def children_of(pid: int) -> list[int]:
    """Return the numbers of the processes that a process has started and that still are."""
    processes = []
    for path in PROC.glob("[0-9]*/stat"):
        try:
            if parent(path.read_text()) == pid:
                processes.append(int(path.parent.name))
        except OSError:
            continue  # it has ended meanwhile
    return processes
