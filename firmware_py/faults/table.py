"""The one table of faults: condition, debounce, severity, action, parameter and texts.

core/fault_conditions.py fills the FaultInput of a tick, latch.py judges the conditions over time,
safety/failsafe.py and the parts named by the action do what follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_py.common.records import DeviceState, Severity
from firmware_py.faults.conditions import servo_is_hot, storage_is_full, supply_is_low
from firmware_py.faults.fault import Fault
from firmware_py.faults.power_rows import POWER
from firmware_py.faults.row import Action, FaultRow, exceeds, within

LATE_MEMORY_S: Final = 2.0
RESTART_MEMORY_S: Final = 5.0

__all__ = ["PRECEDENCE", "TABLE", "Fault"]


# In the order of the numbers.
TABLE: Mapping[Fault, FaultRow] = {
    Fault.COMPASS_LOST: FaultRow(
        condition="no valid heading from any source for CMP_TIMEOUT_S (longer from one that speaks seldom)",
        stands=lambda tick: tick.heading_old,
        severity=Severity.CRITICAL,
        action=Action.HOLD_THEN_AMIDSHIPS,
        text="No heading: rudder held, then amidships",
        recovery="Heading is back",
        arming="no valid heading",
    ),
    Fault.POSITION_LOST: FaultRow(
        condition="a fix was there and no believed one has come for POS_TIMEOUT_S (longer if they come seldom); or "
        "armed in a mode that goes by places, and none in the 3 min since the start",
        stands=lambda tick: tick.position_old,
        debounce_s=2.0,
        severity=Severity.WARNING,
        action=Action.RECKON,
        parameter="FS_POS_ACT",
        text="Position lost",
        recovery="Position is back",
    ),
    Fault.RUDDER_SILENT: FaultRow(
        condition="the servo has not answered for RUD_TIMEOUT_S (longer if it is asked seldom)",
        stands=lambda tick: tick.servo_old,
        debounce_s=0.1,  # who was halted herself has not asked it meanwhile
        severity=Severity.CRITICAL,
        parameter="FS_RUD_ACT",
        text="Rudder servo does not answer",
        recovery="Rudder servo answers again",
        arming="rudder servo does not answer",
    ),
    Fault.RUDDER_ERROR: FaultRow(
        condition="the servo reports a hardware error, or does not keep or take what it is steered by",
        stands=lambda tick: tick.servo_error,
        debounce_s=0.3,
        clear_s=1.0,  # what it refuses it is asked for again now and then
        severity=Severity.ERROR,
        parameter="FS_RUD_ACT",
        text="Rudder servo reports an error",
        recovery="Rudder servo error has cleared",
        arming="rudder servo reports an error",
    ),
    Fault.LOOP_LATE: FaultRow(
        condition="deadlines were skipped within the last 2 s",
        stands=lambda tick: within(tick.late_age_s, LATE_MEMORY_S),
        severity=Severity.WARNING,
        text="Control loop is late",
        recovery="Control loop is in time again",
    ),
    Fault.STORAGE_FAILING: FaultRow(
        condition="the log or the store cannot be written",
        stands=lambda tick: tick.storage is DeviceState.FAULTY,
        debounce_s=2.0,
        clear_s=5.0,  # what could not be written is tried again now and then, and is well in between
        severity=Severity.WARNING,
        text="Storage fails: log or settings are not kept",
        recovery="Storage works again",
    ),
    Fault.CURRENT_STRONG: FaultRow(
        condition="the current is stronger than her speed through the water by its standard deviation, for 2 min",
        stands=lambda tick: tick.current_too_strong,
        severity=Severity.WARNING,
        action=Action.POINT_INTO_IT,
        text="Current stronger than she is: no place is held",
        recovery="Current is weaker than she is again",
    ),
    Fault.MISSION_UNUSABLE: FaultRow(
        condition="armed in AUTO without a mission, or its jumps lead nowhere",
        stands=lambda tick: tick.mission_unusable,
        severity=Severity.WARNING,
        action=Action.KEEP_STATION,
        text="Mission cannot be sailed: keeping station",
        recovery="Mission can be sailed, or need not be",
    ),
    Fault.FENCE_BREACHED: FaultRow(
        condition="the fence is enabled and she is outside it",
        stands=lambda tick: tick.outside_fence,
        debounce_s=1.0,
        clear_s=5.0,
        severity=Severity.ERROR,
        parameter="FS_FENCE_ACT",
        text="Fence breached",
        recovery="Inside the fence again",
        arming="outside the fence",
    ),
    Fault.COMPASS_SILENT: FaultRow(
        condition="a compass that was heard has sent no heading for CMP_TIMEOUT_S (longer if it speaks seldom)",
        stands=lambda tick: tick.compass_silent,
        debounce_s=0.5,
        clear_s=1.0,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass is silent",
        recovery="Compass speaks again",
    ),
    Fault.COMPASS_FROZEN: FaultRow(
        condition="a compass shows one number while the boat turns, by rudder, waves, the other compass or the track",
        stands=lambda tick: tick.compass_frozen,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass is frozen",
        recovery="Compass varies again",
        arming="compass is frozen",
    ),
    Fault.COMPASS_JUMPING: FaultRow(
        condition="a compass has shown for 1.5 s headings that she cannot have come to, and did not creep there",
        stands=lambda tick: tick.compass_jumping,
        clear_s=5.0,
        severity=Severity.ERROR,
        action=Action.NEXT_SOURCE,
        text="Compass jumps: not believed",
        recovery="Compass agrees again",
        arming="compass jumps",
    ),
    Fault.COMPASS_DISAGREES: FaultRow(
        condition="two compasses that measure differ by more than 15 deg",
        stands=lambda tick: tick.compasses_disagree,
        debounce_s=5.0,
        clear_s=5.0,
        severity=Severity.WARNING,
        text="Compasses disagree",
        recovery="Compasses agree again",
        arming="compasses disagree",
    ),
    Fault.POSITION_JUMPING: FaultRow(
        condition="fixes lie farther off than she can have sailed and are held back, for POS_JUMP_S at most",
        stands=lambda tick: tick.position_held_back,
        debounce_s=2.5,
        clear_s=2.5,
        severity=Severity.WARNING,
        action=Action.NOT_BELIEVED,
        text="Position jumps: not believed",
        recovery="Position is steady again",
    ),
    Fault.RUDDER_ASTRAY: FaultRow(
        condition="the rudder moves, but for 1.5 s not toward a command that is more than 3 deg away",
        stands=lambda tick: tick.rudder_astray,
        debounce_s=1.0,
        clear_s=1.0,
        severity=Severity.ERROR,
        parameter="FS_RUD_ACT",
        text="Rudder does not follow",
        recovery="Rudder follows again",
        arming="rudder does not follow",
    ),
    Fault.RUDDER_JAMMED: FaultRow(
        condition="the rudder has not moved for 1.5 s though its command is more than 3 deg away",
        stands=lambda tick: tick.rudder_jammed,
        severity=Severity.CRITICAL,
        action=Action.EASE,
        parameter="FS_RUD_ACT",
        text="Rudder jammed: motor eased, tried every 10 s",
        recovery="Rudder moves again",
        arming="rudder is jammed",
    ),
    Fault.RUDDER_HOT: FaultRow(
        condition="the servo is hotter than RUD_TEMP_MAX (until 5 deg below it)",
        stands=servo_is_hot,
        debounce_s=2.0,
        clear_s=2.0,
        severity=Severity.WARNING,
        parameter="FS_RUD_ACT",
        text="Rudder servo is hot",
        recovery="Rudder servo has cooled down",
        arming="rudder servo is hot",
    ),
    Fault.RUDDER_OVERLOADED: FaultRow(
        condition="the servo has drawn more than RUD_AMP_MAX for 2 s",
        stands=lambda tick: tick.rudder_overloaded,
        severity=Severity.ERROR,
        action=Action.EASE,
        parameter="FS_RUD_ACT",
        text="Rudder servo draws too much current: eased",
        recovery="Rudder servo current is normal again",
    ),
    Fault.RUDDER_REPOWERED: FaultRow(
        condition="the servo has come up anew by itself within the last 5 s",
        stands=lambda tick: within(tick.servo_restart_age_s, RESTART_MEMORY_S),
        severity=Severity.WARNING,
        action=Action.SET_UP_AGAIN,
        text="Rudder servo was without power: set up again",
        recovery="Rudder servo runs on",
    ),
    Fault.SUPPLY_LOW: FaultRow(
        condition="the supply, as the servo measures it, is below BAT_LOW_VOLT (until 3 % above it)",
        stands=supply_is_low,
        debounce_s=5.0,
        clear_s=10.0,
        severity=Severity.ERROR,
        parameter="FS_VOLT_ACT",
        text="Supply voltage is low",
        recovery="Supply voltage is right again",
        arming="supply voltage is low",
    ),
    Fault.STORAGE_FULL: FaultRow(
        condition="less than LOG_FREE_MB are free on the disk of the state directory; stays while that fails",
        stands=storage_is_full,
        debounce_s=2.0,
        clear_s=10.0,
        severity=Severity.WARNING,
        text="Storage is full: logs will end",
        recovery="Storage has room again",
    ),
    Fault.CLOCK_STEPPED: FaultRow(
        condition="the computer's clock has jumped by more than 2 s against the loop's within the last 10 s",
        stands=lambda tick: tick.clock is DeviceState.FAULTY,
        severity=Severity.NOTICE,
        text="System clock was stepped; the loop takes no notice",
        recovery="System clock runs on",
    ),
    Fault.STATION_SILENT: FaultRow(
        condition="a ground station was heard and none has been for FS_GCS_S",
        stands=lambda tick: tick.station is DeviceState.SILENT and exceeds(tick.station_age_s, tick.station_timeout_s),
        severity=Severity.WARNING,
        parameter="FS_GCS_ACT",
        in_manual=True,
        text="Ground station silent",
        recovery="Ground station is back",
    ),
    Fault.STEERING_LOST: FaultRow(
        condition="she turns less than an eighth of what her rudder should turn her, for half a minute and longer",
        stands=lambda tick: tick.steering_lost,
        severity=Severity.ERROR,
        parameter="FS_STEER_ACT",
        text="Rudder moves and she does not turn",
        recovery="She answers the rudder again",
    ),
    Fault.KEY_LOST: FaultRow(
        condition="a signing key was set and cannot be read: nobody is heard but over trusted links",
        stands=lambda tick: tick.key is DeviceState.FAULTY,
        severity=Severity.CRITICAL,
        text="Signing key lost: only trusted links are heard",
        recovery="Signing key is no longer lost",
    ),
    Fault.HELM_OSCILLATES: FaultRow(
        condition="heading and rudder swing to and fro by themselves: one swing that is plain, or several",
        stands=lambda tick: tick.oscillating,
        severity=Severity.WARNING,
        action=Action.SOFTER_HELM,
        text="Helm oscillates: it is softened",
        recovery="Helm oscillates no more",
    ),
    **POWER,
    Fault.STEERING_REVERSED: FaultRow(
        condition="her rudder is far over and she turns the other way, for half a minute and longer",
        stands=lambda tick: tick.steering_reversed,
        severity=Severity.CRITICAL,
        parameter="FS_STEER_ACT",
        text="She turns the wrong way: is RUD_REVERSE right?",
        recovery="She turns the right way",
    ),
    Fault.VESSEL_NEAR: FaultRow(
        condition="a vessel comes closer than AIS_NEAR_M (AIS_STILL_M if it lies still) within AIS_NEAR_S, until past",
        stands=lambda tick: tick.vessel_near,
        clear_s=10.0,
        severity=Severity.WARNING,
        action=Action.STEP_ASIDE,
        text="A vessel comes near",
        recovery="No vessel comes near any more",
    ),
    Fault.ESTIMATE_INCONSISTENT: FaultRow(
        condition="the heading predicted over 30 s misses by far more than the filter claims, over 5 min and longer",
        stands=lambda tick: tick.estimate_inconsistent,
        severity=Severity.WARNING,
        action=Action.SMOOTHED_COMPASS,
        text="Heading estimate inconsistent: compass is used",
        recovery="Heading estimate consistent again",
    ),
}

# Of the faults that choose a mode, who comes first where several stand: the graver, then the lower number.
PRECEDENCE: Final = tuple(
    sorted((fault for fault, row in TABLE.items() if row.parameter), key=lambda fault: (TABLE[fault].severity, fault))
)
