"""Each fault, provoked through the device emulators in lockstep, is reported, acted on and cleared."""

import functools
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.__main__ import main
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.faults.table import TABLE, Fault
from firmware_py.plans.items import Command
from hil.ship.disturbances import Depth, Supply, Wind
from hil.ship.scenarios import with_disturbances
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG

LOITER, AUTO, GUIDED = 5, 10, 15
SET_MODE, CHANGE_HEADING = 176, 43002
TURN = "0:0,12:90"  # rudder at its limit from 12 s on
FENCE_RADIUS_M = 20.0
TORQUE_ENABLE, ELECTRICAL_SHOCK = 64, 0x10  # of the Dynamixel: register; bit of the hardware error status


def no_change(_bench):
    pass


def set_value(path, value):
    """Return a function that sets an attribute of the bench, such as compass.frozen."""
    *owners, name = path.split(".")
    return lambda bench: setattr(functools.reduce(getattr, owners, bench), name, value)


@dataclass(frozen=True)
class Drill:
    """A fault: how it is provoked and repaired, time limits of report and recovery, and checks."""

    fault: Fault
    provoke: Callable
    max_report_s: float
    check: Callable  # arguments: bench, time of the fault
    repair: Callable
    max_recovery_s: float
    check_after: Callable = no_change
    start_s: float = 10.0  # of the fault
    fault_time_s: float = 5.0  # from the fault to the check
    options: dict = field(default_factory=dict)


def check_rudder_held_then_centred(bench, t0_s):
    """The last rudder angle is held for CTL_HOLD_S, then the rudder is centred."""
    angles = [angle_deg for t_s, angle_deg in bench.rudder_history if t0_s + 1.5 < t_s < t0_s + 9.0]
    assert min(angles) > 15.0
    assert max(angles) - min(angles) < 1.0
    assert abs(bench.rudder_deg()) < 0.5


def check_course_fallback(bench, _t0_s):
    """The autopilot continues to steer with the course fallback."""
    assert any(text.startswith("Heading source: course") for text in bench.texts_since(0.0))
    assert bench.mode() == "GUIDED"
    assert abs(bench.heading_error_deg()) < 10.0


def check_undisturbed(bench, t0_s):
    """Rudder and heading do not change."""
    assert bench.max_rudder_deg(t0_s) < 12.0
    assert abs(bench.heading_error_deg()) < 10.0


def check_failsafe(name):
    def check_mode_and_text(bench, t0_s):
        assert bench.mode() == name
        assert any(text.startswith(f"Failsafe: {name}") for text in bench.texts_since(t0_s))

    return check_mode_and_text


def check_mode(name):
    def check(bench):
        assert bench.mode() == name

    return check


def check_alert_only(bench, t0_s):
    assert bench.mode() == "GUIDED"
    assert not any(text.startswith("Failsafe") for text in bench.texts_since(t0_s))


def check_rudder_follows(bench):
    bench.run(3.0)
    assert abs(bench.rudder_deg() - bench.command_deg()) < 3.0


def push_shaft_away(bench):
    """Push the shaft away from its command against the motor."""
    for turn in range(40):
        bench.world.jam(math.radians(8.0 - 0.3 * turn))
        bench.run(0.1)


def check_torque_relieved(bench, t0_s):
    """The command follows the jammed shaft, so that the motor does not shut down."""
    assert abs(bench.command_deg() - bench.rudder_deg()) < 1.0
    assert not any("hardware error" in text for text in bench.texts_since(t0_s))
    assert bench.mode() == "GUIDED"


def remove_logs(bench):
    logs = bench.directory / "state" / "logs"
    while not any(path.stat().st_size for path in logs.glob("*.BIN")):
        bench.run(0.5)
    shutil.rmtree(logs)
    logs.write_text("in the way")


FILL_BYTES = 2 << 30


def fill_disk(bench):
    with (bench.directory / "fill").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, FILL_BYTES)


