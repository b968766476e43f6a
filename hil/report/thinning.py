"""A truth of any length in few rows, for a picture or a page, without losing a peak."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hil.sim.truth import COLUMNS, Array, Truth

WHOLE_ROWS = 6000  # a truth of no more is drawn whole
MOST_POINTS = 4000  # of a line that is thinned: two for each dot of a picture and more


def thinned(truth: Iterable[Truth], rows: int) -> Truth:
    """Return few rows where there are many: of each column the least and the greatest of every so many, in order.

    No peak is lost, and nothing is moved by more than the width of a line.
    """
    every = 1 if rows <= WHOLE_ROWS else 2 * math.ceil(rows / MOST_POINTS)
    kept = [[extremes(getattr(piece, name), every) for name in COLUMNS] for piece in truth]
    return Truth(*(np.concatenate(column) for column in zip(*kept, strict=True)))


def extremes(values: Array, every: int) -> Array:
    """Return the least and the greatest of every so many values, in order."""
    if every == 1:
        return values
    whole = values.size // every * every
    parts = [values[:whole].reshape(-1, every), values[np.newaxis, whole:]]
    return np.concatenate([np.take_along_axis(bins, _places(bins), axis=1).ravel() for bins in parts if bins.size])


def _places(bins: Array) -> NDArray[np.intp]:
    return np.sort(np.stack((np.argmin(bins, axis=1), np.argmax(bins, axis=1)), axis=1), axis=1)
