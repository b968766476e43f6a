"""What the table of faults is made of: the faults, the actions, the modes that an action tries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from firmware_py.common.records import Mode, Severity


class Fault(IntEnum):
    """The rows of TABLE."""

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


class Action(IntEnum):
    """What is done while a fault stands; those that a parameter may choose have its value."""

    ALERT = 0  # tells the operator, goes on
    AMIDSHIPS = 1  # mode HOLD
    KEEP_HEADING = 2  # mode STEERING, on the heading that she has
    LOITER = 3
    RTL = 4
    HOLD_THEN_AMIDSHIPS = 5  # holds the last rudder for CTL_HOLD_S, 30 s at most, then amidships
    NEXT_SOURCE = 6  # steers by the next heading source, the course over ground as the last
    NOT_BELIEVED = 7  # goes on from what was believed
    EASE = 8  # the command follows the measured angle, so that nothing pulls; tried again every 10 s
    SET_UP_AGAIN = 9  # the driver writes the settings anew before it steers
    POINT_INTO_IT = 10  # guidance points her into the current
    KEEP_STATION = 11  # guidance keeps a watch circle


DONE: Mapping[Action, str] = {
    Action.ALERT: "alert only",
    Action.AMIDSHIPS: "HOLD: rudder amidships",
    Action.KEEP_HEADING: "STEERING: keep the heading",
    Action.LOITER: "LOITER, else STEERING, else HOLD",
    Action.RTL: "RTL, else LOITER, else STEERING, else HOLD",
    Action.HOLD_THEN_AMIDSHIPS: "hold the last rudder for CTL_HOLD_S, then amidships",
    Action.NEXT_SOURCE: "steer by the next heading source, at last by course over ground",
    Action.NOT_BELIEVED: "go on from the place believed before",
    Action.EASE: "stop pulling, try again every 10 s",
    Action.SET_UP_AGAIN: "set the servo up again, then steer on",
    Action.POINT_INTO_IT: "point into the current",
    Action.KEEP_STATION: "keep station where she is",
}

# The modes that an action tries, best first.
LADDERS: Mapping[Action, tuple[Mode, ...]] = {
    Action.RTL: (Mode.RTL, Mode.LOITER, Mode.STEERING, Mode.HOLD),
    Action.LOITER: (Mode.LOITER, Mode.STEERING, Mode.HOLD),
    Action.KEEP_HEADING: (Mode.STEERING, Mode.HOLD),
    Action.AMIDSHIPS: (Mode.HOLD,),
}


@dataclass(frozen=True, slots=True)
class FaultRow:
    """One fault: how long the condition must stand and be gone, how grave it is, what is done and said.

    `action` is done in any case; `parameter` names the one that chooses a mode to be entered beside.
    `arming` says why arming is refused while the fault is set, empty where it is not.
    """

    fault: Fault
    condition: str
    debounce_s: float
    clear_s: float
    severity: Severity
    action: Action
    parameter: str
    text: str
    recovery: str
    arming: str = ""
