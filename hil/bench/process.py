"""The autopilot as a process: load and memory, start, and the speed of a run in lockstep."""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time
from pathlib import Path

from hil.bench.background_run import BackgroundRun
from hil.bench.figure import Figure, Finding
from hil.bench.machine import Memory, cpu_of, memory_of
from hil.bench.rig import Rig
from hil.bench.setting import Setting
from hil.bench.station import Station
from hil.errors import HilError
from hil.ship.scenarios import find_scenario
from hil.sim import run_file
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run

WARM_UP_S = 2.0
MAX_CPU_PERCENT, MAX_CPU_ONE_LINK_PERCENT = 2.0, 1.5
MAX_RSS_MIB = 50.0
SLEEPER = """
import time
print("ready", flush=True)
deadline_s = time.monotonic()
while True:
    deadline_s += 0.1
    time.sleep(max(0.0, deadline_s - time.monotonic()))
"""

START_TIMEOUT_S = 20.0
MAX_START_S = 0.5
BARE_START = (sys.executable, "-c", "pass")

REAL_TIME = "x real time"
MIN_SPEED, MIN_SPEED_WITH_STATION = 150.0, 100.0
GOALS = (Goal(0.0, 0.0), Goal(60.0, 60.0))


def load(setting: Setting) -> Finding:
    """Measure processor time and memory in the tank at 10 Hz, with a radio link and then also with UDP."""
    one_link, _ = _load(setting, "one-link", udp=False)
    cpu_share, memory = _load(setting, "load", udp=True)
    with subprocess.Popen([sys.executable, "-c", SLEEPER], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as bare:
        try:
            if bare.stdout is None or not bare.stdout.readline():
                raise HilError("the minimal Python process for comparison does not start")
            start_s, used_s = time.monotonic(), cpu_of(bare.pid)
            time.sleep(setting.bare_load_s)
            bare_share = (cpu_of(bare.pid) - used_s) / (time.monotonic() - start_s)
            bare_memory = memory_of(bare.pid)
        finally:
            bare.kill()
    notes = (
        f"over {setting.load_s:g} s each, with log and all telemetry on UDP and a serial link, or on that alone",
        "bare: a Python process that imports nothing and sleeps at 10 Hz",
    )
    return Finding("Load", load_figures((one_link, cpu_share), memory, bare_share, bare_memory), notes)


def _load(setting: Setting, name: str, *, udp: bool) -> tuple[float, Memory]:
    """Return the share of a core and the memory of the autopilot of a run."""
    with BackgroundRun(setting.directory / name, udp=udp) as background_run:
        background_run.listen(WARM_UP_S)
        pid = background_run.autopilot()
        start_s, used_s = time.monotonic(), cpu_of(pid)
        background_run.listen(setting.load_s)
        return (cpu_of(pid) - used_s) / (time.monotonic() - start_s), memory_of(pid)


def load_figures(shares: tuple[float, float], memory: Memory, bare_share: float, bare: Memory) -> tuple[Figure, ...]:
    """Return the figures of shares of one core, with one link and with two, and of memory."""
    one_link, cpu_share = (cpu_share * 100.0 for cpu_share in shares)
    return (
        Figure("CPU at 10 Hz", "% of a core", cpu_share, bare_share * 100.0, maximum=MAX_CPU_PERCENT),
        Figure(
            "CPU at 10 Hz, one link", "% of a core", one_link, bare_share * 100.0,
            maximum=MAX_CPU_ONE_LINK_PERCENT, peer="pypilot 1.5 at 20 Hz",
        ),
        Figure("memory (VmRSS)", "MiB", memory.now_mib, bare.now_mib, maximum=MAX_RSS_MIB, peer="pypilot 209"),
        Figure("memory at most (VmHWM)", "MiB", memory.max_mib, bare.max_mib),
    )  # fmt: skip


def start(setting: Setting) -> Finding:
    """Measure several starts of the autopilot, in turns with those of an empty Python program."""
    frames_s, heartbeats_s, bare_s = [], [], []
    for index in range(setting.starts):
        with Rig(setting.directory / f"start-{index}") as rig:
            frame_s, heartbeat_s = rig.serve_until_alive(START_TIMEOUT_S)
        frames_s.append(frame_s)
        heartbeats_s.append(heartbeat_s)
        begin_s = time.monotonic()
        subprocess.run(BARE_START, check=True)
        bare_s.append(time.monotonic() - begin_s)
    notes = (
        f"median of {setting.starts} starts, from just before fork and exec",
        "the servo is found and configured before its first goal, at 57600 baud",
        "bare: python -c pass, from start to end",
    )
    return Finding("Start", start_figures(frames_s, heartbeats_s, bare_s), notes)


def start_figures(frames_s: list[float], heartbeats_s: list[float], bare_s: list[float]) -> tuple[Figure, ...]:
    """Return the medians as figures."""
    bare = statistics.median(bare_s)
    return (
        Figure("first rudder frame", "s", statistics.median(frames_s), bare, maximum=MAX_START_S),
        Figure("first heartbeat on UDP", "s", statistics.median(heartbeats_s), bare, peer="ArduRover 1.0"),
    )


def lockstep(setting: Setting) -> Finding:
    """Measure runs in the tank at 10 Hz in lockstep, in turns without and with a UDP ground station."""
    alone: list[float] = []
    with_station: list[float] = []
    for index in range(setting.starts):
        alone.append(_speed(setting, setting.directory / f"alone-{index}"))
        station = Station()
        try:
            with_station.append(_speed(setting, setting.directory / f"station-{index}", station.url))
        finally:
            station.close()
    notes = (
        f"median of {setting.starts} runs of {setting.lockstep_s:g} s, without the start",
        "each process on a core of its own where two are free, otherwise both on one",
        "without telemetry only the simulated operator is connected, on a serial link",
    )
    return Finding("Lockstep", lockstep_figures(alone, with_station), notes)


def _speed(setting: Setting, out: Path, *links: str) -> float:
    run(RunOptions(find_scenario("tank"), setting.lockstep_s, out, math.inf, 1, GOALS, links=links, cores=2))
    wall_s = run_file.read(out).wall_s
    return setting.lockstep_s / wall_s if wall_s else math.nan


def lockstep_figures(alone: list[float], with_station: list[float]) -> tuple[Figure, ...]:
    """Return the medians of speeds as figures."""
    return (
        Figure("telemetry off", REAL_TIME, statistics.median(alone), minimum=MIN_SPEED),
        Figure("telemetry on", REAL_TIME, statistics.median(with_station), minimum=MIN_SPEED_WITH_STATION),
    )
