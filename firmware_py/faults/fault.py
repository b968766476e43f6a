"""Numbers of the faults."""

from __future__ import annotations

from enum import IntEnum


class Fault(IntEnum):
    """Number of a fault, which is its bit in Snapshot.faults, logs and telemetry."""

    COMPASS_LOST = 0
    POSITION_LOST = 1
    RUDDER_SILENT = 2
    RUDDER_ERROR = 3
    LOOP_LATE = 4
    STORAGE_FAILING = 5
    CURRENT_STRONG = 6
    MISSION_UNUSABLE = 7
    FENCE_BREACHED = 8
    COMPASS_SILENT = 9
    COMPASS_FROZEN = 10
    COMPASS_JUMPING = 11
    COMPASS_DISAGREES = 12
    POSITION_JUMPING = 13
    RUDDER_ASTRAY = 14
    RUDDER_JAMMED = 15
    RUDDER_HOT = 16
    RUDDER_OVERLOADED = 17
    RUDDER_REPOWERED = 18
    SUPPLY_LOW = 19
    STORAGE_FULL = 20
    CLOCK_STEPPED = 21
    STATION_SILENT = 22
    STEERING_LOST = 23
    KEY_LOST = 24
    HELM_OSCILLATES = 25
    BATTERY_LOW = 26
    BATTERY_CRITICAL = 27
    POWER_SILENT = 28
    STEERING_REVERSED = 29
    VESSEL_NEAR = 30
    ESTIMATE_INCONSISTENT = 31
    WATER_SHALLOW = 32
    WIND_STRONG = 33
