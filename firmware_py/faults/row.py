"""What a row of the table of faults is made of: what its condition looks at, what is done, and what is told."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

import msgspec

from firmware_py.common.records import DeviceState, Severity


class Action(Enum):
    """What is done while a fault stands, whatever mode is chosen beside it; the text is that of params/FAULTS.md."""

    ALERT = "alert only"  # tells the operator, goes on
    HOLD_THEN_AMIDSHIPS = "hold the last rudder for CTL_HOLD_S, then amidships"
    NEXT_SOURCE = "steer by the next heading source, at last by course over ground"
    NOT_BELIEVED = "go on from the place believed before"
    RECKON = "go on by a reckoned place, keep station when that is uncertain (POS_RECKON_M)"
    EASE = "stop pulling, try again every 10 s"  # the command follows the measured angle
    SET_UP_AGAIN = "set the servo up again, then steer on"  # the driver does it before it steers
    POINT_INTO_IT = "outside her watch circle point into the current"
    SOFTER_HELM = "a softer helm, which grows stiff again over tens of minutes"
    SMOOTHED_COMPASS = "steer by the smoothed compass with CTL_K1 and CTL_K2 until it is consistent again"
    KEEP_STATION = "keep station where she is"
    SAVE_POWER = "save power: quieter links, a slower loop, a dearer rudder (PWR_...)"
    STEP_ASIDE = "step aside while it comes, if AIS_ACT says so"


class FaultInput(msgspec.Struct, frozen=True):
    """What the conditions of a tick look at; whoever adds a fault adds here what nobody looked at before.

    `faults` are those that were set in the last tick, as bits. What is old is past its timeout:
    heading and servo count from the start while none has come, a position only where it is needed.
    An age is None for what has never happened.
    """

    faults: int
    late_age_s: float | None  # since deadlines were skipped
    heading_old: bool
    compass_silent: bool
    compass_frozen: bool
    compass_jumping: bool
    compasses_disagree: bool
    position_old: bool
    position_held_back: bool
    servo_old: bool
    servo_error: bool
    servo_temperature_c: float | None
    servo_hot_c: float
    servo_restart_age_s: float | None
    rudder_astray: bool
    rudder_jammed: bool
    rudder_overloaded: bool
    steering_lost: bool
    steering_reversed: bool
    oscillating: bool
    estimate_inconsistent: bool
    supply_v: float | None
    supply_low_v: float
    battery_charge: float | None
    battery_v: float | None
    save_charge: float
    save_v: float
    keep_charge: float
    keep_v: float
    power_silent: bool
    current_too_strong: bool
    mission_unusable: bool
    outside_fence: bool
    storage: DeviceState | None
    clock: DeviceState | None
    key: DeviceState | None
    station: DeviceState | None
    station_age_s: float | None
    station_timeout_s: float
    vessel_near: bool

    def is_set(self, fault: int) -> bool:
        """Whether a fault was set in the last tick."""
        return bool(self.faults >> fault & 1)


def exceeds(value: float | None, limit: float) -> bool:
    """Whether something is there and greater than a limit."""
    return value is not None and value > limit


def within(age_s: float | None, memory_s: float) -> bool:
    """Whether something has happened, and not longer ago than memory_s."""
    return age_s is not None and age_s <= memory_s


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """One fault: how long the condition must stand and be gone, how grave it is, what is done and said.

    `condition` says in words what `stands` judges. `action` is done in any case; `parameter` names
    the one that chooses a mode to be entered beside, in MANUAL too where `in_manual` says so.
    `resumes`: what a failsafe of it has interrupted goes on after it whatever FS_RESUME says.
    `arming` says why arming is refused while the fault is set, empty where it is not. `remedy` says what the operator
    can do.
    """

    condition: str
    stands: Callable[[FaultInput], bool]
    debounce_s: float = 0.0
    clear_s: float = 0.0
    severity: Severity
    action: Action = Action.ALERT
    parameter: str = ""
    in_manual: bool = False
    resumes: bool = False
    text: str
    recovery: str
    remedy: str
    arming: str = ""
