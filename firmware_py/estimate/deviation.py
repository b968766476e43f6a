"""Deviation of a compass: its error due to the iron of the boat, with the classical coefficients A to E.

deviation = A + B sin h + C cos h + D sin 2h + E cos 2h        h = compass heading of the hull
"""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet

Deviation = tuple[float, float, float, float, float]

NAMES = tuple(f"CMP_DEV_{letter}" for letter in "ABCDE")  # parameters of compass A


def read_deviation(parameters: ParameterSet, prefix: str) -> Deviation:
    """Return the coefficients of the compass whose parameters begin with the prefix."""
    a, b, c, d, e = (radians(parameters[f"{prefix}_DEV_{letter}"]) for letter in "ABCDE")
    return a, b, c, d, e


def deviation_rad(deviation: Deviation, heading_rad: float) -> float:
    """Return the angle that, added to a compass heading, gives the magnetic heading."""
    if not any(deviation):
        return 0.0
    a, b, c, d, e = deviation
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    return a + b * sine + c * cosine + 2.0 * d * sine * cosine + e * (cosine * cosine - sine * sine)
