"""Positions as MAVLink gives them."""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from firmware_py.common.geodesy import Place
from firmware_py.common.intents import SetHome, SteerPosition
from firmware_py.link.context import within

# 0 deg N 0 deg E stands for unset fields, nine times out of ten: no goal and no home; in a mission, where she is.

# MAV_FRAME: GLOBAL, GLOBAL_RELATIVE_ALT, the same two as _INT, and both over terrain. A boat has no altitude.
GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})

_HIGHEST_M = 10_000.0
_FARTHEST_M = 100_000.0  # the flat-earth offset is no good beyond


def position_goal(latitude_deg: float, longitude_deg: float, *, change_mode: bool = False) -> SteerPosition | str:
    """Return the goal, or why it is none."""
    if not within(latitude_deg, -90.0, 90.0) or not within(longitude_deg, -180.0, 180.0):
        return "the position is not on this planet"
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        return "0, 0 is no place to go to"
    return SteerPosition(radians(latitude_deg), radians(longitude_deg), change_mode=change_mode)


def home_of(latitude_deg: float, longitude_deg: float, altitude_m: float) -> SetHome | str:
    """Return the request to set home there, or why it is none; an altitude that is not given (NaN) is 0."""
    if not within(latitude_deg, -90.0, 90.0) or not within(longitude_deg, -180.0, 180.0):
        return "the position is not on this planet"
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        return "0, 0 is no home"
    if math.isnan(altitude_m):
        altitude_m = 0.0
    if not within(altitude_m, -_HIGHEST_M, _HIGHEST_M):
        return "the altitude is out of range"
    return SetHome(radians(latitude_deg), radians(longitude_deg), altitude_m)


def offset_goal(latitude_rad: float, longitude_rad: float, north_m: float, east_m: float) -> SteerPosition | str:
    """Return the goal that lies north and east of a position, or why it is none."""
    if not within(north_m, -_FARTHEST_M, _FARTHEST_M) or not within(east_m, -_FARTHEST_M, _FARTHEST_M):
        return f"the position is not within {_FARTHEST_M / 1e3:.0f} km"
    goal = Place(latitude_rad, longitude_rad).at_local_offset(north_m, east_m)
    if goal is None:
        return "local positions end at the poles"
    return SteerPosition(goal.latitude_rad, goal.longitude_rad)
