"""The drills: for each fault its injection, the expected message with its deadline, and the expected behaviour.

The messages are repeated here on purpose: the harness does not read the firmware's own table of faults.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from firmware_py.common.angles import radians
from hil.lab.drill.checks import (
    Check,
    also_reported,
    as_before,
    both,
    centred,
    centred_at_end,
    in_mode,
    not_over,
    on_course,
    operator_overrides,
    torque_off,
    turns_to,
)
from hil.lab.drill.injection import (
    Change,
    compass_and_receiver,
    ended,
    fenced,
    killed,
    legs,
    logs_gone,
    mission_clear_all,
    nothing,
    one_after_the_other,
    put,
    spoil,
    together,
    turned_by_wave,
    waiting,
)
from hil.ship.scenarios import Scenario, with_disturbances
from hil.sim.ground_station import GUIDED

LOITER, AUTO = 5, 10
YEAR_S = 365.0 * 86400.0
SAILED = {"FS_RESUME": 1.0}
BATTERY = {"PWR_SAVE_PCT": 30.0, "PWR_KEEP_PCT": 10.0}


@dataclass(frozen=True, slots=True)
class Drill:
    """A fault and the expected response.

    Attributes:
        text, recovery: start of the messages at the begin and at the end of the fault.
        inject, remove: functions that cause and that end the fault.
        report_s: deadline of `text` after the injection.
        clear_s: deadline of `recovery` after the removal; 0 if the condition does not end within the drill.
        active_s: duration of the fault.
        check, check_after: checks during the fault, and after its end (by default: same behaviour as before).
        also: other messages that the fault explains.
        moment: the only situation of this drill; empty for all of them.
        pair: whether the drill can be combined with another one.
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
    pair: bool = False
    mode: int = GUIDED
    settings: dict[str, float] | None = None
    fitted: tuple[str, ...] = ()
    plan: Callable[[Path], Path] | None = None
    sea: Callable[[Scenario], Scenario] = lambda scenario: scenario
    check_after: Check = as_before


