"""How fast the compiled twin sails, beside the bare arithmetic of its covariances, and by how many cores it is shared.

The limit is what a tick cannot do without: the covariance of the estimate, carried on once and corrected once. A tick
more is the ship in her sea, the devices, the transcendental functions of estimate and helm, and who steers by what.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

from firmware_py.common.parameters import ParameterSet
from hil.bench.figure import Figure, Finding
from hil.bench.setting import Setting
from hil.bench.turns import Turns, in_turns
from hil.lab.compiled import compiled
from hil.lab.lane_rows import aligned
from hil.lab.lanes import COUNT
from hil.lab.twin import kalman, sailing
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import sea_of as scenario_of
from hil.sim.goals import parse_goals

SCENARIO, SEED, GOALS, SECONDS = "sea", 1, "0:0,120:60,720:-30", 1200.0
TICKS_PER_SECOND = 5e6  # asked for, of a core
LEAST_EFFICIENCY = 0.9
NANOSECONDS = 1e9
BARE_TICKS = 100_000
RUNS_BY_THREADS = 4


@compiled
def _carry(c: kalman.Covariances, ticks: int) -> None:
    for _ in range(ticks):
        kalman.predict(c)
        kalman.show_heading(c)
        kalman.correct(c)
        kalman.add_up(c)


def bare(_number: int) -> float:
    """Return the seconds that the arithmetic of the covariances takes in a tick of a boat."""
    beside = aligned(kalman.COVARIANCES, 1)
    for name in ("p", "variance", "on", "innovation"):
        beside[name] = 1.0
    start_s = time.thread_time()
    _carry(beside[0], BARE_TICKS // COUNT)
    return (time.thread_time() - start_s) / BARE_TICKS


def runs() -> list[sailing.Run]:
    """Draw a batch of runs."""
    told, goals = ParameterSet(), parse_goals(GOALS)
    boat, law, task = sailing.boat_of(told), sailing.law_of(told), sailing.task_of(goals)
    scenario = scenario_of(SCENARIO)
    return [sailing.Run(boat, law, sea_of(scenario, SEED + number, SECONDS), task) for number in range(COUNT)]


def sailed(batch: list[sailing.Run], _number: int) -> float:
    """Return the seconds of processor time that a tick of a batch takes."""
    start_s = time.thread_time()
    _, ticks = sailing.sail_beside(batch, SECONDS, ticks=False)
    return (time.thread_time() - start_s) / float(ticks.sum())


def whole(_number: int) -> float:
    """Return the seconds that a tick takes when the seas are drawn as well."""
    start_s = time.thread_time()
    _, ticks = sailing.sail_beside(runs(), SECONDS, ticks=False)
    return (time.thread_time() - start_s) / float(ticks.sum())


def shared(batch: list[sailing.Run], pairs: int) -> Turns:
    """Let one thread sail, and as many as there are cores by turns; seconds on the wall for a run of each."""

    def by(threads: int) -> float:
        start_s = time.perf_counter()
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda number: sailed(batch, number), range(threads * RUNS_BY_THREADS)))
        return time.perf_counter() - start_s

    return in_turns(lambda _: by(1), lambda _: by(len(os.sched_getaffinity(0))), pairs)


def measure(setting: Setting) -> Finding:
    """Measure a batch of runs of 1200 s in a sea."""
    batch = runs()
    bare(0)
    sailed(batch, 0)
    alone = in_turns(lambda number: sailed(batch, number), bare, setting.pairs)
    drawn = in_turns(whole, bare, setting.pairs)
    cores = shared(batch, setting.pairs)
    return Finding("Compiled twin", figures_of(alone, drawn, cores), notes(alone))


def figures_of(alone: Turns, drawn: Turns, cores: Turns) -> tuple[Figure, ...]:
    """Return the figures; of `cores` it is one thread by all of them, each with as much to do."""
    tick = alone.figure("per control tick", "ns", NANOSECONDS)
    return (
        tick,
        Figure("control ticks per second and core", "1/s", NANOSECONDS / tick.value, least=TICKS_PER_SECOND),
        drawn.figure("per control tick, with its share of drawing the sea", "ns", NANOSECONDS),
        cores_figure(cores),
    )


def cores_figure(cores: Turns) -> Figure:
    """Return how much of a core is left of each when all of them sail."""
    return Figure("left of a core when all sail", "times", cores.ratio, least=LEAST_EFFICIENCY)


def notes(alone: Turns) -> tuple[str, ...]:
    """Say how it was measured."""
    low, high = alone.quartiles
    return (
        f"{COUNT} runs of {SECONDS:g} s in {SCENARIO} side by side in one thread, processor time",
        f"the limit: the covariance carried on and corrected once; {low:.3g} to {high:.3g} times that, middle half",
        f"one thread beside {len(os.sched_getaffinity(0))} that have as much to do each, time on the wall",
    )
