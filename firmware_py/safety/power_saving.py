"""How she saves power: which parameters hold instead of those that were set, by how far the battery is down."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Final

import msgspec

from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.faults.table import Fault


class Saving(IntEnum):
    """How far she saves; the mode of the last step is the failsafe's (FS_BATT_ACT)."""

    NOTHING = 0
    SAVES = 1
    KEEPS_HEADING = 2


class BatteryLimits(msgspec.Struct, frozen=True):
    """Charge (0 to 1) and voltage of the battery below which she saves, and only keeps her heading; 0: never."""

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


# What holds while she saves, from what was set.
_WHILE_SAVING: Final[Mapping[str, Callable[[ParameterSet], float]]] = {
    "CTL_PRICE": lambda values: min(values["CTL_PRICE"] * values["PWR_PRICE"], TABLE[INDEX["CTL_PRICE"]].maximum),
    "LOOP_RATE_HZ": lambda values: min(values["LOOP_RATE_HZ"], values["PWR_LOOP_HZ"]),
}


def saving(active: int) -> Saving:
    """Return how far she saves while these faults (as bits) are set."""
    if active >> Fault.BATTERY_CRITICAL & 1:
        return Saving.KEEPS_HEADING
    return Saving.SAVES if active >> Fault.BATTERY_LOW & 1 else Saving.NOTHING


@functools.lru_cache(maxsize=8)
def parameters_in_force(parameters: ParameterSet, how: Saving) -> ParameterSet:
    """Return the parameters that hold while she saves."""
    if how is Saving.NOTHING:
        return parameters
    held = parameters
    for name, value in _WHILE_SAVING.items():
        held = held.replaced(name, value(parameters))
    return held
