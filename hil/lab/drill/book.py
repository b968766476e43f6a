"""The drills: for each fault the injection, the expected message with its deadline, and the expected behaviour.

The messages are intentionally repeated here, because the harness does not read the firmware's table of faults.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from firmware_py.common.angles import radians
from hil.lab.drill.checks import (
    Check,
    all_of,
    behaves_as_before,
    has_mode,
    has_torque_off,
    is_also_reported,
    is_centred,
    is_on_course,
    operator_can_override,
    reaches_heading,
    stays_active,
    was_centred_at_end,
)
from hil.lab.drill.injection import (
    Change,
    assign,
    combined,
    damage_bytes,
    do_nothing,
    end_and_start,
    in_sequence,
    kill_and_start,
    mission_clear_all,
    remove_logs,
    silence_heading_sources,
    turn_by_wave,
    write_fence_plan,
    write_legs_plan,
    write_loiter_plan,
)
from hil.ship.scenarios import Scenario, with_disturbances
from hil.sim.ground_station import GUIDED

LOITER, AUTO = 5, 10  # mode numbers of ArduPilot Rover
YEAR_S = 365.0 * 86400.0
AUTO_RESUME = {"FS_RESUME": 1.0}
ELECTRICAL_SHOCK = 0x10  # bit of the Dynamixel's hardware error status
BATTERY_LIMITS = {"PWR_SAVE_PCT": 30.0, "PWR_KEEP_PCT": 10.0}


@dataclass(frozen=True, slots=True)
class Drill:
    """A fault and the expected response.

    Attributes:
        text, recovery: beginnings of the messages when the fault starts and when it ends; empty: none is expected.
        inject, remove: functions that cause the fault and that end it.
        report_s: maximum time from the injection to `text`.
        clear_s: maximum time from the removal to `recovery`; 0 if the condition does not end within the drill.
        active_s: duration of the fault.
        check, check_after: checks during the fault and after its end (default: same behaviour as before the fault).
        also: beginnings of other messages that the fault explains; an empty text explains every message.
        moment: the only situation of this drill; empty for all situations.
        can_pair: whether the drill can be combined with another one.
        mode, settings, fitted: mode, parameters and additional devices of the boat from the start.
        plan: writes a plan into a directory and returns its path, for a boat that has a plan.
        sea: returns the changed scenario.
    """

    name: str
    text: str
    recovery: str
    inject: Change
    remove: Change
    report_s: float
    clear_s: float
    active_s: float = 5.0
    check: Check = lambda _boat, _at_s: ""
    also: tuple[str, ...] = ()
    moment: str = ""
    can_pair: bool = False
    mode: int = GUIDED
    settings: dict[str, float] | None = None
    fitted: tuple[str, ...] = ()
    plan: Callable[[Path], Path] | None = None
    sea: Callable[[Scenario], Scenario] = lambda scenario: scenario
    check_after: Check = behaves_as_before


BOOK: tuple[Drill, ...] = (
    Drill(
        "no heading", "No valid heading", "Heading recovered", silence_heading_sources(True),
        silence_heading_sources(False),
        15.0, 70.0, 32.0, is_centred, ("Compass: no data", "GPS position lost", "Heading source", "Heading lost"),
        settings={"CTL_HOLD_S": 5.0},
    ),
    Drill(
        "compass silent", "Compass: no data", "Compass: data recovered", assign("compass.silent", True),
        assign("compass.silent", False), 2.0, 4.0, 30.0, is_on_course,
        ("Heading source", "Compass heading jumped"), can_pair=True,
    ),
    Drill(
        "compass frozen", "Compass frozen: not used", "Compass no longer frozen", assign("compass.frozen", True),
        assign("compass.frozen", False), 32.0, 5.0, 5.0, is_on_course,
        ("Heading source", "Compass heading jumped"), can_pair=True,
    ),
    Drill(
        "compass turned by 180 deg", "Compass heading jumped", "Compass heading plausible again",
        assign("attitude.error_rad", radians(180.0)), assign("attitude.error_rad", 0.0), 4.0, 70.0, 20.0, is_on_course,
        ("Heading source", "Heading estimate", "No valid heading"),
    ),
    Drill(
        "turned by a breaking wave", "Compass heading jumped", "Compass heading plausible again",
        turn_by_wave(radians(90.0), 1.5), do_nothing, 4.0, 12.0, 4.0, is_on_course,
        ("Heading source", "Heading estimate", "No valid heading"),
    ),
    Drill(
        "turned by a breaking wave without a receiver", "Compass heading jumped", "Compass heading plausible again",
        combined(assign("receiver.fix", False), turn_by_wave(radians(-90.0), 1.5)), assign("receiver.fix", True),
        4.0, 12.0, 4.0, is_on_course, ("Heading", "No valid heading", "GPS position lost"),
    ),
    Drill(
        "compasses disagree", "Compasses disagree", "Compasses agree again",
        assign("attitude_b.error_rad", radians(18.0)), assign("attitude_b.error_rad", 0.0), 30.0, 30.0, 5.0,
        is_on_course, ("Heading estimate",),  # in a turn the other compass may be frozen
        fitted=("compass_b",), can_pair=True,
    ),
    Drill(
        "compass loses and flips bytes", "", "", lambda boat: damage_bytes(boat, 0.02),
        lambda boat: damage_bytes(boat, 0.0),
        0.0, 0.0, 60.0, is_on_course, ("Compass", "Heading source"), can_pair=True,
    ),
    Drill(
        "position lost", "GPS position lost", "GPS position recovered", assign("receiver.fix", False),
        assign("receiver.fix", True), 9.0, 6.0, 20.0, is_on_course, can_pair=True,
    ),
    Drill(
        "position lost while keeping station", "GPS position lost", "GPS position recovered",
        assign("receiver.fix", False), assign("receiver.fix", True), 9.0, 6.0, 3.0, has_mode("STEERING"),
        ("Failsafe", "Mode"), "straight", mode=LOITER, settings=AUTO_RESUME | {"FS_POS_ACT": 2.0},
    ),
    Drill(
        "position jumps", "GPS position jumped", "GPS position plausible again", assign("whereabouts.north_m", 1e4),
        assign("whereabouts.north_m", 0.0), 5.0, 8.0, 20.0, is_on_course,
        also=("GPS position lost", "Position believed", "First position"), can_pair=True,
    ),
    Drill(
        "servo's cable out", "Rudder servo not responding", "Rudder servo responding again",
        lambda boat: boat.unplug("rudder"), lambda boat: boat.plug("rudder"), 1.5, 5.0, 3.0,
        also=("Rudder",), can_pair=True,
    ),
    Drill(
        "servo's hardware error", "Rudder servo reports an error", "Rudder servo error cleared",
        lambda boat: boat.servo.inject_error(ELECTRICAL_SHOCK), do_nothing, 1.5, 9.0, 0.5,
        also=("Rudder",), can_pair=True,
    ),
    Drill(
        "rudder jammed", "Rudder jammed", "Rudder no longer jammed", lambda boat: boat.world.jam(radians(-20.0)),
        lambda boat: boat.world.free(), 30.0, 13.0, 5.0, has_torque_off("Rudder jammed"), ("Rudder",),
    ),
    Drill(
        "servo hot", "Rudder servo too hot", "Rudder servo temperature normal",
        assign("servo.motor.temperature_c", 75.0),
        assign("servo.motor.temperature_c", 60.0), 4.0, 4.0, 2.0,
        all_of(
            has_mode("HOLD"),
            stays_active("Rudder servo has cooled", assign("servo.motor.temperature_c", 67.0), 5.0),
        ),
        ("Failsafe", "Mode"),
        settings=AUTO_RESUME | {"FS_RUD_ACT": 1.0},
    ),
    Drill(
        "servo overloaded", "Rudder servo overcurrent", "Rudder servo current normal",
        assign("servo.motor.load_a", 4.0),
        assign("servo.motor.load_a", 0.0), 4.0, 14.0, 2.0, has_torque_off("Rudder servo draws"), can_pair=True,
    ),
    Drill(
        "servo's power cut", "Rudder servo lost power", "Rudder servo power stable again",
        lambda boat: boat.servo.power_cycle(
            boat.now_s, off_s=2.0
        ), do_nothing, 6.0, 9.0, 0.5, also=("Rudder",), can_pair=True,
    ),
    Drill(
        "supply low", "Supply voltage low", "Supply voltage normal", assign("servo.motor.voltage_v", 10.5),
        assign("servo.motor.voltage_v", 12.0), 7.0, 12.0, 1.0,
        all_of(has_mode("RTL"), stays_active("Supply voltage normal", assign("servo.motor.voltage_v", 11.2), 13.0),
            stays_active("Supply voltage normal", assign("servo.motor.voltage_v", 12.0), 6.0)),
        ("Failsafe", "Mode", "Return"),
        settings=AUTO_RESUME | {"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0},
    ),
    Drill(
        "battery low", "Battery low", "Battery no longer low", assign("plant.charge", 0.25),
        assign("plant.charge", 0.5), 36.0, 66.0,
        5.0, all_of(is_on_course, stays_active("Battery no longer low", assign("plant.charge", 0.33), 70.0)), (),
        fitted=("supply",), settings=BATTERY_LIMITS, can_pair=True,
    ),
    Drill(
        "battery nearly empty", "Battery critical", "Battery no longer critical",
        assign("plant.charge", 0.05), assign("plant.charge", 0.5), 36.0, 66.0,
        33.0, has_mode("STEERING"), ("Failsafe", "Battery low"), "straight",
        fitted=("supply",), settings=BATTERY_LIMITS | AUTO_RESUME,
    ),
    Drill(
        "power monitor silent", "Power monitor: no data", "Power monitor: data recovered",
        assign("monitor.silent", True),
        assign("monitor.silent", False), 18.0, 5.0, 2.0, is_on_course, ("Battery",), fitted=("supply",), can_pair=True,
    ),
    Drill(
        "shallow water", "Water shallow", "Water no longer shallow", assign("world.start_depth_m", 15.0),
        assign("world.start_depth_m", 30.0), 14.0, 34.0, 3.0,
        all_of(has_mode("STEERING"),
            stays_active("Water no longer shallow", assign("world.start_depth_m", 21.0), 40.0)),
        ("Failsafe", "Mode"), "straight", fitted=("instruments",),
        settings=AUTO_RESUME | {"DEPTH_MIN": 20.0, "FS_DEPTH_ACT": 2.0},
    ),
    Drill(
        "strong wind", "Wind strong", "Wind no longer strong", assign("world.wind_m_s", 25.0),
        assign("world.wind_m_s", 5.0), 100.0, 190.0, 3.0, has_mode("STEERING"), ("Failsafe", "Mode"), "straight",
        fitted=("instruments",), settings=AUTO_RESUME | {"WIND_MAX": 15.0, "FS_WIND_ACT": 2.0},
    ),
    Drill(
        "computer busy for half a second", "Control loop late: deadlines skipped", "Control loop on time again",
        lambda boat: boat.server.stall(0.5), do_nothing, 2.0, 4.0, 0.1, can_pair=True,
    ),
    Drill(
        "clock stepped by a year", "System clock stepped", "System clock steady again",
        lambda boat: boat.server.step_utc(YEAR_S), do_nothing, 2.0, 12.0, 5.0,
        is_on_course, can_pair=True,
    ),
    Drill(
        "station silent", "Ground station link lost", "Ground station link recovered",
        assign("station.is_silent", True), assign("station.is_silent", False),
        12.0, 4.0, 3.0, has_mode("LOITER"), ("Failsafe", "Mode"),
        settings=AUTO_RESUME | {"FS_GCS_S": 10.0, "FS_GCS_ACT": 3.0},
    ),
    Drill(
        "killed", "", "", kill_and_start, do_nothing, 0.0, 0.0, 10.0, is_on_course, ("",),
        settings={"BOOT_RESUME": 2.0},
    ),
    Drill(
        "outside the fence", "Fence breached", "Fence breach cleared", do_nothing, do_nothing, 60.0, 240.0, 3.0,
        has_mode("RTL"),
        ("Failsafe", "Mode", "Return"), "straight", settings={"FENCE_ENABLE": 1.0}, plan=write_fence_plan,
        sea=lambda scenario: replace(scenario, speed_m_s=0.8), check_after=has_mode("RTL"),
    ),
    Drill(
        "rudder blade lost", "Steering lost: no response to the rudder", "", assign("world.rudder_effect", 0.0),
        assign("world.rudder_effect", 1.0),
        150.0, 0.0, 1.0, also=("Steering reversed", "Rudder hard over"), moment="turning",
    ),
    Drill(
        "servo the wrong way round", "Steering reversed", "", assign("world.rudder_effect", -1.0),
        assign("world.rudder_effect", 1.0),
        180.0, 0.0, 1.0, also=("Rudder moves", "Rudder hard over"), moment="turning",
    ),
    Drill(
        "ship slower to turn than its model", "Heading oscillates", "", do_nothing, do_nothing, 300.0, 0.0, 1.0,
        moment="turning",
        sea=lambda scenario: with_disturbances(scenario, "kt=1:3,delay=8"),
    ),
    Drill(
        "mission cleared while it is sailed", "Mission unusable", "Mission problem cleared",
        lambda boat: boat.station.queue(mission_clear_all()), lambda boat: boat.set_mode(GUIDED), 4.0, 4.0, 2.0,
        has_mode("AUTO"), ("Mission",), "straight", mode=AUTO, plan=write_loiter_plan, check_after=has_mode("GUIDED"),
    ),
    Drill(
        "current stronger than the boat", "Current too strong", "", lambda boat: boat.set_mode(LOITER),
        do_nothing, 1800.0, 0.0, 60.0, also=("Failsafe",), moment="straight",
        sea=lambda scenario: replace(scenario, current_m_s=0.48, current_toward_deg=90.0),
    ),
    Drill(
        "logs gone", "Storage error: logs", "Storage error cleared", remove_logs,
        lambda boat: (boat.state / "logs").unlink(), 60.0, 60.0, 2.0, is_on_course, ("Log",), "straight",
    ),
    Drill(
        "first of two compasses silent", "Compass: no data", "Compass: data recovered", assign("compass.silent", True),
        assign("compass.silent", False), 2.0, 4.0, 30.0,
        all_of(is_on_course, is_also_reported("Heading source: compass B")),
        ("Heading source",), "turning", fitted=("compass_b",),
    ),
    Drill(
        "position lost on a mission", "GPS position lost", "GPS position recovered",
        assign("receiver.fix", False), assign("receiver.fix", True), 9.0, 6.0, 3.0, reaches_heading(90.0, 180.0),
        (), "straight", mode=AUTO, plan=write_legs_plan,
    ),
    Drill(
        "servo hot and supply low", "Supply voltage low", "Supply voltage normal",
        combined(assign("servo.motor.temperature_c", 75.0), assign("servo.motor.voltage_v", 10.5)),
        combined(assign("servo.motor.temperature_c", 60.0), assign("servo.motor.voltage_v", 12.0)),
        7.0, 12.0, 1.0, has_mode("RTL"), ("Rudder servo", "Failsafe", "Mode", "Return"), "straight",
        settings=AUTO_RESUME | {"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0, "FS_RUD_ACT": 1.0},
    ),
    Drill(
        "supply low after another failsafe", "Supply voltage low", "Supply voltage normal",
        in_sequence(
            4.0, assign("servo.motor.temperature_c", 75.0), assign("servo.motor.temperature_c", 60.0),
            assign("servo.motor.voltage_v", 10.5),
        ),
        assign("servo.motor.voltage_v", 12.0), 16.0, 12.0, 1.0,
        all_of(is_also_reported("Failsafe ended: HOLD"), has_mode("RTL")),
        ("Rudder servo", "Failsafe", "Mode", "Return"), "straight",
        settings={"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0, "FS_RUD_ACT": 1.0}, check_after=has_mode("RTL"),
    ),
    Drill(
        "operator steers on with a hot servo", "Rudder servo too hot", "Rudder servo temperature normal",
        assign("servo.motor.temperature_c", 75.0), assign("servo.motor.temperature_c", 60.0), 4.0, 4.0, 2.0,
        operator_can_override, ("Failsafe", "Mode"), "straight", settings=AUTO_RESUME | {"FS_RUD_ACT": 1.0},
    ),
    Drill(
        "troubles of a second", "", "",
        combined(
            assign("servo.motor.voltage_v", 10.5), assign("servo.motor.temperature_c", 75.0),
            assign("attitude_b.error_rad", radians(18.0)),
        ),
        combined(
            assign("servo.motor.voltage_v", 12.0), assign("servo.motor.temperature_c", 60.0),
            assign("attitude_b.error_rad", 0.0),
        ),
        0.0, 0.0, 1.0, moment="straight", fitted=("compass_b",), settings={"BAT_LOW_VOLT": 11.0},
    ),
    Drill(
        "ended and started again", "", "", end_and_start, do_nothing, 0.0, 0.0, 10.0,
        all_of(was_centred_at_end, is_on_course), ("",),
        "turning", settings={"BOOT_RESUME": 2.0},
    ),
)  # fmt: skip
