"""Fills in the numbers of everything that moves by itself in a sea, as hil/ship does step by step."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI
from hil.lab.compiled import compiled
from hil.lab.normals import fill
from hil.lab.twin.ship import GRID_S, Floats
from hil.ship.noise import BLOCK


class Part(NamedTuple):
    """A part of the series: how many numbers, and what fills them in."""

    size: int
    fill: Callable[[Floats], None]


def clear(out: Floats) -> None:
    """Fill in zeros."""
    out[:] = 0.0


@compiled
def swing(
    spreads: tuple[float, float], a: tuple[tuple[float, float], tuple[float, float]], n: tuple[float, float, float],
    state: NDArray[np.uint64], out: Floats,
) -> None:  # fmt: skip
    """Fill in angle and rate of a wave process."""
    # NormalNumbers gives the last number of each of its blocks first.
    numbers, y, v = np.empty(BLOCK), 0.0, 0.0
    for k in range(out.size // 2):
        place = BLOCK - 1 - 2 * k % BLOCK
        if place == BLOCK - 1:
            fill(state, numbers)
        first, second = numbers[place], numbers[place - 1]
        if k == 0:
            y, v = spreads[0] * first, spreads[1] * second
        else:
            y, v = (
                a[0][0] * y + a[0][1] * v + n[0] * first,
                a[1][0] * y + a[1][1] * v + n[1] * first + n[2] * second,
            )
        out[2 * k], out[2 * k + 1] = y, v


@compiled
def wander(first: float, keep: float, add: float, state: NDArray[np.uint64], out: Floats) -> None:
    """Fill in what wanders about 0."""
    numbers, value = np.empty(BLOCK), 0.0
    for k in range(out.size):
        place = BLOCK - 1 - k % BLOCK
        if place == BLOCK - 1:
            fill(state, numbers)
        value = first * numbers[place] if k == 0 else keep * value + add * numbers[place]
        out[k] = value


@compiled
def follow(first: float, keep: float, add: float, out: Floats) -> None:
    """Replace normal numbers by a first-order process that they drive, from the value before the first of them."""
    value = first
    for k in range(out.size):
        value = keep * value + add * out[k]
        out[k] = value


@compiled
def die(fade: float, calm_at_s: float, calm_until_s: float, out: Floats) -> None:
    """Fill in how much of the waves there is, when they die for a while."""
    out[0] = 1.0
    for k in range(1, out.size):
        level = 0.0 if calm_at_s <= k * GRID_S < calm_until_s else 1.0
        out[k] = level + fade * (out[k - 1] - level)


@compiled
def add_gust(begin: int, end: int, peak_rad: float, out: Floats) -> None:
    """Add a pulse."""
    for k in range(begin, min(end, out.size)):
        out[k] += 0.5 * peak_rad * (1.0 - math.cos(TWO_PI * (k - begin) / (end - begin)))
