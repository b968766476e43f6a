"""The place that outlives a restart: without a receiver she is reckoned on from where she was last known to be.

How long that is ago is known while the computer runs on, by its monotonic clock. Else she may be anywhere, and stays
about where she is until a fix comes.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place, can_be
from firmware_py.estimate import dead_reckoning, position
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.water import WaterState

STEP_M: Final = 25.0  # a restart is to count her no further on than this from the place kept


class LastPlace(msgspec.Struct, frozen=True):
    """Where she was when the record was written, and the water with which she is reckoned on.

    The reckoning's begun_s counts from then: before 0 lies how long there had been no fix.
    """

    latitude_rad: float
    longitude_rad: float
    dead_reckoning: DeadReckoning


def of_state(place: PositionState, water: WaterState) -> LastPlace | None:
    """Return what is to be kept of the place; None while there is none to be reckoned on from."""
    if place.fix is None and place.dead_reckoning is None:
        return None
    dead_reckoned = place.dead_reckoning or dead_reckoning.begin(water, place.t_s)
    dead_reckoned = replace(dead_reckoned, begun_s=-position.unfixed_s(place))
    return LastPlace(place.latitude_rad, place.longitude_rad, dead_reckoned)


def good_for_s(last: LastPlace, at_most_s: float) -> float:
    """Return how long it is as good as a newer one: she does not come far in it, nor is counted on far."""
    water = last.dead_reckoning.water
    fastest_m_s = math.hypot(water.current_north_m_s, water.current_east_m_s) + abs(water.speed_m_s)
    return STEP_M / max(fastest_m_s, STEP_M / at_most_s)


def water_of(last: LastPlace) -> tuple[float, float, float]:
    """Return the current, north and east, and the speed that were reckoned with [m/s]."""
    water = last.dead_reckoning.water
    return water.current_north_m_s, water.current_east_m_s, water.speed_m_s


def restored(last: LastPlace, away_s: float | None) -> PositionState:
    """Return the state that goes on from there, after away_s, None when that is not known.

    Its time counts from the first tick, which tells when that is. ValueError for a place that cannot be.
    """
    if not _usable(last):
        raise ValueError("no place that can be, or no water")
    dead_reckoned, (north_m, east_m) = dead_reckoning.gone_on(last.dead_reckoning, away_s)
    place = Place(last.latitude_rad, last.longitude_rad).at_offset(north_m, east_m)
    return PositionState(0.0, place.latitude_rad, place.longitude_rad, dead_reckoning=dead_reckoned)


def counted_from(state: PositionState, now_s: float) -> PositionState:
    """Return the state that was restored, at the time of the first tick."""
    if state.dead_reckoning is None:
        return state
    dead_reckoned = replace(state.dead_reckoning, begun_s=now_s + state.dead_reckoning.begun_s)
    return replace(state, t_s=now_s, dead_reckoning=dead_reckoned)


def _usable(last: LastPlace) -> bool:
    return can_be(last.latitude_rad, last.longitude_rad) and last.dead_reckoning.begun_s <= 0.0
