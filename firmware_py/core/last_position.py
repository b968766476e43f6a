"""Position record for a restart: without fixes, dead reckoning continues from the last known position.

If the computer was on all the time, the elapsed time is known by the monotonic clock. Otherwise the position error is
unlimited, and the boat keeps station until there is a fix.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place, is_possible_position
from firmware_py.estimate import dead_reckoning, position
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.water import WaterState

MAX_MOVE_M: Final = 25.0  # movement after which a stored position is renewed


class LastPosition(msgspec.Struct, frozen=True):
    """Position at the time of the record, and the state of dead reckoning.

    `dead_reckoning.begun_s` is relative to the time of the record: minus the time without a fix.
    """

    latitude_rad: float
    longitude_rad: float
    dead_reckoning: DeadReckoning


def make_last_position(state: PositionState, water: WaterState) -> LastPosition | None:
    """Return the record of a position state; None while no position is known."""
    if state.fix is None and state.dead_reckoning is None:
        return None
    track = state.dead_reckoning or dead_reckoning.begin(water, state.t_s)
    track = replace(track, begun_s=-position.time_since_fix_s(state))
    return LastPosition(state.latitude_rad, state.longitude_rad, track)


def valid_for_s(last: LastPosition, max_s: float) -> float:
    """Return the time in which the boat moves less than MAX_MOVE_M, at most max_s."""
    water = last.dead_reckoning.water
    max_speed_m_s = math.hypot(water.current_north_m_s, water.current_east_m_s) + abs(water.speed_m_s)
    return MAX_MOVE_M / max(max_speed_m_s, MAX_MOVE_M / max_s)


def water_of(last: LastPosition) -> tuple[float, float, float]:
    """Return current north and east and speed of dead reckoning [m/s]."""
    water = last.dead_reckoning.water
    return water.current_north_m_s, water.current_east_m_s, water.speed_m_s


def restore(last: LastPosition, elapsed_s: float | None) -> PositionState:
    """Return the position state after elapsed_s (None: not known); `with_first_tick` sets its time.

    Raise ValueError for an impossible position and for a negative time without a fix.
    """
    if not _is_valid(last):
        raise ValueError("invalid position or water data")
    track, (north_m, east_m) = dead_reckoning.advance_without_heading(last.dead_reckoning, elapsed_s)
    place = Place(last.latitude_rad, last.longitude_rad).at_offset(north_m, east_m)
    return PositionState(0.0, place.latitude_rad, place.longitude_rad, dead_reckoning=track)


def with_first_tick(state: PositionState, now_s: float) -> PositionState:
    """Return the restored state with the time of the first tick."""
    if state.dead_reckoning is None:
        return state
    track = replace(state.dead_reckoning, begun_s=now_s + state.dead_reckoning.begun_s)
    return replace(state, t_s=now_s, dead_reckoning=track)


def _is_valid(last: LastPosition) -> bool:
    return is_possible_position(last.latitude_rad, last.longitude_rad) and last.dead_reckoning.begun_s <= 0.0
