"""How fast the fish swim, beside scikit-opt's artificial fish swarm at the same number of evaluations.

Both search the same box for the least of the same objective (hil/bench/zigzag.py), with as many fish and
tries. scikit-opt gets the objective one fish at a time, as its interface demands: compiled, and
in Python. Ours is run first and counts its evaluations; scikit-opt is stopped from within
its objective after as many. What each run took is divided by that number: processor time, so that what
other programs take meanwhile does not count; with several threads the time on the wall.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable

import numpy as np

from hil.bench.figure import Figure, Finding
from hil.bench.helper import answer_of
from hil.bench.setting import Setting
from hil.bench.turns import Turns, in_turns
from hil.bench.zigzag import (
    HIGH,
    LOW,
    SECONDS,
    Log,
    OneFish,
    careful_one,
    compiled_many,
    compiled_one,
    plain_one,
    zigzag,
)
from hil.lab.swarm import SwarmSettings, minimise
from hil.lab.swarm.records import Floats

FISH, TRIES = 50, 5  # scikit-opt's own number of fish; its own 100 tries would be all prey and no swarm
FASTER_THAN_COMPILED = 15.0
FASTER_THAN_PLAIN = 1000.0
FLAT = 1.02
MICROSECONDS = 1e6
OURS_REPEATED = 5  # of milliseconds each, beside one of seconds
PLAIN_PAIRS = 2
MEMORY_S = 60.0


class _DoneError(Exception):
    """All evaluations are made."""


def settings(evaluations: int, seed: int) -> SwarmSettings:
    """Return how our fish swim: as many as scikit-opt's, and the shoal with all its tries in one call."""
    return SwarmSettings(
        fish=FISH, tries=TRIES, strategy="optimal", iterations=100_000, most_evaluations=evaluations, seed=seed
    )


def ours(log: Log, evaluations: int, seed: int, workers: int) -> tuple[float, int]:
    """Return the seconds per evaluation of our swarm, and how many evaluations it made."""
    clock = clock_of(workers)
    start_s = clock()
    result = minimise(compiled_many(log), LOW, HIGH, settings(evaluations, seed), workers=workers)
    return (clock() - start_s) / result.evaluations, result.evaluations


def clock_of(workers: int) -> Callable[[], float]:
    """Return the clock for a search with so many threads."""
    return time.thread_time if workers == 1 else time.perf_counter


def theirs(one_fish: OneFish, evaluations: int, seed: int, clock: Callable[[], float]) -> float:
    """Return the seconds per evaluation of scikit-opt's swarm, stopped at the number of evaluations."""
    from sko.AFSA import AFSA  # type: ignore[import-untyped]  # noqa: PLC0415 - no dependency of ours

    low, span = np.array(LOW), np.subtract(HIGH, LOW)
    left = evaluations

    def objective(unit: Floats) -> float:
        # Its fish know no bounds. np.clip would take longer.
        nonlocal left
        if left == 0:
            raise _DoneError
        left -= 1
        return one_fish(low + np.minimum(np.maximum(unit, 0.0), 1.0) * span)

    np.random.seed(seed)  # noqa: NPY002 - it draws from there
    start_s = clock()
    try:
        AFSA(objective, n_dim=len(LOW), size_pop=FISH, max_iter=100_000, max_try_num=TRIES).run()
    except _DoneError:
        pass
    return (clock() - start_s) / evaluations


def beside(log: Log, one_fish: OneFish, evaluations: int, workers: int, pairs: int) -> Turns:
    """Let both swim by turns, at the same number of evaluations, which is that of our run before."""
    made = evaluations

    def our_turn(seed: int) -> float:
        nonlocal made
        runs = [ours(log, evaluations, seed, workers) for _ in range(OURS_REPEATED)]
        made = runs[0][1]
        return statistics.median(seconds for seconds, _ in runs)

    return in_turns(our_turn, lambda seed: theirs(one_fish, made, seed, clock_of(workers)), pairs)


def measure(setting: Setting) -> Finding:
    """Compare with scikit-opt where it is installed, and see whether memory grows."""
    workers = len(os.sched_getaffinity(0))
    log = zigzag()
    one = compiled_one(log)
    one(np.array(LOW))
    ours(log, 1000, 0, workers)
    memory = memory_figure(setting.fish_evaluations)
    try:
        theirs(one, 100, 0, time.thread_time)
    except ModuleNotFoundError:
        return Finding("Fish swarm", (memory[0],), (*memory[1], "pip install scikit-opt for the comparison with it"))
    alone = beside(log, one, setting.fish_evaluations, 1, setting.pairs)
    shared = beside(log, one, setting.fish_evaluations, workers, setting.pairs)
    plain = beside(log, plain_one(log), setting.plain_evaluations, 1, PLAIN_PAIRS)
    careful = beside(log, careful_one(log), setting.plain_evaluations, 1, PLAIN_PAIRS)
    notes = (
        f"same compiled objective: {alone.spread_text()}",
        f"with {workers} threads: {shared.spread_text()}",
        f"objective in Python: {plain.spread_text()}",
        f"over lists of Python numbers: {careful.spread_text()}",
        f"K, T, alpha of a zigzag of {SECONDS:g} s at 10 Hz; both {FISH} fish, {TRIES} tries; processor time",
        f"at most {setting.fish_evaluations} evaluations, {setting.plain_evaluations} with Python, counted by ours",
        "scikit-opt is stopped from within its objective after as many",
        *memory[1],
    )
    return Finding("Fish swarm", (*figures_of(alone, shared, plain, careful, workers), memory[0]), notes)


def figures_of(alone: Turns, shared: Turns, plain: Turns, careful: Turns, workers: int) -> tuple[Figure, ...]:
    """Return the figures; the turns are in seconds per evaluation, `bare` is scikit-opt's."""
    return (
        alone.figure("per evaluation, beside scikit-opt's", "us", MICROSECONDS),
        alone.times_faster("faster than scikit-opt, same compiled objective", FASTER_THAN_COMPILED),
        Figure(f"the same with {workers} threads", "times", 1.0 / shared.ratio),
        plain.times_faster("faster than scikit-opt with an objective in Python", FASTER_THAN_PLAIN),
        Figure("the same over lists of Python numbers", "times", 1.0 / careful.ratio),
    )


def memory_figure(evaluations: int) -> tuple[Figure, tuple[str, ...]]:
    """Return the resident memory after ten times the evaluations beside that after as many, of a process of its own."""
    few, many = answer_of(("-m", "hil.bench.long_swim", str(evaluations)), MEMORY_S)
    figure = Figure("memory after ten times the evaluations", "MiB", many, few, most_ratio=FLAT)
    return figure, (f"memory: VmRSS after {evaluations} and after {10 * evaluations} evaluations more",)