BOOK: tuple[Drill, ...] = (
    Drill(
        "no heading", "No valid heading", "Heading recovered", compass_and_receiver(True), compass_and_receiver(False),
        15.0, 70.0, 32.0, centred, ("Compass: no data", "GPS position lost", "Heading source", "Heading lost"),
        settings={"CTL_HOLD_S": 5.0},
    ),
    Drill(
        "compass silent", "Compass: no data", "Compass: data recovered", put("compass.silent", True),
        put("compass.silent", False), 2.0, 4.0, 30.0, on_course,
        ("Heading source", "Compass heading jumped"), pair=True,
    ),
    Drill(
        "compass frozen", "Compass frozen: not used", "Compass no longer frozen", put("compass.frozen", True),
        put("compass.frozen", False), 32.0, 5.0, 5.0, on_course,
        ("Heading source", "Compass heading jumped"), pair=True,
    ),
    Drill(
        "compass turned by 180 deg", "Compass heading jumped", "Compass heading plausible again",
        put("attitude.error_rad", radians(180.0)), put("attitude.error_rad", 0.0), 4.0, 70.0, 20.0, on_course,
        ("Heading source", "Heading estimate", "No valid heading"),
    ),
    Drill(
        "turned by a breaking wave", "Compass heading jumped", "Compass heading plausible again",
        turned_by_wave(radians(90.0), 1.5), nothing, 4.0, 12.0, 4.0, on_course,
        ("Heading source", "Heading estimate", "No valid heading"),
    ),
    Drill(
        "turned by a breaking wave without a receiver", "Compass heading jumped", "Compass heading plausible again",
        together(put("receiver.fix", False), turned_by_wave(radians(-90.0), 1.5)), put("receiver.fix", True),
        4.0, 12.0, 4.0, on_course, ("Heading", "No valid heading", "GPS position lost"),
    ),
    Drill(
        "compasses disagree", "Compasses disagree", "Compasses agree again",
        put("other_attitude.error_rad", radians(18.0)), put("other_attitude.error_rad", 0.0), 30.0, 30.0, 5.0,
        on_course, ("Heading estimate",),  # in a turn the other compass may be frozen
        fitted=("compass_b",), pair=True,
    ),
    Drill(
        "compass loses and flips bytes", "", "", lambda boat: spoil(boat, 0.02), lambda boat: spoil(boat, 0.0),
        0.0, 0.0, 60.0, on_course, ("Compass", "Heading source"), pair=True,
    ),
    Drill(
        "position lost", "GPS position lost", "GPS position recovered", put("receiver.fix", False),
        put("receiver.fix", True), 9.0, 6.0, 20.0, on_course, pair=True,
    ),
    Drill(
        "position lost while keeping station", "GPS position lost", "GPS position recovered",
        put("receiver.fix", False), put("receiver.fix", True), 9.0, 6.0, 3.0, in_mode("STEERING"),
        ("Failsafe", "Mode"), "straight", mode=LOITER, settings=SAILED | {"FS_POS_ACT": 2.0},
    ),
    Drill(
        "position jumps", "GPS position jumped", "GPS position plausible again", put("whereabouts.north_m", 1e4),
        put("whereabouts.north_m", 0.0), 5.0, 8.0, 20.0, on_course,
        also=("GPS position lost", "Position believed", "First position"), pair=True,
    ),
    Drill(
        "servo's cable out", "Rudder servo not responding", "Rudder servo responding again",
        lambda boat: boat.unplug("rudder"), lambda boat: boat.plug("rudder"), 1.5, 5.0, 3.0,
        also=("Rudder",), pair=True,
    ),
    Drill(
        "servo's hardware error", "Rudder servo reports an error", "Rudder servo error cleared",
        lambda boat: boat.servo.inject_error(0x10), nothing, 1.5, 9.0, 0.5, also=("Rudder",), pair=True,
    ),
    Drill(
        "rudder jammed", "Rudder jammed", "Rudder no longer jammed", lambda boat: boat.world.jam(radians(-20.0)),
        lambda boat: boat.world.free(), 30.0, 13.0, 5.0, torque_off("Rudder jammed"), ("Rudder",),
    ),
    Drill(
        "servo hot", "Rudder servo too hot", "Rudder servo temperature normal", put("servo.motor.temperature_c", 75.0),
        put("servo.motor.temperature_c", 60.0), 4.0, 4.0, 2.0,
        both(in_mode("HOLD"), not_over("Rudder servo has cooled", put("servo.motor.temperature_c", 67.0), 5.0)),
        ("Failsafe", "Mode"),
        settings=SAILED | {"FS_RUD_ACT": 1.0},
    ),
    Drill(
        "servo overloaded", "Rudder servo overcurrent", "Rudder servo current normal",
        put("servo.motor.load_a", 4.0),
        put("servo.motor.load_a", 0.0), 4.0, 14.0, 2.0, torque_off("Rudder servo draws"), pair=True,
    ),
    Drill(
        "servo's power cut", "Rudder servo lost power", "Rudder servo power stable again",
        lambda boat: boat.servo.power_cycle(
            boat.now_s, off_s=2.0
        ), nothing, 6.0, 9.0, 0.5, also=("Rudder",), pair=True,
    ),
    Drill(
        "supply low", "Supply voltage low", "Supply voltage normal", put("servo.motor.voltage_v", 10.5),
        put("servo.motor.voltage_v", 12.0), 7.0, 12.0, 1.0,
        both(in_mode("RTL"), not_over("Supply voltage normal", put("servo.motor.voltage_v", 11.2), 13.0),
            not_over("Supply voltage normal", put("servo.motor.voltage_v", 12.0), 6.0)),
        ("Failsafe", "Mode", "Return"),
        settings=SAILED | {"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0},
    ),
    Drill(
        "battery low", "Battery low", "Battery no longer low", put("plant.charge", 0.25),
        put("plant.charge", 0.5), 36.0, 66.0,
        5.0, both(on_course, not_over("Battery no longer low", put("plant.charge", 0.33), 70.0)), (),
        fitted=("supply",), settings=BATTERY, pair=True,
    ),
    Drill(
        "battery nearly empty", "Battery critical", "Battery no longer critical",
        put("plant.charge", 0.05), put("plant.charge", 0.5), 36.0, 66.0,
        33.0, in_mode("STEERING"), ("Failsafe", "Battery low"), "straight",
        fitted=("supply",), settings=BATTERY | SAILED,
    ),
    Drill(
        "power monitor silent", "Power monitor: no data", "Power monitor: data recovered", put("monitor.silent", True),
        put("monitor.silent", False), 18.0, 5.0, 2.0, on_course, ("Battery",), fitted=("supply",), pair=True,
    ),
    Drill(
        "computer busy for half a second", "Control loop late: deadlines skipped", "Control loop on time again",
        lambda boat: boat.server.stall(0.5), nothing, 2.0, 4.0, 0.1, pair=True,
    ),
    Drill(
        "clock stepped by a year", "System clock stepped", "System clock steady again",
        lambda boat: boat.server.step_utc(YEAR_S), nothing, 2.0, 12.0, 5.0,
        on_course, pair=True,
    ),
    Drill(
        "station silent", "Ground station link lost", "Ground station link recovered", put("station.silent", True),
        put("station.silent", False),
        12.0, 4.0, 3.0, in_mode("LOITER"), ("Failsafe", "Mode"),
        settings=SAILED | {"FS_GCS_S": 10.0, "FS_GCS_ACT": 3.0},
    ),
    Drill(
        "killed", "", "", killed, nothing, 0.0, 0.0, 10.0, on_course, ("",), settings={"BOOT_RESUME": 2.0},
    ),
    Drill(
        "outside the fence", "Fence breached", "Fence breach cleared", nothing, nothing, 60.0, 240.0, 3.0,
        in_mode("RTL"),
        ("Failsafe", "Mode", "Return"), "straight", settings={"FENCE_ENABLE": 1.0}, plan=fenced,
        sea=lambda scenario: replace(scenario, speed_m_s=0.8), check_after=in_mode("RTL"),
    ),
    Drill(
        "rudder blade lost", "Steering lost: no response to the rudder", "", put("world.rudder_effect", 0.0),
        put("world.rudder_effect", 1.0),
        150.0, 0.0, 1.0, also=("Steering reversed", "Rudder hard over"), moment="turning",
    ),
    Drill(
        "servo the wrong way round", "Steering reversed", "", put("world.rudder_effect", -1.0),
        put("world.rudder_effect", 1.0),
        180.0, 0.0, 1.0, also=("Rudder moves", "Rudder hard over"), moment="turning",
    ),
    Drill(
        "ship slower to turn than its model", "Heading oscillates", "", nothing, nothing, 300.0, 0.0, 1.0,
        moment="turning",
        sea=lambda scenario: with_disturbances(scenario, "kt=1:3,delay=8"),
    ),
    Drill(
        "mission cleared while it is sailed", "Mission unusable", "Mission problem cleared",
        lambda boat: boat.station.queue(mission_clear_all()), lambda boat: boat.set_mode(GUIDED), 4.0, 4.0, 2.0,
        in_mode("AUTO"), ("Mission",), "straight", mode=AUTO, plan=waiting, check_after=in_mode("GUIDED"),
    ),
    Drill(
        "current stronger than the boat", "Current too strong", "", lambda boat: boat.set_mode(LOITER),
        nothing, 1800.0, 0.0, 60.0, also=("Failsafe",), moment="straight",
        sea=lambda scenario: replace(scenario, current_m_s=0.48, current_toward_deg=90.0),
    ),
    Drill(
        "logs gone", "Storage error: logs", "Storage error cleared", logs_gone,
        lambda boat: (boat.state / "logs").unlink(), 60.0, 60.0, 2.0, on_course, ("Log",), "straight",
    ),
    Drill(
        "first of two compasses silent", "Compass: no data", "Compass: data recovered", put("compass.silent", True),
        put("compass.silent", False), 2.0, 4.0, 30.0, both(on_course, also_reported("Heading source: compass B")),
        ("Heading source",), "turning", fitted=("compass_b",),
    ),
    Drill(
        "position lost on a mission", "GPS position lost", "GPS position recovered",
        put("receiver.fix", False), put("receiver.fix", True), 9.0, 6.0, 3.0, turns_to(90.0, 180.0),
        (), "straight", mode=AUTO, plan=legs,
    ),
    Drill(
        "servo hot and supply low", "Supply voltage low", "Supply voltage normal",
        together(put("servo.motor.temperature_c", 75.0), put("servo.motor.voltage_v", 10.5)),
        together(put("servo.motor.temperature_c", 60.0), put("servo.motor.voltage_v", 12.0)),
        7.0, 12.0, 1.0, in_mode("RTL"), ("Rudder servo", "Failsafe", "Mode", "Return"), "straight",
        settings=SAILED | {"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0, "FS_RUD_ACT": 1.0},
    ),
    Drill(
        "supply low after another failsafe", "Supply voltage low", "Supply voltage normal",
        one_after_the_other(
            4.0, put("servo.motor.temperature_c", 75.0), put("servo.motor.temperature_c", 60.0),
            put("servo.motor.voltage_v", 10.5),
        ),
        put("servo.motor.voltage_v", 12.0), 16.0, 12.0, 1.0,
        both(also_reported("Failsafe ended: HOLD"), in_mode("RTL")),
        ("Rudder servo", "Failsafe", "Mode", "Return"), "straight",
        settings={"BAT_LOW_VOLT": 11.0, "FS_VOLT_ACT": 4.0, "FS_RUD_ACT": 1.0}, check_after=in_mode("RTL"),
    ),
    Drill(
        "operator steers on with a hot servo", "Rudder servo too hot", "Rudder servo temperature normal",
        put("servo.motor.temperature_c", 75.0), put("servo.motor.temperature_c", 60.0), 4.0, 4.0, 2.0,
        operator_overrides, ("Failsafe", "Mode"), "straight", settings=SAILED | {"FS_RUD_ACT": 1.0},
    ),
    Drill(
        "troubles of a second", "", "",
        together(
            put("servo.motor.voltage_v", 10.5), put("servo.motor.temperature_c", 75.0),
            put("other_attitude.error_rad", radians(18.0)),
        ),
        together(
            put("servo.motor.voltage_v", 12.0), put("servo.motor.temperature_c", 60.0),
            put("other_attitude.error_rad", 0.0),
        ),
        0.0, 0.0, 1.0, moment="straight", fitted=("compass_b",), settings={"BAT_LOW_VOLT": 11.0},
    ),
    Drill(
        "ended and started again", "", "", ended, nothing, 0.0, 0.0, 10.0, both(centred_at_end, on_course), ("",),
        "turning", settings={"BOOT_RESUME": 2.0},
    ),
)  # fmt: skip
