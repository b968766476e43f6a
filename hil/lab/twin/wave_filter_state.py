"""The state of the wave filter and its start (firmware_py/estimate/wave_filter_state.py) for compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware_py.common.angles import clamp, radians
from hil.lab.compiled import compiled
from hil.lab.twin import learning
from hil.lab.twin.kalman import (
    BIAS,
    BIAS_MEAN,
    COURSE_LAG,
    EAST,
    FACTOR,
    FLOAT,
    HEADING,
    NORTH,
    SPEED,
    STATES,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import NOISES

FIRST_NOISES = learning.FIRST
LEAST_FACTOR, MOST_FACTOR = 0.4, 2.5
LEAST_SPEED_M_S, MOST_SPEED_M_S = 0.08, 2.5
MOST_BIAS_RAD = radians(30.0)
FIRST_COURSE_LAG_S, TOGETHER = 0.5, 0.98
FIRST = np.array(
    (
        *(radians(30.0), radians(1.0), radians(5.0), radians(30.0), radians(1.0)),
        *(0.2, 0.2, 0.4, 0.2, radians(5.0), 0.7, radians(4.5)),
        *(radians(10.0), radians(8.0), 0.1, 0.1, 0.1, 0.1),
    )
)

# Of what else the filter keeps; NaN stands for None.
(T, RUDDER, SAMPLE_T, FIX_T, REFUSALS, INNOVATION, INNOVATION_SD, WATER_NORTH, WATER_EAST, WATER_SPEED, LEG,
 STARTED, SLOW_WAVE, LEG_T) = range(14)  # fmt: skip
REST = 14

# The filter: states, noise model, the rest.
FILTER = np.dtype([("x", np.float64, (STATES,)), ("n", np.float64, (NOISES,)), ("w", np.float64, (REST,))])
Filter = Any  # a record of FILTER


@compiled
def forget(f: Filter) -> None:
    """Return to the state before the first heading; what the water is expected to be, and the rudder, stay."""
    w = f.w
    w[STARTED] = w[T] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = w[LEG_T] = 0.0
    w[SAMPLE_T] = w[FIX_T] = w[LEG] = np.nan
    for i in range(NOISES):
        f.n[i] = FIRST_NOISES[i]


@compiled
def keep_water(f: Filter) -> None:
    """Note the current and the speed of a filter that has started."""
    x, w = f.x, f.w
    if w[STARTED] > 0.0:
        w[WATER_NORTH], w[WATER_EAST], w[WATER_SPEED] = x[NORTH], x[EAST], x[SPEED]


@compiled
def restart(f: Filter) -> None:
    """Forget all but the water."""
    keep_water(f)
    f.w[RUDDER] = 0.0
    forget(f)


@compiled
def start(f: Filter, p: Floats, t_s: float, heading_rad: float) -> None:
    """Start with a heading."""
    x, w = f.x, f.w
    keep_water(f)
    for i in range(STATES):
        x[i] = 0.0
        for k in range(p.shape[1]):
            p[i, k] = 0.0
        p[i, i] = FIRST[i] * FIRST[i]
    x[HEADING] = x[FLOAT] = heading_rad
    x[NORTH], x[EAST] = w[WATER_NORTH], w[WATER_EAST]
    x[SPEED], x[FACTOR] = clamp(w[WATER_SPEED], LEAST_SPEED_M_S, MOST_SPEED_M_S), 1.0
    x[COURSE_LAG] = FIRST_COURSE_LAG_S
    p[HEADING, FLOAT] = p[FLOAT, HEADING] = TOGETHER * FIRST[HEADING] * FIRST[FLOAT]
    p[BIAS, BIAS_MEAN] = p[BIAS_MEAN, BIAS] = FIRST[BIAS_MEAN] * FIRST[BIAS_MEAN]
    w[T] = w[SAMPLE_T] = t_s
    w[RUDDER] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = w[LEG_T] = 0.0
    w[FIX_T] = w[LEG] = np.nan
    w[STARTED] = 1.0


@compiled
def bound(x: Floats) -> None:
    """Keep speed, turning factor and rudder biases within what a boat can have."""
    x[SPEED] = clamp(x[SPEED], LEAST_SPEED_M_S, MOST_SPEED_M_S)
    x[FACTOR] = clamp(x[FACTOR], LEAST_FACTOR, MOST_FACTOR)
    x[BIAS] = clamp(x[BIAS], -MOST_BIAS_RAD, MOST_BIAS_RAD)
    x[BIAS_MEAN] = clamp(x[BIAS_MEAN], -MOST_BIAS_RAD, MOST_BIAS_RAD)
