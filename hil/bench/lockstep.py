"""How many times real time the whole autopilot sails in lockstep."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

from hil.bench.figure import Figure, Finding
from hil.bench.setting import Setting
from hil.bench.station import Station
from hil.ship.scenarios import named
from hil.sim import run_file
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run

UNIT = "x real time"
LEAST, LEAST_HEARD = 150.0, 100.0
GOALS = (Goal(0.0, 0.0), Goal(60.0, math.radians(60.0)))


def measure(setting: Setting) -> Finding:
    """Sail the tank at 10 Hz in turns, alone and with a UDP ground station that is told all."""
    alone: list[float] = []
    heard: list[float] = []
    for index in range(setting.starts):
        alone.append(_speed(setting, setting.directory / f"alone-{index}"))
        station = Station()
        try:
            heard.append(_speed(setting, setting.directory / f"heard-{index}", station.url))
        finally:
            station.close()
    notes = (
        f"median of {setting.starts} runs of {setting.lockstep_s:g} s, the start left out",
        "each process on a core of its own where two are free, else both on one",
        "without telemetry the run's own operator is still there, on a serial link",
    )
    return Finding("Lockstep", figures_of(alone, heard), notes)


def _speed(setting: Setting, out: Path, *links: str) -> float:
    run(RunOptions(named("tank"), setting.lockstep_s, out, math.inf, 1, GOALS, links=links, cores=2))
    wall_s = run_file.read(out).wall_s
    return setting.lockstep_s / wall_s if wall_s else math.nan


def figures_of(alone: list[float], heard: list[float]) -> tuple[Figure, ...]:
    """Return the medians of speeds as figures."""
    return (
        Figure("telemetry off", UNIT, statistics.median(alone), least=LEAST),
        Figure("telemetry on", UNIT, statistics.median(heard), least=LEAST_HEARD),
    )
