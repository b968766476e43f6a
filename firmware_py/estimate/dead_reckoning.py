"""Dead reckoning: position without fixes, from the last estimate of speed and current, and the growth of its error.

The equations are those of water_results.py. This module holds the record that outlives a restart.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.estimate import water_results
from firmware_py.estimate.water import WaterState

UNUSABLE_SD_M: Final = 1e5  # a position as uncertain as this is of no use

Velocity = tuple[float, float]  # north and east, m/s


class DeadReckoning(msgspec.Struct, frozen=True):
    """Speed and current at the last fix, at begun_s, and the way since."""

    water: water_results.DeadReckoning
    begun_s: float


def begin(water: WaterState, begun_s: float) -> DeadReckoning:
    """Return the dead reckoning that begins with the speed and current used for guidance."""
    dead_reckoning = water_results.begin_dead_reckoning(water.filter, begun_s)
    if not math.isnan(water.slow_t_s):
        dead_reckoning = dead_reckoning._replace(
            current_north_m_s=water.slow.north_m_s,
            current_east_m_s=water.slow.east_m_s,
            speed_m_s=water.slow.speed_m_s,
        )
    return DeadReckoning(dead_reckoning, begun_s)


def advanced(state: DeadReckoning, away_s: float | None) -> tuple[DeadReckoning, Velocity]:
    """Return the dead reckoning after a time of unknown heading, and the drift by the current in it, in metres.

    `away_s` is the length of that time; None: not known, so the position is of no use.
    """
    water = state.water
    if away_s is None:
        return replace(state, water=water._replace(blind_m=water.blind_m + UNUSABLE_SD_M)), (0.0, 0.0)
    gone = water._replace(blind_m=water.blind_m + away_s * math.hypot(water.speed_m_s, water.sideways_m_s))
    moved_m = (away_s * water.current_north_m_s, away_s * water.current_east_m_s)
    return DeadReckoning(gone, state.begun_s - away_s), moved_m


def advance(
    state: DeadReckoning, heading_rad: float | None, step_s: float, *, under_way: bool
) -> tuple[DeadReckoning, Velocity]:
    """Return the dead reckoning after a step, and the velocity over ground in it.

    Without a heading the boat is assumed to drift with the current; not `under_way`, as at anchor, to stay in place.
    """
    water = state.water
    if not under_way:
        fastest_m_s = water.speed_m_s + math.hypot(water.current_north_m_s, water.current_east_m_s)
        return replace(state, water=water._replace(blind_m=water.blind_m + step_s * fastest_m_s)), (0.0, 0.0)
    sailed, north_m_s, east_m_s = water_results.advance_dead_reckoning(
        water, math.nan if heading_rad is None else heading_rad, step_s
    )
    return replace(state, water=sailed), (north_m_s, east_m_s)


def standard_deviation_m(state: DeadReckoning, lasted_s: float) -> float:
    """Return the standard deviation of the position, along the axis where it is largest."""
    return water_results.dead_reckoning_sd(state.water, lasted_s)
