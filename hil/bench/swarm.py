"""How fast the fish swim, beside scikit-opt's artificial fish swarm at the same number of evaluations.

The objective is the paper's: the squared error of the yaw rate that the K-T equation predicts from a
zigzag of two minutes at 10 Hz. scikit-opt gets it twice: compiled, one fish at a time, as its
interface demands; and as a user would write it in Python. scikit-opt is no dependency of ours:
`pip install scikit-opt` for this measurement.

The compiled objective counts time in turning lags, T dr/dt = dr/d(t/T): the equation is then that
of a ship with T = 1 and the step h / T, and its four divisions a step are gone.
"""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable

import numpy as np

from firmware_py.model.kt import rk4_step
from hil.bench.figure import Figure, Finding
from hil.bench.setting import Setting
from hil.compiled import compiled
from hil.errors import UsageError
from hil.swarm import CompiledObjective, SwarmSettings, minimise
from hil.swarm.records import Floats

STEP_S = 0.1
SECONDS = 120.0
LEG_S = 20.0
TRUTH = (0.049, 4.0, 17.0)
LOW, HIGH = (0.005, 0.5, 0.0), (0.5, 40.0, 100.0)
COMPILED_EVALUATIONS = 20_000
PLAIN_EVALUATIONS = 400
REPEATS = 5
FASTER_THAN_COMPILED = 15.0
FASTER_THAN_PLAIN = 1000.0

OneFish = Callable[[Floats], float]


class _DoneError(Exception):
    """All evaluations are made."""


@compiled
def error_of_one(point: np.ndarray, rudder_rad: np.ndarray, yaw_rate_rad_s: np.ndarray, step_s: float) -> float:
    """Return the squared yaw rate error of one candidate (K, T, alpha)."""
    rate = total = 0.0
    step = step_s / point[1]
    for n in range(rudder_rad.size):
        total += (rate - yaw_rate_rad_s[n]) ** 2
        _, rate = rk4_step(0.0, rate, rudder_rad[n], step, point[0], 1.0, point[2], 0.0)
    return total


@compiled
def error_of_many(
    points: np.ndarray, values: np.ndarray, rudder_rad: np.ndarray, yaw_rate_rad_s: np.ndarray, step_s: float
) -> None:
    """Fill the squared yaw rate errors of all candidates; the inner loop becomes SIMD."""
    count = points.shape[0]
    ability, step, norrbin = points[:, 0].copy(), step_s / points[:, 1], points[:, 2].copy()
    rate, total = np.zeros(count), np.zeros(count)
    for n in range(rudder_rad.size):
        rudder, measured = rudder_rad[n], yaw_rate_rad_s[n]
        for f in range(count):
            total[f] += (rate[f] - measured) ** 2
            _, rate[f] = rk4_step(0.0, rate[f], rudder, step[f], ability[f], 1.0, norrbin[f], 0.0)
    for f in range(count):
        values[f] = total[f]


def zigzag(seconds: float) -> tuple[Floats, Floats]:
    """Return the rudder and the noisy yaw rate of a zigzag of 20 degrees."""
    samples = round(seconds / STEP_S)
    legs = np.arange(samples) // round(LEG_S / STEP_S)
    rudder_rad = np.where(legs % 2 == 0, 1.0, -1.0) * math.radians(20.0)
    rates, state = [], (0.0, 0.0)
    for rudder in rudder_rad:
        rates.append(state[1])
        state = rk4_step(*state, float(rudder), STEP_S, *TRUTH, 0.0)
    return rudder_rad, np.array(rates) + np.random.default_rng(1).normal(0.0, 1e-3, samples)


def compiled_one(rudder_rad: Floats, yaw_rate_rad_s: Floats) -> OneFish:
    """Return the compiled objective of one fish: the one-fish form, which is faster than many with one."""
    return lambda point: error_of_one(point, rudder_rad, yaw_rate_rad_s, STEP_S)


def plain_one(rudder_rad: Floats, yaw_rate_rad_s: Floats) -> OneFish:
    """Return the objective in Python."""

    def error(point: Floats) -> float:
        ability, lag, norrbin = point
        heading = rate = total = 0.0
        for rudder, measured in zip(rudder_rad, yaw_rate_rad_s, strict=True):
            total += (rate - measured) ** 2
            heading, rate = rk4_step(heading, rate, rudder, STEP_S, ability, lag, norrbin, 0.0)
        return total

    return error


