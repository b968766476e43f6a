"""Seeded random numbers: one independent stream for each random process."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

BLOCK_SIZE = 1024


class Stream(IntEnum):
    """Streams of random numbers; a new stream does not change the numbers of the others."""

    WAVES = 0
    DRIFT = 1
    COMPASS = 2
    POSITION = 3
    RUDDER = 4
    PHASES = 5  # start times and clock errors of the devices
    GUSTS = 6
    ORBIT = 7
    SPEED = 8
    ROLL = 9
    GAPS = 10  # in the GNSS fix
    ORBIT_ALONE = 11  # orbital motion that is independent of the wave yaw
    CLOUDS = 12
    POWER = 13
    SATELLITE = 14
    SHIPS = 15
    AIR = 16  # reception of AIS messages
    YAW = 17
    COMPASS_B = 18
    WIND = 19
    DEPTH = 20
    RUDDER_ANGLE = 21


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """Return the generator of a stream of a run."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int(stream)])))


class NormalNumbers:
    """Standard normal numbers one at a time, drawn in blocks because a single draw is slow."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Start with an empty block."""
        self._rng = rng
        self._numbers: list[float] = []

    def draw(self) -> float:
        """Return the next number."""
        if not self._numbers:
            self._numbers = self._rng.standard_normal(BLOCK_SIZE).tolist()
        return self._numbers.pop()
