"""The objective that swarms are compared with: the yaw rate error over a zigzag.

It is the paper's: the squared error of the yaw rate that the K-T equation predicts from a zigzag of
two minutes at 10 Hz, of K, T and alpha. It is here three times: compiled for many candidates, compiled for
one, and in Python as a user would write it. The compiled ones count time in turning lags,
T dr/dt = dr/d(t/T): the equation is then that of a ship with T = 1 and the step h / T, and its
four divisions a step are gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from firmware_py.model.kt import rk4_step
from hil.lab.compiled import compiled
from hil.lab.swarm.records import Floats

STEP_S = 0.1
SECONDS = 120.0
LEG_S = 20.0
TRUTH = (0.049, 4.0, 17.0)
LOW, HIGH = (0.005, 0.5, 0.0), (0.5, 40.0, 100.0)
LANES = 8  # doubles in the widest vector register: no candidate is left over to be computed alone

OneFish = Callable[[Floats], float]
Log = tuple[Floats, Floats]


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
    lanes = -(-count // LANES) * LANES
    ability, step, norrbin = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    rate, total = np.zeros(lanes), np.zeros(lanes)
    for f in range(count):
        ability[f], step[f], norrbin[f] = points[f, 0], step_s / points[f, 1], points[f, 2]
    for n in range(rudder_rad.size):
        rudder, measured = rudder_rad[n], yaw_rate_rad_s[n]
        for f in range(lanes):
            total[f] += (rate[f] - measured) ** 2
            _, rate[f] = rk4_step(0.0, rate[f], rudder, step[f], ability[f], 1.0, norrbin[f], 0.0)
    for f in range(count):
        values[f] = total[f]


def zigzag(seconds: float = SECONDS) -> Log:
    """Return the rudder and the noisy yaw rate of a zigzag of 20 degrees."""
    samples = round(seconds / STEP_S)
    legs = np.arange(samples) // round(LEG_S / STEP_S)
    rudder_rad = np.where(legs % 2 == 0, 1.0, -1.0) * math.radians(20.0)
    rates, state = [], (0.0, 0.0)
    for rudder in rudder_rad:
        rates.append(state[1])
        state = rk4_step(*state, float(rudder), STEP_S, *TRUTH, 0.0)
    return rudder_rad, np.array(rates) + np.random.default_rng(1).normal(0.0, 1e-3, samples)


def compiled_one(log: Log) -> OneFish:
    """Return the compiled objective of one fish: the one-fish form, which is faster than many with one."""
    return lambda point: error_of_one(point, *log, STEP_S)


def compiled_many(log: Log) -> Callable[[Floats], Floats]:
    """Return the compiled objective of many fish at once."""

    def errors(points: Floats) -> Floats:
        values = np.empty(len(points))
        error_of_many(points, values, *log, STEP_S)
        return values

    return errors


def plain_one(log: Log) -> OneFish:
    """Return the objective in Python, over the arrays of the log as a user has them."""

    def error(point: Floats) -> float:
        ability, lag, norrbin = point
        heading = rate = total = 0.0
        for rudder, measured in zip(*log, strict=True):
            total += (rate - measured) ** 2
            heading, rate = rk4_step(heading, rate, rudder, STEP_S, ability, lag, norrbin, 0.0)
        return total

    return error


def careful_one(log: Log) -> OneFish:
    """Return the objective in Python over lists of Python's own numbers, which it computes faster with."""
    plain = plain_one((log[0].tolist(), log[1].tolist()))
    return lambda point: plain(point.tolist())
