"""Twin of firmware_py/estimate/wave_filter_state.py: what the wave filters keep, and how they begin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import within
from hil.lab.lane_rows import rows
from hil.lab.lanes import COUNT, any_of
from hil.lab.twin import kalman, learning
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
    Rows,
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

# Columns of what else the filter keeps; NaN stands for None.
(T, RUDDER, SAMPLE_T, FIX_T, REFUSALS, INNOVATION, INNOVATION_SD, WATER_NORTH, WATER_EAST, WATER_SPEED, LEG,
 STARTED, SLOW_WAVE, LEG_T) = range(14)  # fmt: skip
REST = 14


Boats = Any  # fields of what the autopilots are told, of which `model` is rows of K, T, alpha and their speed
Filters = Any  # a record of FILTERS
Lanes = Any
OMEGA, ORBIT, NOISE = range(3)  # exponentials that are kept
KEPT = 3
# The filters of all lanes, side by side: states, noise models, the rest, exponents and their exponentials.
FILTERS = np.dtype(
    [
        (name, np.float64, (count, COUNT))
        for name, count in (("x", STATES), ("n", NOISES), ("w", REST), ("exponent", KEPT), ("exponential", KEPT))
    ]
)


@compiled
def exp_of(f: Filters, number: int, exponent: Lanes) -> Lanes:
    """Return the exponential of a number of the noise model, which is computed when the number has changed."""
    before, kept = rows(f.exponent, True), rows(f.exponential, True)
    if any_of(before[number] != exponent):
        before[number], kept[number] = exponent, math.exp(exponent)
    return kept[number]


@compiled
def forget(f: Filters, on: Lanes) -> None:
    """Be filters before their first headings again; what the water is expected to be, and the rudder, stay."""
    w, n = rows(f.w, on), rows(f.n, on)
    w[STARTED] = w[T] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = w[LEG_T] = 0.0
    w[SAMPLE_T] = w[FIX_T] = w[LEG] = np.nan
    for i in range(NOISES):
        n[i] = FIRST_NOISES[i]


@compiled
def keep_water(f: Filters, on: Lanes) -> None:
    """Note what the water of filters that have started is."""
    x = rows(f.x, on)
    w = rows(f.w, on & (rows(f.w, on)[STARTED] > 0.0))
    w[WATER_NORTH], w[WATER_EAST], w[WATER_SPEED] = x[NORTH], x[EAST], x[SPEED]


@compiled
def begin_anew(f: Filters, on: Lanes) -> None:
    """Forget all but the water."""
    keep_water(f, on)
    rows(f.w, on)[RUDDER] = 0.0
    forget(f, on)


@compiled
def begin_filters(f: Filters, on: Lanes, speed_m_s: Lanes) -> None:
    """Be filters before their first headings."""
    rows(f.w, on)[WATER_SPEED] = speed_m_s
    for number in range(KEPT):
        rows(f.exponential, True)[number] = 1.0
    forget(f, on)


@compiled
def start(f: Filters, c: Covariances, on: Lanes, t_s: Lanes, heading_rad: Lanes) -> None:
    """Begin with headings."""
    x, p, w = rows(f.x, on), rows(c.p, on), rows(f.w, on)
    keep_water(f, on)
    for i in range(STATES):
        x[i] = 0.0
    x[HEADING] = x[FLOAT] = heading_rad
    x[NORTH], x[EAST] = w[WATER_NORTH], w[WATER_EAST]
    x[SPEED], x[FACTOR] = within(w[WATER_SPEED], LEAST_SPEED_M_S, MOST_SPEED_M_S), 1.0
    x[COURSE_LAG] = FIRST_COURSE_LAG_S
    for i in range(STATES):
        for k in range(COLUMNS):
            p[i * COLUMNS + k] = 0.0
        p[i * COLUMNS + i] = FIRST[i] * FIRST[i]
    p[kalman.place(HEADING, FLOAT)] = TOGETHER * FIRST[HEADING] * FIRST[FLOAT]
    p[kalman.place(BIAS, BIAS_MEAN)] = FIRST[BIAS_MEAN] * FIRST[BIAS_MEAN]
    w[T], w[SAMPLE_T] = t_s, t_s
    w[RUDDER] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = w[LEG_T] = 0.0
    w[FIX_T] = w[LEG] = np.nan
    w[STARTED] = 1.0


@compiled
def bound(x: Rows) -> None:
    """Keep speeds, turning factors and rudder biases within what a boat can have."""
    x[SPEED] = within(x[SPEED], LEAST_SPEED_M_S, MOST_SPEED_M_S)
    x[FACTOR] = within(x[FACTOR], LEAST_FACTOR, MOST_FACTOR)
    x[BIAS] = within(x[BIAS], -MOST_BIAS_RAD, MOST_BIAS_RAD)
    x[BIAS_MEAN] = within(x[BIAS_MEAN], -MOST_BIAS_RAD, MOST_BIAS_RAD)
