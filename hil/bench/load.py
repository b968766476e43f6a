"""Processor time and memory of the autopilot, beside a Python that only sleeps."""

from __future__ import annotations

import time

from hil.bench.figure import Figure, Finding
from hil.bench.helper import background
from hil.bench.process import Memory, cpu_of, memory_of
from hil.bench.sea import Sea
from hil.bench.setting import Setting

WARM_UP_S = 2.0
MOST_CPU_PERCENT = 1.5
MOST_RSS_MIB = 45.0
SLEEPER = """
import time
print("ready", flush=True)
deadline_s = time.monotonic()
while True:
    deadline_s += 0.1
    time.sleep(max(0.0, deadline_s - time.monotonic()))
"""


def measure(setting: Setting) -> Finding:
    """Watch the autopilot in the tank at 10 Hz, with a UDP ground station at the default rates and a radio link."""
    with Sea(setting.directory / "load") as sea:
        sea.listen(WARM_UP_S)
        pid = sea.autopilot()
        start_s, used_s = time.monotonic(), cpu_of(pid)
        sea.listen(setting.load_s)
        share, memory = (cpu_of(pid) - used_s) / (time.monotonic() - start_s), memory_of(pid)
    with background("-c", SLEEPER) as (bare_pid, _):
        start_s, used_s = time.monotonic(), cpu_of(bare_pid)
        time.sleep(setting.bare_load_s)
        bare_share = (cpu_of(bare_pid) - used_s) / (time.monotonic() - start_s)
        bare_memory = memory_of(bare_pid)
    notes = (
        f"over {setting.load_s:g} s with all telemetry on, to UDP and to a serial link; all threads, log included",
        "bare: a Python process that imports nothing and sleeps at 10 Hz",
    )
    return Finding("Load", figures_of(share, memory, bare_share, bare_memory), notes)


def figures_of(share: float, memory: Memory, bare_share: float, bare: Memory) -> tuple[Figure, ...]:
    """Return the figures of a share of one core and of memory, ours and the bare process's."""
    return (
        Figure(
            "CPU at 10 Hz", "% of a core", share * 100.0, bare_share * 100.0,
            most=MOST_CPU_PERCENT, peer="pypilot 1.5 at 20 Hz",
        ),
        Figure("memory (VmRSS)", "MiB", memory.now_mib, bare.now_mib, most=MOST_RSS_MIB, peer="pypilot 209"),
        Figure("memory at most (VmHWM)", "MiB", memory.most_mib, bare.most_mib),
    )  # fmt: skip
