"""Dead reckoning: position without fixes, from the last estimate of speed and current, and its standard deviation.

The equations are in water_results.py. This module contains the state that is stored for a restart.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.estimate import water_results
from firmware_py.estimate.water import WaterState

UNUSABLE_SD_M: Final = 1e5  # standard deviation that makes a position unusable

Velocity = tuple[float, float]  # north and east, m/s


class DeadReckoning(msgspec.Struct, frozen=True):
    """State of dead reckoning. `water`: speed and current at its start, and their integrals. `begun_s`: its start."""

    water: water_results.DeadReckoning
    begun_s: float


def begin(water: WaterState, begun_s: float) -> DeadReckoning:
    """Return the state at the start of dead reckoning, with the slow estimate of speed and current if there is one."""
    dead_reckoning = water_results.begin_dead_reckoning(water.filter, begun_s)
    if not math.isnan(water.slow_t_s):
        dead_reckoning = dead_reckoning._replace(
            current_north_m_s=water.slow.north_m_s,
            current_east_m_s=water.slow.east_m_s,
            speed_m_s=water.slow.speed_m_s,
        )
    return DeadReckoning(dead_reckoning, begun_s)


def advance_without_heading(
    state: DeadReckoning, duration_s: float | None
) -> tuple[DeadReckoning, tuple[float, float]]:
    """Return the state after a time of unknown heading, and the drift by the current in this time (north, east; m).

    `duration_s` None: the time is not known, so the position is not usable.
    """
    water = state.water
    if duration_s is None:
        return replace(state, water=water._replace(blind_m=water.blind_m + UNUSABLE_SD_M)), (0.0, 0.0)
    advanced = water._replace(blind_m=water.blind_m + duration_s * math.hypot(water.speed_m_s, water.sideways_m_s))
    drift_m = (duration_s * water.current_north_m_s, duration_s * water.current_east_m_s)
    return DeadReckoning(advanced, state.begun_s - duration_s), drift_m


def advance(
    state: DeadReckoning, heading_rad: float | None, step_s: float, *, is_under_way: bool
) -> tuple[DeadReckoning, Velocity]:
    """Return the state after a step, and the velocity over ground during the step.

    Without a heading the boat is assumed to drift with the current. If it is not under way (for example at anchor), it
    is assumed to stay in place.
    """
    water = state.water
    if not is_under_way:
        max_speed_m_s = water.speed_m_s + math.hypot(water.current_north_m_s, water.current_east_m_s)
        return replace(state, water=water._replace(blind_m=water.blind_m + step_s * max_speed_m_s)), (0.0, 0.0)
    advanced, north_m_s, east_m_s = water_results.advance_dead_reckoning(
        water, math.nan if heading_rad is None else heading_rad, step_s
    )
    return replace(state, water=advanced), (north_m_s, east_m_s)


def standard_deviation_m(state: DeadReckoning, duration_s: float) -> float:
    """Return the standard deviation of the position after `duration_s`, along the axis where it is largest."""
    return water_results.dead_reckoning_sd(state.water, duration_s)
