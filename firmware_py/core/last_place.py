"""The place that outlives a restart: without a receiver she is reckoned on from where she was last known to be.

How long the autopilot was away is known only while the computer ran on meanwhile: the calendar clock of one that had no
power may say anything. Else she may be anywhere, and stays about where she is until a fix comes.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.geodesy import Place
from firmware_py.common.record_class import dataclass
from firmware_py.common.record_copy import replace
from firmware_py.estimate import position, reckoning
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.reckoning import COVARIANCES, Reckoning
from firmware_py.estimate.water import WaterState
from firmware_py.estimate.wave_filter_state import WaveFilterState

STEP_M: Final = 25.0  # a place no further off is worth no writing


@dataclass(frozen=True, slots=True)
class LastPlace:
    """Where she was at utc_s, by the computer's clock in its run `boot`, and the water with which she is reckoned on.

    The reckoning's begun_s counts from then: before 0 lies how long there had been no fix.
    """

    latitude_rad: float
    longitude_rad: float
    utc_s: float
    boot: str
    reckoning: Reckoning


def of_state(
    place: PositionState, waves: WaveFilterState, water: WaterState, utc_s: float, boot: str
) -> LastPlace | None:
    """Return what is to be kept of the place; None while there is none to be reckoned on from."""
    if place.fix is None and place.reckoning is None:
        return None
    reckoned = place.reckoning or reckoning.begin(waves, water.slow_m_s, 0.0)
    if reckoned is None:
        return None
    reckoned = replace(reckoned, begun_s=-position.unfixed_s(place))
    return LastPlace(place.latitude_rad, place.longitude_rad, utc_s, boot, reckoned)


def is_near(one: LastPlace | None, other: LastPlace | None) -> bool:
    """Whether two are as good as each other; neither is none."""
    if one is None or other is None or one.boot != other.boot:
        return one is other
    return math.hypot(*_place(one).nearby_offset_m(_place(other))) <= STEP_M


def water_of(last: LastPlace) -> tuple[float, float, float]:
    """Return the current, north and east, and the speed that were reckoned with [m/s]."""
    water = last.reckoning
    return water.current_north_m_s, water.current_east_m_s, water.speed_m_s


def restored(last: LastPlace, utc_s: float, boot: str) -> PositionState:
    """Return the state that goes on from there; its time counts from the first tick, which tells when that is.

    It is one without a place when the record is of no use.
    """
    if not _usable(last):
        return PositionState()
    away_s = utc_s - last.utc_s if boot and last.boot == boot and utc_s >= last.utc_s else None
    reckoned, (north_m, east_m) = reckoning.gone_on(last.reckoning, away_s)
    place = _place(last).at_offset(north_m, east_m)
    return PositionState(0.0, place.latitude_rad, place.longitude_rad, reckoning=reckoned)


def counted_from(state: PositionState, now_s: float) -> PositionState:
    """Return the state that was restored, at the time of the first tick."""
    if state.reckoning is None:
        return state
    reckoned = replace(state.reckoning, begun_s=now_s + state.reckoning.begun_s)
    return replace(state, t_s=now_s, reckoning=reckoned)


def _place(last: LastPlace) -> Place:
    return Place(last.latitude_rad, last.longitude_rad)


def _usable(last: LastPlace) -> bool:
    on_earth = abs(last.latitude_rad) <= 0.5 * math.pi and abs(last.longitude_rad) <= math.pi
    return on_earth and len(last.reckoning.covariance) == COVARIANCES and last.reckoning.begun_s <= 0.0
