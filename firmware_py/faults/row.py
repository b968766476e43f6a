"""Row of the table of faults: inputs of its condition, its action and its texts."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

import msgspec

from firmware_py.common.records import DeviceState, Severity


class Action(Enum):
    """Action while a fault is set, in addition to a mode that a failsafe chooses; the values are texts of the page."""

    ALERT = "alert only (the boat reports it and continues its task)"
    HOLD_THEN_AMIDSHIPS = "hold the last rudder angle for CTL_HOLD_S, then centre the rudder"
    NEXT_SOURCE = "use the next heading source, course over ground last"
    REJECT_FIX = "continue from the last accepted position"
    DEAD_RECKONING = "dead reckoning; keep station once the position error exceeds POS_RECKON_M"
    RELIEVE_SERVO = "stop driving the rudder, retry every 10 s"  # the command follows the measured angle
    CONFIGURE_SERVO = "configure the servo again, then continue"  # done by the driver
    POINT_INTO_CURRENT = "outside the loiter circle, point into the current"
    REDUCE_GAIN = "reduce the gain; full gain returns over tens of minutes"
    FIXED_GAIN_OBSERVER = "use the fixed-gain observer with CTL_K1 and CTL_K2 until the estimate is consistent again"
    KEEP_STATION = "keep station at the present position"
    SAVE_POWER = "save power: lower link rates, slower loop, less rudder travel (PWR_...)"
    STEP_ASIDE = "keep clear of the vessel if AIS_ACT is set"


class FaultInput(msgspec.Struct, frozen=True):
    """Inputs of the conditions in a tick.

    `faults` are those set in the last tick, as bits. `..._old`: the timeout has elapsed; for heading and servo also
    without any data since the start, for a position then only if it is needed. An age is None if the event has never
    happened. `supply_v` is measured at the servo. Charges are 0 to 1; `save_...` are the limits of BATTERY_LOW and
    `keep_...` those of BATTERY_CRITICAL. `depth_m` is that below the surface, `wind_m_s` a mean. None: not known.
    """

    faults: int
    late_age_s: float | None  # since the last skipped deadline
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
    depth_m: float | None
    depth_min_m: float
    wind_m_s: float | None
    wind_max_m_s: float

    def is_set(self, fault: int) -> bool:
        """Return whether a fault was set in the last tick."""
        return bool(self.faults >> fault & 1)


def exceeds(value: float | None, limit: float) -> bool:
    """Return whether a value is known and greater than a limit."""
    return value is not None and value > limit


def has_happened_within(age_s: float | None, max_age_s: float) -> bool:
    """Return whether an event has happened within the last max_age_s."""
    return age_s is not None and age_s <= max_age_s


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """One fault: condition, debounce time and clear time, severity, action and texts.

    `condition` describes `is_present` in words. `parameter` names the parameter that chooses a mode to enter as well
    (in MANUAL only with `acts_in_manual`). `always_resumes`: the interrupted mode resumes after the fault even without
    FS_RESUME. `arming_refusal` is the reason for which arming is refused; empty: it is not.
    """

    condition: str
    is_present: Callable[[FaultInput], bool]
    debounce_s: float = 0.0
    clear_s: float = 0.0
    severity: Severity
    action: Action = Action.ALERT
    parameter: str = ""
    acts_in_manual: bool = False
    always_resumes: bool = False
    text: str
    recovery: str
    arming_refusal: str = ""
    remedy: str
