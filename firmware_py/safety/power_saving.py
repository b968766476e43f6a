"""Power saving: parameters that are replaced while the battery is low."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Final

import msgspec

from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault


class PowerSaving(IntEnum):
    """Level of power saving; at HEADING_ONLY the failsafe of FS_BATT_ACT chooses the mode."""

    OFF = 0
    SAVING = 1
    HEADING_ONLY = 2


class BatteryLimits(msgspec.Struct, frozen=True):
    """Battery charge (0 to 1) and voltage that begin power saving (`save_`) and heading only (`keep_`); 0: no limit."""

    save_charge: float
    save_v: float
    keep_charge: float
    keep_v: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> BatteryLimits:
        """Read the settings from the parameters."""
        return cls(
            save_charge=0.01 * parameters["PWR_SAVE_PCT"],
            save_v=parameters["PWR_SAVE_VOLT"],
            keep_charge=0.01 * parameters["PWR_KEEP_PCT"],
            keep_v=parameters["PWR_KEEP_VOLT"],
        )


# Values while power is saved, from the values that were set.
_WHILE_SAVING: Final[Mapping[str, Callable[[ParameterSet], float]]] = {
    "CTL_PRICE": lambda values: min(values["CTL_PRICE"] * values["PWR_PRICE"], TABLE[INDEX["CTL_PRICE"]].maximum),
    "LOOP_RATE_HZ": lambda values: min(values["LOOP_RATE_HZ"], values["PWR_LOOP_HZ"]),
}


def level_of(active: int) -> PowerSaving:
    """Return the level of power saving while these faults (as bits) are active."""
    if active >> Fault.BATTERY_CRITICAL & 1:
        return PowerSaving.HEADING_ONLY
    return PowerSaving.SAVING if active >> Fault.BATTERY_LOW & 1 else PowerSaving.OFF


@functools.lru_cache(maxsize=8)
def parameters_in_force(parameters: ParameterSet, level: PowerSaving) -> ParameterSet:
    """Return the parameters that apply at a level of power saving."""
    if level is PowerSaving.OFF:
        return parameters
    result = parameters
    for name, value in _WHILE_SAVING.items():
        result = result.replaced(name, value(parameters))
    return result
