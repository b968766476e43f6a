"""Reduction of a truth to few rows for plots, with all peaks."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hil.sim.truth import COLUMNS, Array, Truth

MAX_FULL_ROWS = 6000  # of a truth that is drawn in full
MAX_POINTS = 4000  # of a thinned line; at least two for each pixel of a plot


def thin_truth(truth: Iterable[Truth], rows: int) -> Truth:
    """Return the minimum and maximum of each column over blocks of rows, in order; few rows are returned unchanged.

    No peak is lost, and no point is moved by more than the width of a line.
    """
    every = 1 if rows <= MAX_FULL_ROWS else 2 * math.ceil(rows / MAX_POINTS)
    pieces = [[extremes(getattr(piece, name), every) for name in COLUMNS] for piece in truth]
    return Truth(*(np.concatenate(column) for column in zip(*pieces, strict=True)))


def extremes(values: Array, every: int) -> Array:
    """Return the minimum and maximum of each `every` values, in order."""
    if every == 1:
        return values
    full_size = values.size // every * every
    blocks = [values[:full_size].reshape(-1, every), values[np.newaxis, full_size:]]
    return np.concatenate(
        [np.take_along_axis(bins, _extreme_indices(bins), axis=1).ravel() for bins in blocks if bins.size]
    )


def _extreme_indices(bins: Array) -> NDArray[np.intp]:
    return np.sort(np.stack((np.argmin(bins, axis=1), np.argmax(bins, axis=1)), axis=1), axis=1)
