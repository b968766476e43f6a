"""Selection among NMEA messages that repeat one measurement, as instruments send them in one burst."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Generic, TypeVar

from firmware_py.common.records import WindReference

KindT = TypeVar("KindT")
HOLD_S = 5.0  # time after which a better kind that has stopped is replaced

MAX_WIND_M_S = 120.0  # the strongest gust ever measured at the surface, outside tornadoes, is 113 m/s
# The sensor measures the apparent wind and computes the others; the autopilot knows heading and motion better.
WIND_RANKS: Mapping[WindReference, int] = {
    WindReference.APPARENT: 0,
    WindReference.NORTH: 1,
    WindReference.BOW: 2,
    WindReference.BOW_WATER: 2,
    WindReference.MAGNETIC: 3,
}


class Preference(Generic[KindT]):
    """Accepts a kind of sentence only if no better one has arrived within HOLD_S."""

    def __init__(self, ranks: Mapping[KindT, int]) -> None:
        """Store the rank of each kind; 0 is the best."""
        self._ranks = ranks
        self._last_s = [-math.inf] * (1 + max(ranks.values()))

    def accepts(self, kind: KindT, now_s: float) -> bool:
        """Return whether a valid measurement of this kind, received at now_s, is used."""
        rank = self._ranks[kind]
        self._last_s[rank] = now_s
        return all(now_s - last_s > HOLD_S for last_s in self._last_s[:rank])