def reserve_of_nearly_full_disk_mb(tmp_path):
    return (shutil.disk_usage(tmp_path).free - FILL_BYTES // 2) / 1e6


def check_continues(bench, t0_s):
    assert bench.mode() == "GUIDED"
    assert abs(bench.heading_error_deg()) < 10.0
    assert bench.now_s - t0_s > 1.0


def check_heads_into_current(bench, _t0_s):
    """The current sets east, so that the boat heads west."""
    bench.run(60.0)
    assert abs(bench.heading_error_deg(270.0)) < 30.0


def fence_plan():
    position = (round(START_LATITUDE_DEG * 1e7), round(START_LONGITUDE_DEG * 1e7))
    circle = PlanItem(Command.INCLUDED_CIRCLE, 3, True, (FENCE_RADIUS_M, 0.0, 0.0, 0.0), *position)
    return ("fence.plan", plan_to_text(Plan.of(PlanKind.FENCE, [circle])))


def endless_mission():
    """Return a mission that loiters at the present position without end."""
    return ("mission.plan", plan_to_text(Plan.of(PlanKind.MISSION, [PlanItem(Command.LOITER_UNLIMITED, 3)])))


def restart_with_damaged_key(bench):
    """Restart with empty key files; the link of the ground station is trusted."""
    bench.kill()
    for slot in (0, 1):
        (bench.state / f"signing.key.{slot}").write_bytes(b"")
    bench._vehicle.write_text(bench._vehicle.read_text().replace(":57600", ":57600?trusted=1"))
    bench.start()


def check_key_problem_reported(bench, _t0_s):
    assert "signing.key lost: signing.key.0 is damaged, signing.key.1 is damaged" in bench.output_text()


def wait_for_breach(bench):
    while math.hypot(*(bench.world._hull.position_m(0.0))) < FENCE_RADIUS_M:
        bench.run(0.2)
    return bench.now_s


FAILSAFE = {"FS_RESUME": 1}
BATTERY = {"PWR_SAVE_PCT": 30.0, "PWR_KEEP_PCT": 10.0}
INSTRUMENTS = {"instruments": (Wind(turbulence=0.0), Depth())}
EAST = {"current_toward_deg": 90.0}
DRILLS = (
    Drill(
        Fault.COMPASS_LOST, set_value("compass.silent", True), 1.5, check_rudder_held_then_centred,
        set_value("compass.silent", False), 12.0, lambda bench: (bench.run(60.0), check_heading(bench, 90.0)),
        start_s=14.0, fault_time_s=30.0, options={"goals": TURN, "change": None, "no_fix": True},
    ),
    Drill(
        Fault.COMPASS_SILENT, set_value("compass.silent", True), 2.0, check_course_fallback,
        set_value("compass.silent", False), 3.0, fault_time_s=30.0,
    ),
    Drill(
        Fault.COMPASS_FROZEN, set_value("compass.frozen", True), 31.0, check_course_fallback,
        set_value("compass.frozen", False), 2.0, start_s=25.0,
    ),
    Drill(
        Fault.COMPASS_JUMPING, set_value("attitude.error_rad", math.pi), 2.5, check_undisturbed,
        set_value("attitude.error_rad", 0.0), 8.0, start_s=20.0, fault_time_s=20.0,
    ),
    Drill(
        Fault.COMPASS_DISAGREES, set_value("other_attitude.error_rad", math.radians(18.0)), 25.0, check_undisturbed,
        set_value("other_attitude.error_rad", 0.0), 25.0, start_s=20.0, options={"second_compass": True},
    ),
    Drill(
        Fault.POSITION_LOST, set_value("gps.fix", False), 8.5, check_failsafe("STEERING"), set_value("gps.fix", True),
        2.5, check_mode("LOITER"), options={"mode": LOITER, "goals": "", "settings": FAILSAFE | {"FS_POS_ACT": 2}},
    ),
    Drill(
        Fault.POSITION_JUMPING, set_value("whereabouts.north_m", 1e4), 4.0, check_undisturbed,
        set_value("whereabouts.north_m", 0.0), 5.0, fault_time_s=20.0,
    ),
    Drill(
        Fault.RUDDER_SILENT, lambda bench: bench.lines["rudder"].unplug(), 1.3, check_alert_only,
        lambda bench: bench.lines["rudder"].plug(), 4.0, check_rudder_follows, fault_time_s=3.0,
        options={"goals": TURN},
    ),
    Drill(
        Fault.RUDDER_ERROR, lambda bench: bench.servo.inject_error(ELECTRICAL_SHOCK), 1.2, check_alert_only, no_change,
        8.0, check_rudder_follows, fault_time_s=0.5,
    ),
    Drill(
        Fault.RUDDER_ASTRAY, push_shaft_away, 4.0, check_alert_only, lambda bench: bench.world.free(), 14.0,
        check_rudder_follows, start_s=12.5, fault_time_s=0.1, options={"goals": TURN, "settings": {"RUD_AMP_MAX": 0}},
    ),
    Drill(
        Fault.RUDDER_JAMMED, lambda bench: bench.world.jam(math.radians(-20.0)), 2.5, check_torque_relieved,
        lambda bench: bench.world.free(), 12.0, check_rudder_follows, start_s=13.0, fault_time_s=8.0,
        options={"goals": TURN},
    ),
    Drill(
        Fault.RUDDER_HOT, set_value("servo.motor.temperature_c", 75.0), 3.0, check_failsafe("HOLD"),
        set_value("servo.motor.temperature_c", 60.0), 3.0, check_mode("GUIDED"), fault_time_s=1.0,
        options={"settings": FAILSAFE | {"FS_RUD_ACT": 1}},
    ),
    Drill(
        Fault.RUDDER_OVERLOADED, set_value("servo.motor.load_a", 4.0), 3.0, check_alert_only,
        set_value("servo.motor.load_a", 0.0), 12.5, check_rudder_follows,
    ),
    Drill(
        Fault.RUDDER_REPOWERED, lambda bench: bench.servo.power_cycle(bench.now_s, off_s=2.0), 5.0, check_alert_only,
        no_change, 8.0, check_rudder_follows, start_s=13.0, fault_time_s=0.1, options={"goals": TURN},
    ),
    Drill(
        Fault.SUPPLY_LOW, set_value("servo.motor.voltage_v", 10.5), 6.0, check_failsafe("RTL"),
        set_value("servo.motor.voltage_v", 12.0), 11.0, check_mode("GUIDED"), fault_time_s=1.0,
        options={"settings": FAILSAFE | {"BAT_LOW_VOLT": 11, "FS_VOLT_ACT": 4}},
    ),
    Drill(
        Fault.BATTERY_LOW, set_value("plant.charge", 0.25), 35.0, check_continues, set_value("plant.charge", 0.5),
        65.0, check_mode("GUIDED"), options={"settings": BATTERY, "supply": Supply()},
    ),
    Drill(
        Fault.BATTERY_CRITICAL, set_value("plant.charge", 0.05), 35.0, check_failsafe("STEERING"),
        set_value("plant.charge", 0.5), 65.0, check_mode("GUIDED"), fault_time_s=32.0,
        options={"settings": BATTERY, "supply": Supply()},
    ),
    Drill(
        Fault.POWER_SILENT, set_value("monitor.silent", True), 17.0, check_continues,
        set_value("monitor.silent", False), 3.0, options={"supply": Supply()},
    ),
    Drill(
        Fault.LOOP_LATE, lambda bench: bench.server.stall(0.5), 1.5, check_alert_only, no_change, 3.0,
        fault_time_s=0.1,
    ),
    Drill(
        Fault.STORAGE_FAILING, remove_logs, 60.0, check_continues,
        lambda bench: (bench.directory / "state/logs").unlink(), 60.0, options={"speed": 10.0},
    ),
    Drill(
        Fault.STORAGE_FULL, fill_disk, 60.0, check_continues, lambda bench: (bench.directory / "fill").unlink(), 60.0,
        options={"speed": 10.0},
    ),
    Drill(
        Fault.CLOCK_STEPPED, lambda bench: bench.server.step_utc(365.0 * 86400.0), 1.0, check_continues, no_change,
        11.0, fault_time_s=2.0,
    ),
    Drill(
        Fault.STATION_SILENT, set_value("station.is_silent", True), 11.5, check_failsafe("LOITER"),
        set_value("station.is_silent", False), 2.0, check_mode("GUIDED"),
        options={"settings": FAILSAFE | {"FS_GCS_S": 10, "FS_GCS_ACT": 3}},
    ),
    Drill(
        Fault.FENCE_BREACHED, wait_for_breach, 8.0, check_failsafe("RTL"), no_change, 150.0, start_s=5.0,
        fault_time_s=1.0, options={"plans": (fence_plan(),), "settings": {"FENCE_ENABLE": 1, "LOIT_RADIUS": 10},
                                   "change": lambda scenario: replace(scenario, speed_m_s=0.8)},
    ),
    Drill(
        Fault.MISSION_UNUSABLE, lambda bench: bench.station.queue(mavlink.MAVLink_mission_clear_all_message(
            1, 1, mavlink.MAV_MISSION_TYPE_MISSION
        )),
        3.0, lambda bench, _t0_s: check_mode("AUTO")(bench),
        lambda bench: bench.send_command(SET_MODE, 1.0, float(GUIDED)), 2.0, check_mode("GUIDED"), start_s=10.0,
        fault_time_s=1.0,
        options={"mode": AUTO, "plans": (endless_mission(),), "goals": ""},
    ),
    Drill(
        Fault.STEERING_LOST, set_value("world.rudder_effect", 0.0), 90.0, check_alert_only,
        set_value("world.rudder_effect", 1.0), 240.0, start_s=10.0, fault_time_s=1.0, options={"goals": TURN},
    ),
    Drill(
        Fault.STEERING_REVERSED, set_value("world.rudder_effect", -1.0), 180.0, check_alert_only,
        set_value("world.rudder_effect", 1.0), 400.0, start_s=10.0, fault_time_s=1.0, options={"goals": TURN},
    ),
    Drill(
        Fault.KEY_LOST, restart_with_damaged_key, 5.0, check_key_problem_reported,
        lambda bench: bench.station.queue(mavlink.MAVLink_setup_signing_message(1, 1, bytes(32), 0)), 3.0,
        fault_time_s=1.0,
    ),
    Drill(
        Fault.HELM_OSCILLATES, no_change, 300.0, check_alert_only, no_change, 400.0, fault_time_s=1.0,
        options={"goals": TURN, "change": lambda scenario: with_disturbances(scenario, "kt=1:3,delay=8")},
    ),
    Drill(
        Fault.CURRENT_STRONG, lambda bench: bench.send_command(SET_MODE, 1.0, float(LOITER)), 1800.0,
        check_heads_into_current, no_change, 0.0,
        options={"change": lambda scenario: replace(scenario, current_m_s=0.48, **EAST)},
    ),
    Drill(
        Fault.WATER_SHALLOW, set_value("world.start_depth_m", 15.0), 13.0, check_failsafe("STEERING"),
        set_value("world.start_depth_m", 30.0), 33.0, check_mode("GUIDED"), fault_time_s=12.0,
        options=INSTRUMENTS | {"settings": FAILSAFE | {"DEPTH_MIN": 20, "FS_DEPTH_ACT": 2}},
    ),
    Drill(
        Fault.WIND_STRONG, set_value("world.wind_m_s", 25.0), 95.0, check_failsafe("STEERING"),
        set_value("world.wind_m_s", 5.0), 185.0, check_mode("GUIDED"), fault_time_s=12.0,
        options=INSTRUMENTS | {"settings": FAILSAFE | {"WIND_MAX": 15, "FS_WIND_ACT": 2}},
    ),
)  # fmt: skip


def check_heading(bench, goal_deg):
    assert abs(bench.heading_error_deg(goal_deg)) < 10.0


def start_drill(fault_bench, drill, tmp_path):
    options = dict(drill.options)
    no_fix = options.pop("no_fix", False)
    if drill.fault is Fault.STORAGE_FULL:
        options["settings"] = {"LOG_FREE_MB": reserve_of_nearly_full_disk_mb(tmp_path)}
    bench = fault_bench(**options)
    if no_fix:
        bench.gps.fix = False
    bench.get_under_way(options.get("mode", GUIDED))
    if bench.now_s < drill.start_s:
        bench.run(drill.start_s - bench.now_s)
    return bench


def test_every_fault_has_a_drill():
    """Except two: vessels are in test_vessels.py, and no device fault makes the filter inconsistent."""
    tested_elsewhere = {Fault.VESSEL_NEAR, Fault.ESTIMATE_INCONSISTENT}
    assert sorted(drill.fault for drill in DRILLS) == sorted(set(TABLE) - tested_elsewhere)


# Only in the proof: another test of the suite detects and reports each of these (unit tests, voyages, test_cables,
# test_ashore, test_drill, test_instruments, clients/test_key_command).
PROOF_FAULTS = {
    Fault[name]
    for name in """
    COMPASS_LOST COMPASS_SILENT COMPASS_FROZEN COMPASS_DISAGREES POSITION_JUMPING RUDDER_SILENT RUDDER_OVERLOADED
    SUPPLY_LOW BATTERY_LOW BATTERY_CRITICAL LOOP_LATE POWER_SILENT STORAGE_FAILING STORAGE_FULL CLOCK_STEPPED
    STATION_SILENT FENCE_BREACHED STEERING_LOST STEERING_REVERSED KEY_LOST HELM_OSCILLATES CURRENT_STRONG
    WATER_SHALLOW WIND_STRONG
    """.split()  # noqa: SIM905 - reads better than a list
}


@pytest.mark.parametrize(
    "drill",
    [pytest.param(drill, marks=pytest.mark.proof) if drill.fault in PROOF_FAULTS else drill for drill in DRILLS],
    ids=lambda drill: drill.fault.name,
)
def test_fault_is_reported_acted_on_and_cleared(fault_bench, drill, tmp_path):
    row = TABLE[drill.fault]
    bench = start_drill(fault_bench, drill, tmp_path)
    t0_s = 0.0 if drill.provoke is no_change else bench.now_s
    t0_s = drill.provoke(bench) or t0_s
    bench.run_until_text(row.text, drill.max_report_s, since_s=t0_s)
    if bench.now_s < t0_s + drill.fault_time_s:
        bench.run(t0_s + drill.fault_time_s - bench.now_s)
    drill.check(bench, t0_s)
    if drill.max_recovery_s == 0.0:
        return
    t1_s = t0_s if drill.repair is no_change else bench.now_s
    drill.repair(bench)
    bench.run_until_text(row.recovery, drill.max_recovery_s, since_s=t1_s)
    drill.check_after(bench)


def test_clock_step_of_a_year_is_reported_and_does_not_affect_control(fault_bench):
    row, trails = TABLE[Fault.CLOCK_STEPPED], []
    for name, step_s in (("plain", 0.0), ("stepped", 365.0 * 86400.0)):
        bench = fault_bench(name=name, goals=TURN, scenario="sea")
        bench.get_under_way(GUIDED)
        bench.run(14.0 - bench.now_s)
        if step_s:
            bench.server.step_utc(step_s)
            bench.run_until_text(row.text, 1.0)
            bench.run_until_text(row.recovery, 11.0)
        bench.run(27.0 - bench.now_s)
        trails.append(bench.rudder_history)
    assert trails[0] == trails[1]
    assert bench.max_rudder_deg(14.0) > 10.0


@pytest.mark.parametrize("compass", ["nmea", pytest.param("pni", marks=pytest.mark.proof)])
def test_rudder_is_centred_without_a_heading_even_with_a_long_hold_time(fault_bench, compass):
    """The compass freezes in a turn, with the rudder deflected."""
    bench = fault_bench(goals=TURN, compass=compass, settings={"CTL_HOLD_S": 600})
    bench.gps.fix = False
    bench.get_under_way(GUIDED)
    bench.run(14.0 - bench.now_s)
    bench.compass.frozen = True
    frozen_s = bench.now_s
    bench.run_until_text("No valid heading", 33.0)
    assert TABLE[Fault.COMPASS_FROZEN].text in bench.texts_since(frozen_s)
    assert abs(bench.rudder_deg()) > 10.0
    bench.run(31.0)
    assert abs(bench.rudder_deg()) < 0.5
    bench.compass.frozen = False
    bench.run_until_text("Heading recovered", 15.0)  # the estimate had no update meanwhile
    bench.run(5.0)
    assert abs(bench.rudder_deg()) > 1.0


def test_run_with_many_faults_replays_bit_for_bit(fault_bench):
    bench = fault_bench(goals=TURN, settings={"FS_GCS_S": 5, "FS_GCS_ACT": 3, "FS_RESUME": 1})
    bench.get_under_way(GUIDED)
    bench.run(13.0 - bench.now_s)
    bench.world.jam(math.radians(20.0))
    bench.server.step_utc(-365.0 * 86400.0)
    bench.station.is_silent = True
    bench.run(12.0)
    bench.world.free()
    bench.compass.silent = True
    bench.servo.power_cycle(bench.now_s, 1.0)
    bench.run(8.0)
    bench.compass.silent = bench.station.is_silent = False
    bench.whereabouts.north_m = 1e4
    bench.run(10.0)
    logs = bench.finish()
    assert logs
    assert all(main(["replay", str(log)]) == 0 for log in logs)


@pytest.mark.proof
def test_servo_is_released_while_the_command_is_constant_and_engages_before_it_moves(fault_bench):
    bench = fault_bench(scenario="calm", settings={"RUD_REST_S": 3})
    bench.get_under_way(GUIDED)
    bench.run(240.0 - bench.now_s)  # until the wave power has converged
    torque = []
    while bench.now_s < 280.0 or torque[-1] != 0:
        bench.run(0.5)
        torque.append(bench.servo.motor._table[TORQUE_ENABLE])
    assert torque.count(0) > 0.4 * len(torque)
    assert abs(bench.heading_error_deg()) < 2.0
    bench.send_command(CHANGE_HEADING, 1.0, 60.0)
    t0_s = bench.now_s
    bench.run(4.0)
    assert bench.max_rudder_deg(t0_s) > 10.0
    assert not any("power" in text or "jammed" in text for text in bench.texts_since(0.0))


def test_volz_servo_keeps_steering_when_rest_is_set(fault_bench):
    bench = fault_bench(scenario="calm", servo="volz", goals="0:0,20:60", settings={"RUD_REST_S": 3})
    bench.get_under_way(GUIDED)
    bench.run(25.0 - bench.now_s)
    assert bench.max_rudder_deg(20.0) > 10.0
    assert bench.texts_since(3.0) == []


@pytest.mark.proof
@pytest.mark.parametrize("compass", ["pni", "nmea"])
def test_jam_at_20_degrees_is_detected_on_the_volz_servo(fault_bench, compass):
    bench = fault_bench(servo="volz", compass=compass, goals=TURN)
    bench.get_under_way(GUIDED)
    bench.run(13.0 - bench.now_s)
    bench.world.jam(math.radians(-20.0))
    bench.run_until_text("Rudder jammed", 2.5)
    bench.world.free()
    bench.run_until_text("Rudder no longer jammed", 12.0)
    check_rudder_follows(bench)


@pytest.mark.parametrize(
    ("rate_hz", "seconds", "max_detection_s"),
    [
        (0.5, 30.0, 6.5),
        pytest.param(1.0, 3600.0, 4.0, marks=[pytest.mark.proof, pytest.mark.timeout(900)]),
    ],
)
def test_slow_compass_raises_no_fault_and_its_loss_is_detected(fault_bench, rate_hz, seconds, max_detection_s):
    bench = fault_bench(compass_rate_hz=rate_hz)
    bench.get_under_way(GUIDED)
    bench.run(seconds)
    assert abs(bench.heading_error_deg()) < 3.0
    texts = bench.texts_since(0.0)
    assert not any(text.startswith((row.text, "Heading lost")) for text in texts for row in TABLE.values())
    bench.compass.silent = True
    bench.run_until_text(TABLE[Fault.COMPASS_SILENT].text, max_detection_s)
    bench.compass.silent = False
    bench.run_until_text(TABLE[Fault.COMPASS_SILENT].recovery, 6.0)
    logs = bench.finish()
    assert all(main(["replay", str(log)]) == 0 for log in logs)
