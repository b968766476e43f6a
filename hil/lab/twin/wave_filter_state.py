"""Twin of firmware_py/estimate/wave_filter_state.py: what the wave filter keeps, and how it begins."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import clamp
from hil.lab.twin import learning
from hil.lab.twin.kalman import (
    BIAS,
    BIAS_MEAN,
    COLUMNS,
    COURSE_LAG,
    EAST,
    FACTOR,
    FLOAT,
    HEADING,
    NORTH,
    SPEED,
    STATES,
    Covariances,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import NOISES

FIRST_NOISES = learning.FIRST
LOW_FACTOR, HIGH_FACTOR = 0.4, 2.5
LOW_SPEED_M_S, HIGH_SPEED_M_S = 0.08, 2.5
FIRST_COURSE_LAG_S, TOGETHER = 0.5, 0.98
FIRST = np.array(
    (
        *(radians(30.0), radians(1.0), radians(5.0), radians(30.0), radians(1.0)),
        *(0.2, 0.2, 0.4, 0.2, radians(5.0), 0.7, radians(4.5)),
        *(radians(10.0), radians(8.0), 0.1, 0.1, 0.1, 0.1),
    )
)

# Columns of what else the filter keeps; NaN stands for None.
(T, RUDDER, SAMPLE_T, FIX_T, REFUSALS, INNOVATION, INNOVATION_SD, WATER_NORTH, WATER_EAST, WATER_SPEED, LEG,
 STARTED, SLOW_WAVE) = range(13)  # fmt: skip
REST = 13


Boats = Any  # records that have a model: K, T, alpha and the speed that they are of
Filters = Any
WaveFilter = Any  # a record of FILTER: state, noise model, the rest, and which of the covariances' lanes is its own
OMEGA, ORBIT = range(2)  # exponentials that are kept
KEPT = 2
FILTER = np.dtype(
    [
        ("x", np.float64, (STATES,)),
        ("n", np.float64, (NOISES,)),
        ("w", np.float64, (REST,)),
        ("kept", np.float64, (KEPT, 2)),
        ("lane", np.int64),
    ]
)


@compiled
def exp_of(f: WaveFilter, number: int, exponent: float) -> float:
    """Return the exponential of a number of the noise model, which is computed when the number has changed."""
    kept = f.kept
    if kept[number, 0] != exponent:
        kept[number, 0], kept[number, 1] = exponent, math.exp(exponent)
    return float(kept[number, 1])


@compiled
def forget(f: WaveFilter) -> None:
    """Be a filter before its first heading again; what the water is expected to be, and the rudder, stay."""
    w = f.w
    w[STARTED] = w[T] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = 0.0
    w[SAMPLE_T] = w[FIX_T] = w[LEG] = np.nan
    for i in range(NOISES):
        f.n[i] = FIRST_NOISES[i]


@compiled
def begin_anew(f: WaveFilter) -> None:
    """Forget all but the water."""
    if f.w[STARTED] > 0.0:
        f.w[WATER_NORTH], f.w[WATER_EAST], f.w[WATER_SPEED] = f.x[NORTH], f.x[EAST], f.x[SPEED]
    f.w[RUDDER] = 0.0
    forget(f)


@compiled
def begin_filter(f: WaveFilter, speed_m_s: float) -> None:
    """Be a filter before its first heading."""
    f.w[WATER_SPEED] = speed_m_s
    for number in range(KEPT):
        f.kept[number, 1] = 1.0  # that of 0
    forget(f)


@compiled
def start(f: WaveFilter, c: Covariances, t_s: float, heading_rad: float) -> None:
    """Begin with a heading."""
    x, p, w, lane = f.x, c.p, f.w, f.lane
    if w[STARTED] > 0.0:
        w[WATER_NORTH], w[WATER_EAST], w[WATER_SPEED] = x[NORTH], x[EAST], x[SPEED]
    for i in range(STATES):
        x[i] = 0.0
    x[HEADING] = x[FLOAT] = heading_rad
    x[NORTH], x[EAST] = w[WATER_NORTH], w[WATER_EAST]
    x[SPEED], x[FACTOR] = clamp(w[WATER_SPEED], LOW_SPEED_M_S, HIGH_SPEED_M_S), 1.0
    x[COURSE_LAG] = FIRST_COURSE_LAG_S
    for i in range(STATES):
        for k in range(COLUMNS):
            p[i, k, lane] = 0.0
        p[i, i, lane] = FIRST[i] * FIRST[i]
    both = TOGETHER * FIRST[HEADING] * FIRST[FLOAT]
    p[HEADING, FLOAT, lane] = p[FLOAT, HEADING, lane] = both
    p[BIAS, BIAS_MEAN, lane] = p[BIAS_MEAN, BIAS, lane] = FIRST[BIAS_MEAN] * FIRST[BIAS_MEAN]
    w[T], w[SAMPLE_T] = t_s, t_s
    w[RUDDER] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = 0.0
    w[FIX_T] = w[LEG] = np.nan
    w[STARTED] = 1.0


@compiled
def bound(x: Floats) -> None:
    """Keep speed and turning factor within what a boat can have."""
    speed_m_s, factor = x[SPEED], x[FACTOR]
    if LOW_SPEED_M_S <= speed_m_s <= HIGH_SPEED_M_S and LOW_FACTOR <= factor <= HIGH_FACTOR:
        return
    x[SPEED] = clamp(speed_m_s, LOW_SPEED_M_S, HIGH_SPEED_M_S)
    x[FACTOR] = clamp(factor, LOW_FACTOR, HIGH_FACTOR)
