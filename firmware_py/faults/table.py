"""Table of faults: condition, debounce time, severity, action, parameter, texts and remedy of each.

core/fault_conditions.py fills the FaultInput of a tick, latch.py applies debounce and clear times, and
safety/failsafe.py and the modules of the actions execute the actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_py.common.records import DeviceState, Severity
from firmware_py.faults.fault import Fault
from firmware_py.faults.row import Action, FaultInput, FaultRow, exceeds, has_happened_within

LATE_MEMORY_S: Final = 2.0
RESTART_MEMORY_S: Final = 5.0
# Hysteresis of the limits.
TEMPERATURE_MARGIN_C: Final = 5.0
VOLTAGE_MARGIN_FACTOR: Final = 1.03
CHARGE_MARGIN: Final = 0.05
DEPTH_MARGIN_FACTOR: Final = 1.1
WIND_MARGIN_FACTOR: Final = 0.9

__all__ = ["PRECEDENCE", "TABLE", "Fault"]


def is_servo_hot(tick: FaultInput) -> bool:
    """Return whether the servo temperature exceeds its limit."""
    margin_c = TEMPERATURE_MARGIN_C if tick.is_set(Fault.RUDDER_HOT) else 0.0
    return exceeds(tick.servo_temperature_c, tick.servo_hot_c - margin_c)


def is_supply_low(tick: FaultInput) -> bool:
    """Return whether the supply voltage at the servo is below its limit."""
    factor = VOLTAGE_MARGIN_FACTOR if tick.is_set(Fault.SUPPLY_LOW) else 1.0
    return tick.supply_v is not None and tick.supply_v < tick.supply_low_v * factor


def is_storage_full(tick: FaultInput) -> bool:
    """Return whether the disk is full; while the disk fails, the last result is kept."""
    return tick.storage is DeviceState.FULL or (tick.storage is DeviceState.FAULTY and tick.is_set(Fault.STORAGE_FULL))


def is_battery_below(tick: FaultInput, fault: Fault, min_charge: float, min_v: float) -> bool:
    """Return whether charge or voltage of the battery is below its limit (0: no limit).

    While neither is known, the last result is kept.
    """
    was_below = tick.is_set(fault)
    results = []
    if min_charge > 0.0 and tick.battery_charge is not None:
        results.append(tick.battery_charge < min_charge + (CHARGE_MARGIN if was_below else 0.0))
    if min_v > 0.0 and tick.battery_v is not None:
        results.append(tick.battery_v < min_v * (VOLTAGE_MARGIN_FACTOR if was_below else 1.0))
    if results:
        return any(results)
    return was_below and (min_charge > 0.0 or min_v > 0.0)


def is_water_shallow(tick: FaultInput) -> bool:
    """Return whether the water is shallower than its limit (0: no limit); without a depth, the last result is kept."""
    was_shallow = tick.is_set(Fault.WATER_SHALLOW)
    if tick.depth_m is None:
        return was_shallow and tick.depth_min_m > 0.0
    return tick.depth_m < tick.depth_min_m * (DEPTH_MARGIN_FACTOR if was_shallow else 1.0)


def is_wind_strong(tick: FaultInput) -> bool:
    """Return whether the mean wind exceeds its limit (0: no limit); without a wind, the last result is kept."""
    was_strong = tick.is_set(Fault.WIND_STRONG)
    if not tick.wind_max_m_s > 0.0:
        return False
    if tick.wind_m_s is None:
        return was_strong
    return tick.wind_m_s > tick.wind_max_m_s * (WIND_MARGIN_FACTOR if was_strong else 1.0)


# In the order of the fault numbers.
TABLE: Mapping[Fault, FaultRow] = {
    Fault.COMPASS_LOST: FaultRow(
        condition="no valid heading from any source for CMP_TIMEOUT_S (longer for a source with a low rate)",
        is_present=lambda tick: tick.heading_old,
        severity=Severity.CRITICAL,
        action=Action.HOLD_THEN_AMIDSHIPS,
        text="No valid heading: rudder held, then centred",
        recovery="Heading recovered",
        arming_refusal="no valid heading",
        remedy="from shore: nothing steers the boat until a heading returns; with a GPS fix and way its course over "
        "ground is one. Plan its recovery. At the boat: check power and cable of the compass; a second compass "
        "avoids this fault",
    ),
    Fault.POSITION_LOST: FaultRow(
        condition="no accepted fix for POS_TIMEOUT_S after an earlier one (longer for a receiver with a low rate), or "
        "no fix in the 3 min since the start while armed in a mode that needs a position",
        is_present=lambda tick: tick.position_old,
        debounce_s=2.0,
        severity=Severity.WARNING,
        action=Action.DEAD_RECKONING,
        parameter="FS_POS_ACT",
        text="GPS position lost",
        recovery="GPS position recovered",
        remedy="from shore: nothing for hours, the boat uses dead reckoning; near danger, send a heading (STEERING, "
        "GUIDED). At the boat: check the antenna, its view of the sky and its plug for water",
    ),
    Fault.RUDDER_SILENT: FaultRow(
        condition="no response from the servo for RUD_TIMEOUT_S (longer if it is polled at a low rate)",
        is_present=lambda tick: tick.servo_old,
        debounce_s=0.1,  # after a pause of the process the servo has not been polled, either
        severity=Severity.CRITICAL,
        parameter="FS_RUD_ACT",
        text="Rudder servo not responding",
        recovery="Rudder servo responding again",
        arming_refusal="rudder servo not responding",
        remedy="from shore: do not disarm, because arming is refused meanwhile; no mode can steer without the servo, "
        "so plan the recovery of the boat. At the boat: check power and cable of the servo, its id and baud "
        "rate",
    ),
    Fault.RUDDER_ERROR: FaultRow(
        condition="the servo reports a hardware error, or does not accept or keep its settings",
        is_present=lambda tick: tick.servo_error,
        debounce_s=0.3,
        clear_s=1.0,  # a setting that was refused is sent again at intervals
        severity=Severity.ERROR,
        parameter="FS_RUD_ACT",
        text="Rudder servo reports an error",
        recovery="Rudder servo error cleared",
        arming_refusal="rudder servo reports an error",
        remedy="from shore: HOLD for some minutes, armed (arming is refused meanwhile), then choose the mode again. "
        "At the boat: `rambler status` shows the error; let the servo cool, free the rudder, switch the servo "
        "off and on",
    ),
    Fault.LOOP_LATE: FaultRow(
        condition="the control loop skipped deadlines within the last 2 s",
        is_present=lambda tick: has_happened_within(tick.late_age_s, LATE_MEMORY_S),
        severity=Severity.WARNING,
        text="Control loop late: deadlines skipped",
        recovery="Control loop on time again",
        remedy="from shore: nothing if it clears. At the boat: stop other programs on the computer, or install the "
        "autopilot as a service with real-time priority",
    ),
    Fault.STORAGE_FAILING: FaultRow(
        condition="logs or settings cannot be written",
        is_present=lambda tick: tick.storage is DeviceState.FAULTY,
        debounce_s=2.0,
        clear_s=5.0,  # writing is tried again at intervals, without an error in between
        severity=Severity.WARNING,
        text="Storage error: logs or settings not saved",
        recovery="Storage error cleared",
        remedy="from shore: nothing, steering continues; what you set may be lost at a restart. At the boat: fetch "
        "the logs; the disk fails, is read-only or out of inodes (`df -i`)",
    ),
    Fault.CURRENT_STRONG: FaultRow(
        condition="the current exceeds the speed through the water by its standard deviation, for 2 min",
        is_present=lambda tick: tick.current_too_strong,
        severity=Severity.WARNING,
        action=Action.POINT_INTO_CURRENT,
        text="Current too strong: position cannot be held",
        recovery="Current no longer too strong",
        remedy="from shore: wait for the tide, or send the boat to a place with a weaker current. LOITER: outside "
        "its circle the boat points into the current and drifts slowly. AUTO, RTL, GUIDED: it steers for the "
        "smallest loss; a waypoint that it is carried past does not count as reached. Afterwards the task "
        "continues by itself",
    ),
    Fault.MISSION_UNUSABLE: FaultRow(
        condition="armed in AUTO without a mission, or the jumps of the mission lead to no waypoint",
        is_present=lambda tick: tick.mission_unusable,
        severity=Severity.WARNING,
        action=Action.KEEP_STATION,
        text="Mission unusable: keeping station",
        recovery="Mission problem cleared",
        remedy="from shore: upload a mission, or correct its DO_JUMP items; by satellite: a position or RTL",
    ),
    Fault.FENCE_BREACHED: FaultRow(
        condition="the fence is enabled and the boat is outside",
        is_present=lambda tick: tick.outside_fence,
        debounce_s=1.0,
        clear_s=5.0,
        severity=Severity.ERROR,
        parameter="FS_FENCE_ACT",
        text="Fence breached",
        recovery="Fence breach cleared",
        arming_refusal="outside the fence",
        remedy="from shore: wait while `FS_FENCE_ACT` brings the boat back, or send it a position inside; if the "
        "fence is wrong, correct it; `FENCE_ENABLE` 0 disables it",
    ),
    Fault.COMPASS_SILENT: FaultRow(
        condition="no heading from a compass for CMP_TIMEOUT_S after earlier ones (longer for one with a low rate)",
        is_present=lambda tick: tick.compass_silent,
        debounce_s=0.5,
        clear_s=1.0,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass: no data",
        recovery="Compass: data recovered",
        remedy="from shore: nothing, the next heading source is used (text `Heading source: ...`). At the boat: "
        "check power and cable of the compass named. Without that text the second one is silent, which may be a "
        "gyroscope: `rambler status` names it",
    ),
    Fault.COMPASS_FROZEN: FaultRow(
        condition="the reading of a compass does not change though rudder, waves, the other compass or the track show "
        "that the boat turns",
        is_present=lambda tick: tick.compass_frozen,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass frozen: not used",
        recovery="Compass no longer frozen",
        arming_refusal="compass frozen",
        remedy="from shore: nothing, the next heading source is used. At the boat: switch the compass off and on; "
        "the reading of a simulated compass may stand still: `CMP_FROZEN_S`",
    ),
    Fault.COMPASS_JUMPING: FaultRow(
        condition="for 1.5 s a compass has shown headings that the boat cannot have turned to",
        is_present=lambda tick: tick.compass_jumping,
        clear_s=5.0,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass heading jumped: not used",
        recovery="Compass heading plausible again",
        arming_refusal="compass heading jumped",
        remedy="from shore: nothing, the next heading source is used. At the boat: look for moving magnetic objects "
        "near the compass and for a bad cable; see its headings in the log",
    ),
    Fault.COMPASS_DISAGREES: FaultRow(
        condition="the headings of two working compasses differ by more than 15 deg",
        is_present=lambda tick: tick.compasses_disagree,
        debounce_s=5.0,
        clear_s=5.0,
        severity=Severity.WARNING,
        text="Compasses disagree",
        recovery="Compasses agree again",
        arming_refusal="compasses disagree",
        remedy="from shore: the course over ground shows which one is right. At the boat: calibrate both (deviation, "
        "mounting)",
    ),
    Fault.POSITION_JUMPING: FaultRow(
        condition="fixes are farther away than the boat can have sailed and are rejected, for at most POS_JUMP_S",
        is_present=lambda tick: tick.position_held_back,
        debounce_s=2.5,
        clear_s=2.5,
        severity=Severity.WARNING,
        action=Action.REJECT_FIX,
        text="GPS position jumped: not used",
        recovery="GPS position plausible again",
        remedy="from shore: wait, for at most `POS_JUMP_S`; if the boat was moved, the fault clears by itself. Else: "
        "spoofing, reflections or a bad antenna",
    ),
    Fault.RUDDER_ASTRAY: FaultRow(
        condition="the rudder moves, but for 1.5 s not towards a command that is more than 3 deg away",
        is_present=lambda tick: tick.rudder_astray,
        debounce_s=1.0,
        clear_s=1.0,
        severity=Severity.ERROR,
        parameter="FS_RUD_ACT",
        text="Rudder does not follow its command",
        recovery="Rudder follows its command again",
        arming_refusal="rudder does not follow its command",
        remedy="from shore: MANUAL to both sides, and watch the rudder angle. At the boat: check `RUD_REVERSE`, the "
        "screw of the servo horn and growth on the blade",
    ),
    Fault.RUDDER_JAMMED: FaultRow(
        condition="the rudder has not moved for 1.5 s though its command is more than 3 deg away",
        is_present=lambda tick: tick.rudder_jammed,
        severity=Severity.CRITICAL,
        action=Action.RELIEVE_SERVO,
        parameter="FS_RUD_ACT",
        text="Rudder jammed: not driven, retry every 10 s",
        recovery="Rudder no longer jammed",
        arming_refusal="rudder jammed",
        remedy="from shore: move the rudder to and fro in MANUAL, which may free it. At the boat: a line or weed in "
        "the rudder",
    ),
    Fault.RUDDER_HOT: FaultRow(
        condition="the servo temperature exceeds RUD_TEMP_MAX (clears 5 deg below it)",
        is_present=is_servo_hot,
        debounce_s=2.0,
        clear_s=2.0,
        severity=Severity.WARNING,
        parameter="FS_RUD_ACT",
        text="Rudder servo too hot",
        recovery="Rudder servo temperature normal",
        arming_refusal="rudder servo too hot",
        remedy="from shore: HOLD lets it cool, armed (arming is refused meanwhile); raise `CTL_PRICE` for less "
        "rudder travel. At the boat: look for friction",
    ),
    Fault.RUDDER_OVERLOADED: FaultRow(
        condition="the servo current has exceeded RUD_AMP_MAX for 2 s",
        is_present=lambda tick: tick.rudder_overloaded,
        severity=Severity.ERROR,
        action=Action.RELIEVE_SERVO,
        parameter="FS_RUD_ACT",
        text="Rudder servo overcurrent: not driven",
        recovery="Rudder servo current normal",
        remedy="from shore: as for RUDDER_JAMMED. At the boat: something blocks the rudder",
    ),
    Fault.RUDDER_REPOWERED: FaultRow(
        condition="the servo restarted by itself within the last 5 s",
        is_present=lambda tick: has_happened_within(tick.servo_restart_age_s, RESTART_MEMORY_S),
        severity=Severity.WARNING,
        action=Action.CONFIGURE_SERVO,
        text="Rudder servo lost power: configured again",
        recovery="Rudder servo power stable again",
        remedy="from shore: nothing once; often: use less rudder (`CTL_PRICE`). At the boat: the supply of the servo "
        "was interrupted: check plug, fuse and cable cross-section",
    ),
    Fault.SUPPLY_LOW: FaultRow(
        condition="the supply voltage, measured by the servo, is below BAT_LOW_VOLT (clears 3 % above it)",
        is_present=is_supply_low,
        debounce_s=5.0,
        clear_s=10.0,
        severity=Severity.ERROR,
        parameter="FS_VOLT_ACT",
        text="Supply voltage low",
        recovery="Supply voltage normal",
        arming_refusal="supply voltage low",
        remedy="from shore: save power (telemetry rates, `PWR_...`) and bring the boat home. At the boat: check "
        "battery and cable. It is measured at the servo; BATTERY_LOW and BATTERY_CRITICAL need a battery "
        "monitor. `BAT_LOW_VOLT` is 0, never, by default",
    ),
    Fault.STORAGE_FULL: FaultRow(
        condition="less than LOG_FREE_MB free on the disk of the state directory; stays set while the disk fails",
        is_present=is_storage_full,
        debounce_s=2.0,
        clear_s=10.0,
        severity=Severity.WARNING,
        text="Storage full: logging will stop",
        recovery="Storage no longer full",
        remedy="from shore: nothing, steering continues. At the boat: old logs are deleted automatically, so other "
        "files fill the disk; fetch and delete them",
    ),
    Fault.CLOCK_STEPPED: FaultRow(
        condition="the system clock jumped by more than 2 s against the monotonic clock within the last 10 s",
        is_present=lambda tick: tick.clock is DeviceState.FAULTY,
        severity=Severity.NOTICE,
        text="System clock stepped: control not affected",
        recovery="System clock steady again",
        remedy="nothing; the times in the log jump here",
    ),
    Fault.STATION_SILENT: FaultRow(
        condition="no message from a ground station for FS_GCS_S after earlier ones",
        is_present=lambda tick: (
            tick.station is DeviceState.SILENT and exceeds(tick.station_age_s, tick.station_timeout_s)
        ),
        severity=Severity.WARNING,
        parameter="FS_GCS_ACT",
        acts_in_manual=True,
        text="Ground station link lost",
        recovery="Ground station link recovered",
        remedy="check radio, antenna and power of the ground station; `FS_GCS_ACT` chooses what the boat does "
        "meanwhile. Messages by satellite do not clear it",
    ),
    Fault.STEERING_LOST: FaultRow(
        condition="the boat turns by less than an eighth of the turn expected from its rudder, for 30 s or longer",
        is_present=lambda tick: tick.steering_lost,
        severity=Severity.ERROR,
        parameter="FS_STEER_ACT",
        text="Steering lost: no response to the rudder",
        recovery="Steering recovered",
        remedy="\n"
        "  1. In a calm, wait: the rudder acts only while the boat makes way\n"
        "  2. By radio: MANUAL, full rudder to each side for minutes. It clears when the boat turns with its rudder\n"
        "  3. No turn: blade or servo horn lost, or weed. The boat drifts with the current: plan its recovery\n"
        "  4. Disarming does not clear it",
    ),
    Fault.KEY_LOST: FaultRow(
        condition="a signing key was set and cannot be read: only trusted links are accepted",
        is_present=lambda tick: tick.key is DeviceState.FAULTY,
        severity=Severity.CRITICAL,
        text="Signing key lost: only trusted links accepted",
        recovery="Signing key problem cleared",
        remedy="from shore: only a trusted link can command the boat; signed stations and the satellite are refused. "
        "Set or remove the key over a trusted link; without one, nothing can be done from shore, and the "
        "boat continues its task. At the boat: `rambler key`",
    ),
    Fault.HELM_OSCILLATES: FaultRow(
        condition="limit cycle of heading and rudder",
        is_present=lambda tick: tick.oscillating,
        severity=Severity.WARNING,
        action=Action.REDUCE_GAIN,
        text="Heading oscillates: gain reduced",
        recovery="Heading oscillation ended",
        remedy="nothing; if it persists, from shore: raise `CTL_PRICE`; later identify the boat again",
    ),
    Fault.BATTERY_LOW: FaultRow(
        condition="the battery is below PWR_SAVE_PCT or PWR_SAVE_VOLT (clears 5 % of charge or 3 % of voltage above)",
        is_present=lambda tick: is_battery_below(tick, Fault.BATTERY_LOW, tick.save_charge, tick.save_v),
        debounce_s=30.0,
        clear_s=60.0,
        severity=Severity.WARNING,
        action=Action.SAVE_POWER,
        text="Battery low: power saving on",
        recovery="Battery no longer low: power saving off",
        remedy="from shore: expect 5 times fewer reports (`PWR_LNK_FACTOR`); reduce the load (payload, telemetry). "
        "The task continues. `PWR_SAVE_PCT` and `PWR_SAVE_VOLT` are 0, never, by default; see `rambler "
        "energy`",
    ),
    Fault.BATTERY_CRITICAL: FaultRow(
        condition="the battery is below PWR_KEEP_PCT or PWR_KEEP_VOLT (clears 5 % of charge or 3 % of voltage above)",
        is_present=lambda tick: is_battery_below(tick, Fault.BATTERY_CRITICAL, tick.keep_charge, tick.keep_v),
        debounce_s=30.0,
        clear_s=60.0,
        severity=Severity.ERROR,
        action=Action.SAVE_POWER,
        parameter="FS_BATT_ACT",
        always_resumes=True,
        text="Battery critical",
        recovery="Battery no longer critical",
        arming_refusal="battery critical",
        remedy="from shore: check where the present heading leads (`FS_BATT_ACT`, STEERING); any command overrules "
        "it. Else wait for the panels: the task continues by itself, and arming is refused until then, so do "
        "not disarm. `PWR_KEEP_PCT` and `PWR_KEEP_VOLT` are 0, never, by default",
    ),
    Fault.POWER_SILENT: FaultRow(
        condition="no message for 15 s from a power monitor that was received before",
        is_present=lambda tick: tick.power_silent,
        severity=Severity.WARNING,
        text="Power monitor: no data",
        recovery="Power monitor: data recovered",
        remedy="from shore: nothing; charge and voltage are unknown meanwhile. At the boat: check the cable of the "
        "charger or monitor",
    ),
    Fault.STEERING_REVERSED: FaultRow(
        condition="the boat turns against its rudder, for 30 s or longer",
        is_present=lambda tick: tick.steering_reversed,
        severity=Severity.CRITICAL,
        parameter="FS_STEER_ACT",
        text="Steering reversed: disarm, then change RUD_REVERSE",
        recovery="Steering no longer reversed",
        remedy="from shore: disarm, change `RUD_REVERSE` (0 to 1, or 1 to 0), arm again; if it was right before, "
        "servo or compass was mounted the other way round. If the rudder angle is estimated, the rudder may be jammed "
        "to one side instead: MANUAL to both sides shows it",
    ),
    Fault.VESSEL_NEAR: FaultRow(
        condition="a vessel will pass closer than AIS_NEAR_M (AIS_STILL_M if it is stationary) within AIS_NEAR_S",
        is_present=lambda tick: tick.vessel_near,
        clear_s=10.0,
        severity=Severity.WARNING,
        action=Action.STEP_ASIDE,
        text="Vessel approaching",
        recovery="No vessel approaching",
        remedy="see the vessel in the message before; call it, or let the boat keep clear (`AIS_ACT`)",
    ),
    Fault.ESTIMATE_INCONSISTENT: FaultRow(
        condition="the error of the heading predicted over 30 s far exceeds its standard deviation, for 5 min or more",
        is_present=lambda tick: tick.estimate_inconsistent,
        severity=Severity.WARNING,
        action=Action.FIXED_GAIN_OBSERVER,
        text="Heading estimate inconsistent: compass used",
        recovery="Heading estimate consistent again",
        remedy="from shore: nothing, the boat steers by the compass. Later: check `MDL_K` and `MDL_T_S` "
        "(`rambler-hil identify`), compass and rudder feedback",
    ),
    Fault.WATER_SHALLOW: FaultRow(
        condition="the water depth below the surface is less than DEPTH_MIN (clears 10 % above it)",
        is_present=is_water_shallow,
        debounce_s=10.0,
        clear_s=30.0,
        severity=Severity.ERROR,
        parameter="FS_DEPTH_ACT",
        text="Water shallow: depth below DEPTH_MIN",
        recovery="Water no longer shallow",
        remedy="from shore: compare position and chart, and send a heading into deep water; the heading that "
        "`FS_DEPTH_ACT` 2 keeps may lead aground. By default `DEPTH_MIN` is 0 and the fault is off. While the depth "
        "is unknown the fault stays set; `DEPTH_MIN` 0 clears it",
    ),
    Fault.WIND_STRONG: FaultRow(
        condition="the wind speed averaged over 2 min exceeds WIND_MAX (clears 10 % below it)",
        is_present=is_wind_strong,
        debounce_s=30.0,
        clear_s=60.0,
        severity=Severity.WARNING,
        parameter="FS_WIND_ACT",
        text="Wind strong: speed above WIND_MAX",
        recovery="Wind no longer strong",
        remedy="from shore: expect larger heading errors and leeway; choose a heading that the boat can hold. "
        "By default `WIND_MAX` is 0 and the fault is off. While the wind is unknown the fault stays set; `WIND_MAX` 0 "
        "clears it",
    ),
}

# Order in which faults choose a mode: by severity, then by number.
PRECEDENCE: Final = tuple(
    sorted((fault for fault, row in TABLE.items() if row.parameter), key=lambda fault: (TABLE[fault].severity, fault))
)