def ours_s(rudder_rad: Floats, yaw_rate_rad_s: Floats, evaluations: int, seed: int, workers: int) -> float:
    """Return the seconds per evaluation of our swarm."""
    objective = CompiledObjective(error_of_many, (rudder_rad, yaw_rate_rad_s, STEP_S), batch=True)
    settings = SwarmSettings(iterations=100_000, most_evaluations=evaluations, seed=seed)
    start_s = time.perf_counter()
    result = minimise(objective, LOW, HIGH, settings, workers=workers)
    return (time.perf_counter() - start_s) / result.evaluations


def theirs_s(one_fish: OneFish, evaluations: int, seed: int) -> float:
    """Return the seconds per evaluation of scikit-opt's swarm, stopped at the number of evaluations."""
    try:
        from sko.AFSA import AFSA  # type: ignore[import-untyped]  # noqa: PLC0415 - no dependency of ours
    except ModuleNotFoundError:
        raise UsageError("scikit-opt is not installed; pip install scikit-opt for this measurement") from None
    low, span = np.array(LOW), np.subtract(HIGH, LOW)
    left = evaluations

    def objective(unit: Floats) -> float:
        # Its fish know no bounds.
        nonlocal left
        if left == 0:
            raise _DoneError
        left -= 1
        return one_fish(low + np.clip(unit, 0.0, 1.0) * span)

    np.random.seed(seed)  # noqa: NPY002 - it draws from there
    start_s = time.perf_counter()
    try:
        AFSA(objective, n_dim=3, size_pop=30, max_iter=100_000, max_try_num=5).run()
    except _DoneError:
        pass
    return (time.perf_counter() - start_s) / evaluations


def measure(setting: Setting) -> Finding:
    """Let both swim in turns, and compare the medians."""
    del setting
    workers = len(os.sched_getaffinity(0))
    log = zigzag(SECONDS)
    ours_s(*log, 1000, 0, workers)
    ours_s(*log, 1000, 0, 1)
    one = compiled_one(*log)
    one(np.array(TRUTH))
    alone, shared, theirs, ours_few = [], [], [], []
    for seed in range(REPEATS):
        alone.append(ours_s(*log, COMPILED_EVALUATIONS, seed, 1))
        theirs.append(theirs_s(one, COMPILED_EVALUATIONS, seed))
        shared.append(ours_s(*log, COMPILED_EVALUATIONS, seed, workers))
        ours_few.append(ours_s(*log, PLAIN_EVALUATIONS, seed, 1))
    plain = [theirs_s(plain_one(*log), PLAIN_EVALUATIONS, seed) for seed in range(2)]
    median = statistics.median
    figures = (
        Figure(
            "fish per evaluation, by scikit-opt with the same compiled objective",
            "us",
            1e6 * median(shared),
            1e6 * median(theirs),
            most_ratio=1.0 / FASTER_THAN_COMPILED,
        ),
        Figure("the same on one core", "us", 1e6 * median(alone), 1e6 * median(theirs)),
        Figure(
            "fish per evaluation, by scikit-opt with an objective in Python",
            "us",
            1e6 * median(ours_few),
            1e6 * median(plain),
            most_ratio=1.0 / FASTER_THAN_PLAIN,
        ),
    )
    faster = median(theirs) / median(shared), median(plain) / median(ours_few)
    return Finding("Fish swarm", figures, notes(workers, *faster))


def notes(workers: int, by_compiled: float, by_plain: float) -> tuple[str, ...]:
    """Say how it was measured."""
    ratios = (
        f"{by_compiled:.1f} times scikit-opt with the same compiled objective (aim {FASTER_THAN_COMPILED:g}), "
        f"{by_plain:.0f} times scikit-opt with an objective in Python (aim {FASTER_THAN_PLAIN:g})"
    )
    setting = (
        f"zigzag of {SECONDS:g} s at 10 Hz, K, T and alpha; {COMPILED_EVALUATIONS} evaluations each, "
        f"{PLAIN_EVALUATIONS} with Python; median of {REPEATS} runs in turns; {workers} workers"
    )
    return ratios, setting
