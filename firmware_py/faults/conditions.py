"""Conditions of the table of faults that are more than a flag: limits that lie further back once a fault is set."""

from __future__ import annotations

from typing import Final

from firmware_py.common.records import DeviceState
from firmware_py.faults.fault import Fault
from firmware_py.faults.row import FaultInput, exceeds

COOLER_C: Final = 5.0
FULLER: Final = 1.03  # of a voltage
CHARGED: Final = 0.05


def servo_is_hot(tick: FaultInput) -> bool:
    """Whether the servo is hotter than its limit."""
    margin_c = COOLER_C if tick.is_set(Fault.RUDDER_HOT) else 0.0
    return exceeds(tick.servo_temperature_c, tick.servo_hot_c - margin_c)


def supply_is_low(tick: FaultInput) -> bool:
    """Whether the voltage at the servo is below its limit."""
    factor = FULLER if tick.is_set(Fault.SUPPLY_LOW) else 1.0
    return tick.supply_v is not None and tick.supply_v < tick.supply_low_v * factor


def storage_is_full(tick: FaultInput) -> bool:
    """Whether the disk has too little room; while it fails nobody knows, as before."""
    return tick.storage is DeviceState.FULL or (tick.storage is DeviceState.FAULTY and tick.is_set(Fault.STORAGE_FULL))


def battery_is_below(tick: FaultInput, fault: Fault, least_charge: float, least_v: float) -> bool:
    """Whether charge or voltage of the battery is below its limit, 0 for none; while neither is known, as before."""
    was_below = tick.is_set(fault)
    judged = []
    if least_charge > 0.0 and tick.battery_charge is not None:
        judged.append(tick.battery_charge < least_charge + (CHARGED if was_below else 0.0))
    if least_v > 0.0 and tick.battery_v is not None:
        judged.append(tick.battery_v < least_v * (FULLER if was_below else 1.0))
    if judged:
        return any(judged)
    return was_below and (least_charge > 0.0 or least_v > 0.0)
