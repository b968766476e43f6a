"""Processor time and memory of the autopilot, beside a Python that only sleeps."""

from __future__ import annotations

import time

from hil.bench.figure import Figure, Finding
from hil.bench.helper import background
from hil.bench.process import Memory, cpu_of, memory_of
from hil.bench.sea import Sea
from hil.bench.setting import Setting

WARM_UP_S = 2.0
MOST_CPU_PERCENT, MOST_CPU_ONE_LINK_PERCENT = 2.0, 1.5
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
    """Watch the autopilot in the tank at 10 Hz, with a radio link, then with a UDP ground station besides."""
    one_link, _ = _sail(setting, "one-link", udp=False)
    share, memory = _sail(setting, "load", udp=True)
    with background("-c", SLEEPER) as (bare_pid, _):
        start_s, used_s = time.monotonic(), cpu_of(bare_pid)
        time.sleep(setting.bare_load_s)
        bare_share = (cpu_of(bare_pid) - used_s) / (time.monotonic() - start_s)
        bare_memory = memory_of(bare_pid)
    notes = (
        f"over {setting.load_s:g} s each, all telemetry on, to UDP and a serial link or to that alone; with the log",
        "bare: a Python process that imports nothing and sleeps at 10 Hz",
    )
    return Finding("Load", figures_of((one_link, share), memory, bare_share, bare_memory), notes)


def _sail(setting: Setting, name: str, *, udp: bool) -> tuple[float, Memory]:
    """Return the share of a core and the memory of the autopilot of a run."""
    with Sea(setting.directory / name, udp=udp) as sea:
        sea.listen(WARM_UP_S)
        pid = sea.autopilot()
        start_s, used_s = time.monotonic(), cpu_of(pid)
        sea.listen(setting.load_s)
        return (cpu_of(pid) - used_s) / (time.monotonic() - start_s), memory_of(pid)


def figures_of(shares: tuple[float, float], memory: Memory, bare_share: float, bare: Memory) -> tuple[Figure, ...]:
    """Return the figures of shares of one core, on one link and on two, and of memory, ours and the bare process's."""
    one_link, share = (share * 100.0 for share in shares)
    return (
        Figure("CPU at 10 Hz", "% of a core", share, bare_share * 100.0, most=MOST_CPU_PERCENT),
        Figure(
            "CPU at 10 Hz, one link", "% of a core", one_link, bare_share * 100.0,
            most=MOST_CPU_ONE_LINK_PERCENT, peer="pypilot 1.5 at 20 Hz",
        ),
        Figure("memory (VmRSS)", "MiB", memory.now_mib, bare.now_mib, most=MOST_RSS_MIB, peer="pypilot 209"),
        Figure("memory at most (VmHWM)", "MiB", memory.most_mib, bare.most_mib),
    )  # fmt: skip
