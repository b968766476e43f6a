"""Meters what steering costs: rudder travel, reversals, and the energy that the servo takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_py.common.angles import radians
from firmware_py.common.records import Energy

WINDOW_S: Final = 3600.0  # what is told per hour is that of about the last hour
TURNED_RAD: Final = radians(0.5)  # less than this the other way is no reversal
LONGEST_GAP_S: Final = 2.0  # without word from the servo for longer nothing is known of its current


@dataclass(frozen=True, slots=True)
class EnergyMeterState:
    """The sums since start, those of about the last hour, and the last turning point of the rudder."""

    travel_rad: float = 0.0
    reversals: int = 0
    energy_j: float = 0.0
    recent_s: float = 0.0
    recent_rad: float = 0.0
    recent_reversals: float = 0.0
    angle_rad: float | None = None
    extreme_rad: float = 0.0
    direction: int = 0
    power_w: float | None = None
    power_s: float | None = None


def update(
    state: EnergyMeterState,
    angle_rad: float,
    power: tuple[float, float] | None,
    step_s: float,
) -> EnergyMeterState:
    """Take a tick's rudder angle in, and the time and power of a new word from the servo."""
    before_rad = angle_rad if state.angle_rad is None else state.angle_rad
    moved_rad = abs(angle_rad - before_rad)
    extreme_rad, direction, turned = _turning(state, angle_rad)
    keep = math.exp(-step_s / WINDOW_S)
    energy_j, power_w, power_s = state.energy_j, state.power_w, state.power_s
    if power is not None:
        told_s, told_w = power
        if power_s is not None and 0.0 < told_s - power_s <= LONGEST_GAP_S:
            energy_j += told_w * (told_s - power_s)
        power_s, power_w = told_s, told_w
    return EnergyMeterState(
        state.travel_rad + moved_rad,
        state.reversals + turned,
        energy_j,
        keep * state.recent_s + step_s,
        keep * state.recent_rad + moved_rad,
        keep * state.recent_reversals + turned,
        angle_rad,
        extreme_rad,
        direction,
        power_w,
        power_s,
    )


def _turning(state: EnergyMeterState, angle_rad: float) -> tuple[float, int, int]:
    """Return the farthest angle on the present way, its direction, and 1 when it has just been reversed."""
    if state.angle_rad is None:
        return angle_rad, 0, 0
    from_rad, direction = state.extreme_rad, state.direction
    if direction * (angle_rad - from_rad) > 0.0:
        return angle_rad, direction, 0
    if abs(angle_rad - from_rad) < TURNED_RAD:
        return from_rad, direction, 0
    return angle_rad, 1 if angle_rad > from_rad else -1, int(direction != 0)


def report(state: EnergyMeterState, *, resting: bool) -> Energy:
    """Return what is told to log and link."""
    per_hour = WINDOW_S / state.recent_s if state.recent_s > 0.0 else 0.0
    return Energy(
        state.travel_rad,
        state.reversals,
        state.energy_j,
        state.recent_rad * per_hour,
        state.recent_reversals * per_hour,
        state.power_w,
        resting,
    )
