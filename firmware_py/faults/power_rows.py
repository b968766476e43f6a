"""The rows of the table of faults that are about battery and panels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_py.common.records import Severity
from firmware_py.faults.conditions import battery_is_below
from firmware_py.faults.fault import Fault
from firmware_py.faults.row import Action, FaultRow

POWER: Final[Mapping[Fault, FaultRow]] = {
    Fault.BATTERY_LOW: FaultRow(
        condition="the battery is below PWR_SAVE_PCT or PWR_SAVE_VOLT (until 5 % of charge or 3 % of voltage above it)",
        stands=lambda tick: battery_is_below(tick, Fault.BATTERY_LOW, tick.save_charge, tick.save_v),
        debounce_s=30.0,
        clear_s=60.0,
        severity=Severity.WARNING,
        action=Action.SAVE_POWER,
        text="Battery is low: she saves power",
        recovery="Battery is charged again: she saves no more",
        remedy="see the energy report (`rambler energy`); lighten the load",
    ),
    Fault.BATTERY_CRITICAL: FaultRow(
        condition="the battery is below PWR_KEEP_PCT or PWR_KEEP_VOLT (until 5 % of charge or 3 % of voltage above it)",
        stands=lambda tick: battery_is_below(tick, Fault.BATTERY_CRITICAL, tick.keep_charge, tick.keep_v),
        debounce_s=30.0,
        clear_s=60.0,
        severity=Severity.ERROR,
        action=Action.SAVE_POWER,
        parameter="FS_BATT_ACT",
        resumes=True,
        text="Battery is nearly empty",
        recovery="Battery is no longer nearly empty",
        remedy="sun and time; arming waits until it is charged",
        arming="battery is nearly empty",
    ),
    Fault.POWER_SILENT: FaultRow(
        condition="one who measures battery or panels, and was heard, has said nothing for 15 s",
        stands=lambda tick: tick.power_silent,
        severity=Severity.WARNING,
        text="Power monitor is silent: battery not all known",
        recovery="Power monitor speaks again",
        remedy="cable of the charger or monitor; what it said is not known meanwhile",
    ),
}
