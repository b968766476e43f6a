"""Rudder travel, rudder reversals and energy of the servo."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from firmware_py.common.angles import radians
from firmware_py.common.records import RudderStatus
from firmware_py.common.reports import Energy

WINDOW_S: Final = 3600.0  # time constant of the values per hour
MIN_REVERSAL_RAD: Final = radians(0.5)  # a smaller movement in the opposite direction is no reversal
MAX_GAP_S: Final = 2.0  # between two servo feedbacks; the energy in a longer gap is not counted


class EnergyMeterState(msgspec.Struct, frozen=True):
    """Sums since the start, sums with a memory of WINDOW_S (`recent_`), and the last turning point of the rudder.

    `extreme_rad` is the largest angle in the present `direction` (1 or -1; 0: no movement yet). `power_w` is the newest
    power of the servo, `power_s` its time.
    """

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


def update(state: EnergyMeterState, rudder: RudderStatus, step_s: float) -> EnergyMeterState:
    """Return the state after a tick, updated with the rudder angle and the power of a new servo feedback.

    The noise of a rudder angle sensor would add up, so the travel is then that of the commands.
    """
    angle_rad = rudder.command_rad if rudder.from_sensor else rudder.angle_rad
    previous_rad = angle_rad if state.angle_rad is None else state.angle_rad
    moved_rad = abs(angle_rad - previous_rad)
    extreme_rad, direction, reversals = _turning_point(state, angle_rad)
    decay = math.exp(-step_s / WINDOW_S)
    energy_j, power_w, power_s = state.energy_j, state.power_w, state.power_s
    if rudder.is_new and rudder.feedback_s is not None and rudder.power_w is not None:
        if power_s is not None and 0.0 < rudder.feedback_s - power_s <= MAX_GAP_S:
            energy_j += rudder.power_w * (rudder.feedback_s - power_s)
        power_s, power_w = rudder.feedback_s, rudder.power_w
    return EnergyMeterState(
        state.travel_rad + moved_rad,
        state.reversals + reversals,
        energy_j,
        decay * state.recent_s + step_s,
        decay * state.recent_rad + moved_rad,
        decay * state.recent_reversals + reversals,
        angle_rad,
        extreme_rad,
        direction,
        power_w,
        power_s,
    )


def _turning_point(state: EnergyMeterState, angle_rad: float) -> tuple[float, int, int]:
    """Return the largest angle in the present direction, that direction, and 1 if the rudder has just reversed."""
    if state.angle_rad is None:
        return angle_rad, 0, 0
    extreme_rad, direction = state.extreme_rad, state.direction
    if direction * (angle_rad - extreme_rad) > 0.0:
        return angle_rad, direction, 0
    if abs(angle_rad - extreme_rad) < MIN_REVERSAL_RAD:
        return extreme_rad, direction, 0
    return angle_rad, 1 if angle_rad > extreme_rad else -1, int(direction != 0)


def report(state: EnergyMeterState, *, is_torque_released: bool) -> Energy:
    """Return the report for log and link."""
    per_hour = WINDOW_S / state.recent_s if state.recent_s > 0.0 else 0.0
    return Energy(
        state.travel_rad,
        state.reversals,
        state.energy_j,
        state.recent_rad * per_hour,
        state.recent_reversals * per_hour,
        state.power_w,
        is_torque_released,
    )
