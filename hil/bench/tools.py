"""The speed of the tools: the compiled loop, an identification, the fish swarm."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.bench.figure import Figure, Finding, paired_figure
from hil.bench.setting import Setting
from hil.lab.identify.filter import simulate
from hil.lab.identify.identify import identify
from hil.lab.identify.recording import Recording
from hil.lab.numeric_core import LawSettings
from hil.lab.swarm import SwarmSettings, minimise
from hil.lab.swarm.records import Floats
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals

SCENARIO, SEED, GOALS, SECONDS = "sea", 1, "0:0,120:60,720:-30", 1200.0
MIN_TICKS_PER_S = 2e5
NANOSECONDS, MICROSECONDS = 1e9, 1e6
HOUR_S, STEP_S = 3600.0, 0.1
MAX_IDENTIFICATION_S = 5.0
# Bounds of a search for K, T and alpha.
LOW, HIGH = np.array((0.005, 0.5, 0.0)), np.array((0.5, 40.0, 100.0))


def loop(setting: Setting) -> Finding:
    """Measure the processor time of a control tick in the compiled loop of boat and autopilot."""
    parameters, goals = ParameterSet(), parse_goals(GOALS)
    boat, law, task = sailing.boat_of(parameters), LawSettings.of(parameters), sailing.task_of(goals)
    sea = sea_of(parse_scenario(SCENARIO), SEED, SECONDS)
    sailing.sail(boat, law, sea, task, 1.0, ticks=False)  # compiles
    per_tick_ns = []
    for _ in range(setting.pairs):
        start_s = time.thread_time()
        _, ticks = sailing.sail(boat, law, sea, task, SECONDS, ticks=False)
        per_tick_ns.append((time.thread_time() - start_s) / ticks * NANOSECONDS)
    notes = (f"median of {setting.pairs} runs of {SECONDS:g} s in {SCENARIO}, one thread, the waves drawn before",)
    return Finding("Compiled loop", loop_figures(per_tick_ns), notes)


def loop_figures(per_tick_ns: list[float]) -> tuple[Figure, ...]:
    """Return the median time of a tick and its inverse as figures."""
    tick_ns = statistics.median(per_tick_ns)
    return (
        Figure("per control tick", "ns", tick_ns),
        Figure("control ticks per second and core", "1/s", NANOSECONDS / tick_ns, minimum=MIN_TICKS_PER_S),
    )


def hour(setting: Setting) -> Finding:
    """Measure identifications of logs of an hour with different noise; one before them compiles the code."""
    identify([hour_of_zigzag(0)])
    wall_times_s, cpu_times_s, evaluations = [], [], []
    for seed in range(1, setting.pairs + 1):
        log = hour_of_zigzag(seed)
        start_s, cpu_s = time.perf_counter(), time.process_time()
        evaluations.append(identify([log]).fit.evaluations)
        cpu_times_s.append(time.process_time() - cpu_s)
        wall_times_s.append(time.perf_counter() - start_s)
    rows = round(HOUR_S / STEP_S)
    notes = (
        f"{rows} rows at {1.0 / STEP_S:g} Hz, tank noise, zigzag; fit, errors and verdicts",
        f"{len(wall_times_s)} runs of {min(wall_times_s):.2f} to {max(wall_times_s):.2f} s with different noise",
        f"about {statistics.median(evaluations):.0f} runs of the filter each",
    )
    return Finding("Identification of an hour", hour_figures(wall_times_s, cpu_times_s), notes)


def hour_figures(wall_times_s: list[float], cpu_times_s: list[float]) -> tuple[Figure, ...]:
    """Return the medians of wall-clock and processor time as figures."""
    return (
        Figure("from the log to the judged model", "s", statistics.median(wall_times_s), maximum=MAX_IDENTIFICATION_S),
        Figure("processor time of that", "s", statistics.median(cpu_times_s)),
    )


def hour_of_zigzag(seed: int) -> Recording:
    """Return an hour of zigzag at 10 Hz with about the tank's noise."""
    time_s = np.asarray(np.arange(round(HOUR_S / STEP_S)) * STEP_S, np.float64)
    rudder_rad, ones = np.where(time_s % 40.0 < 20.0, 1.0, -1.0) * radians(20.0), np.ones(time_s.size)
    model = np.array(
        [OCEAN_RAMBLER.turning_ability_1_s, OCEAN_RAMBLER.turning_lag_s, OCEAN_RAMBLER.norrbin_s2, 0.0, 1.0]
    )
    output = np.empty((2, time_s.size))
    simulate(model, np.zeros(1), STEP_S * ones, time_s == 0.0, rudder_rad, ones, output)
    noise_rad = radians(0.3) * np.random.default_rng(seed).standard_normal(time_s.size)
    heading_rad = output[0] + radians(1.5) * np.sin(2.5 * time_s) + noise_rad
    return Recording(f"synthetic {seed}", time_s, rudder_rad, heading_rad, None, None)


def swarm(setting: Setting) -> Finding:
    """Measure an evaluation of the fish swarm with a cheap objective, in turns with the objective alone."""
    settings = SwarmSettings(fish=50, tries=5, strategy="optimal", iterations=100_000,
                             max_evaluations=setting.evaluations)  # fmt: skip
    points = LOW + np.random.default_rng(SEED).random((settings.fish * settings.tries, LOW.size)) * (HIGH - LOW)

    def search() -> float:
        start_s = time.thread_time()
        result = minimise(_square, LOW, HIGH, settings)
        return (time.thread_time() - start_s) / result.evaluations

    def objective() -> float:
        return _evaluation_s(_square, points, setting.evaluations)

    search()
    figure = paired_figure("per evaluation", "us", search, objective, setting.pairs, MICROSECONDS)
    notes = (
        f"{settings.fish} fish, {settings.tries} tries, three numbers, up to {setting.evaluations} evaluations",
        "bare: the objective alone, a sum of squares of all tries at once; processor time, in turns",
    )
    return Finding("Fish swarm", (figure,), notes)


def _square(points: Floats) -> Floats:
    return np.asarray(np.square((points - LOW) / (HIGH - LOW) - 0.3).sum(axis=1), np.float64)


def _evaluation_s(objective: Callable[[Floats], Floats], points: Floats, evaluations: int) -> float:
    start_s = time.thread_time()
    for _ in range(evaluations // len(points)):
        objective(points)
    return (time.thread_time() - start_s) / (evaluations // len(points) * len(points))
