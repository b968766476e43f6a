"""On what, and under what load, the bench was run."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

from hil.bench.steady import steady


def circumstances() -> dict[str, Any]:
    """Return the machine, its load at the start and whether SCHED_FIFO is allowed."""
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
    """Return whether circumstances in one line are of the processor, the cores and the Python found here."""
    return {found["processor"], f"{found['cores']} cores", f"Python {found['python']}"} <= set(text.split(", "))


def same_python(text: str, found: dict[str, Any]) -> bool:
    """Return whether circumstances in one line are of the Python found here, but for its last number."""
    series = found["python"].rpartition(".")[0]
    return any(part.startswith(f"Python {series}.") for part in text.split(", "))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.lower().startswith(("model name", "hardware"))]
    return names[0] if names else platform.machine()
