"""Every row of the fault table provoked in lockstep through the device emulators: reported, acted on and cleared."""

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
from hil.ship.disturbances import Supply
from hil.ship.scenarios import with_disturbances
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG

LOITER, AUTO, GUIDED = 5, 10, 15
SET_MODE, CHANGE_HEADING = 176, 43002
TURN = "0:0,12:90"  # hard over from the 12th second on
CIRCLE_M = 20.0


def nothing(_bench):
    pass


@dataclass(frozen=True)
class Drill:
    """How a row is provoked: the fault, the times of report and recovery, the condition that holds meanwhile."""

    fault: Fault
    broken: Callable
    within_s: float
    holds: Callable  # (bench, when it broke): what must be true a while later
    mended: Callable
    over_s: float
    after: Callable = nothing
    start_s: float = 10.0  # under way for this long before it breaks
    stands_s: float = 5.0  # and broken for this long before it is looked at
    options: dict = field(default_factory=dict)


def silenced(bench, *, silent=True):
    bench.compass.silent = silent


def spoken(bench):
    silenced(bench, silent=False)


def held_then_amidships(bench, t0_s):
    """Hold the last rudder for CTL_HOLD_S, then amidships."""
    angles = [angle_deg for t_s, angle_deg in bench.trail if t0_s + 1.5 < t_s < t0_s + 9.0]
    assert min(angles) > 15.0
    assert max(angles) - min(angles) < 1.0
    assert abs(bench.rudder_deg()) < 0.5


def steers_by_course(bench, _t0_s):
    """Go on steering, by the course over ground."""
    assert any(text.startswith("Heading source: course") for text in bench.texts_since(0.0))
    assert bench.mode() == "GUIDED"
    assert abs(bench.heading_error_deg()) < 10.0


def undisturbed(bench, t0_s):
    """Neither rudder nor heading take notice."""
    assert bench.widest_deg(t0_s) < 12.0
    assert abs(bench.heading_error_deg()) < 10.0


def in_mode(name):
    def check(bench, t0_s):
        assert bench.mode() == name
        assert any(text.startswith(f"Failsafe: {name}") for text in bench.texts_since(t0_s))

    return check


def back_in(name):
    def check(bench):
        assert bench.mode() == name

    return check


def alert_only(bench, t0_s):
    assert bench.mode() == "GUIDED"
    assert not any(text.startswith("Failsafe") for text in bench.texts_since(t0_s))


def rudder_follows(bench):
    bench.run(3.0)
    assert abs(bench.rudder_deg() - bench.command_deg()) < 3.0


def jumped(bench, north_m=1e4):
    bench.whereabouts.north_m = north_m


def fix(bench, *, there):
    bench.gps.fix = there


def attitude_off(bench, degrees):
    bench.attitude.error_rad = math.radians(degrees)


def led_astray(bench):
    """Push the shaft the wrong way, whatever the motor does."""
    for turn in range(40):
        bench.world.jam(math.radians(8.0 - 0.3 * turn))
        bench.run(0.1)


def eased(bench, t0_s):
    """The motor does not pull at what does not move, so it does not shut down."""
    assert abs(bench.command_deg() - bench.rudder_deg()) < 1.0
    assert not any("hardware error" in text for text in bench.texts_since(t0_s))
    assert bench.mode() == "GUIDED"


def servo_is(**values):
    def change(bench):
        for name, value in values.items():
            setattr(bench.servo.motor, name, value)

    return change


def logs_gone(bench):
    logs = bench.directory / "state" / "logs"
    while not any(path.stat().st_size for path in logs.glob("*.BIN")):
        bench.run(0.5)
    shutil.rmtree(logs)
    logs.write_text("in the way")


def logs_back(bench):
    (bench.directory / "state" / "logs").unlink()


FILL_BYTES = 2 << 30


def disk_filled(bench):
    with (bench.directory / "fill").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, FILL_BYTES)


def disk_cleared(bench):
    (bench.directory / "fill").unlink()


def nearly_full_mb(tmp_path):
    return (shutil.disk_usage(tmp_path).free - FILL_BYTES // 2) / 1e6


def sails_on(bench, t0_s):
    assert bench.mode() == "GUIDED"
    assert abs(bench.heading_error_deg()) < 10.0
    assert bench.now_s - t0_s > 1.0


def points_into_it(bench, _t0_s):
    """The current sets east, so the boat heads west."""
    bench.run(60.0)
    assert abs(bench.heading_error_deg(270.0)) < 30.0


def silent_station(bench, *, silent=True):
    bench.station.silent = silent


def fence():
    at = (round(START_LATITUDE_DEG * 1e7), round(START_LONGITUDE_DEG * 1e7))
    circle = PlanItem(5003, 3, True, (CIRCLE_M, 0.0, 0.0, 0.0), *at)
    return ("fence.plan", plan_to_text(Plan.of(PlanKind.FENCE, [circle])))


def endless():
    """A mission that waits at its present position without end."""
    return ("mission.plan", plan_to_text(Plan.of(PlanKind.MISSION, [PlanItem(17, 3)])))


def cleared(bench):
    bench.station.queue(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))


def key_lost(bench):
    """Start again on files of a key that hold none any more; the station speaks over a trusted link."""
    bench.kill()
    for slot in (0, 1):
        (bench.state / f"signing.key.{slot}").write_bytes(b"")
    bench._vehicle.write_text(bench._vehicle.read_text().replace(":57600", ":57600?trusted=1"))
    bench.start()


def reported_with_its_cause(bench, _t0_s):
    assert "signing.key lost: signing.key.0 is damaged, signing.key.1 is damaged" in bench.words()


def key_removed(bench):
    bench.station.queue(mavlink.MAVLink_setup_signing_message(1, 1, bytes(32), 0))


def breached(bench):
    while math.hypot(*(bench.world._hull.position_m(0.0))) < CIRCLE_M:
        bench.run(0.2)
    return bench.now_s


def charged(charge):
    return lambda bench: setattr(bench.plant, "charge", charge)


FAILSAFE = {"FS_RESUME": 1}
BATTERY = {"PWR_SAVE_PCT": 30.0, "PWR_KEEP_PCT": 10.0}
EAST = {"current_toward_deg": 90.0}
DRILLS = (
    Drill(
        Fault.COMPASS_LOST, silenced, 1.5, held_then_amidships, spoken, 12.0,
        lambda bench: (bench.run(60.0), undirected(bench, 90.0)),
        start_s=14.0, stands_s=30.0, options={"goals": TURN, "change": None, "no_fix": True},
    ),
    Drill(Fault.COMPASS_SILENT, silenced, 2.0, steers_by_course, spoken, 3.0, stands_s=30.0),
    Drill(
        Fault.COMPASS_FROZEN, lambda bench: setattr(bench.compass, "frozen", True), 31.0, steers_by_course,
        lambda bench: setattr(bench.compass, "frozen", False), 2.0, start_s=25.0,
    ),
    Drill(
        Fault.COMPASS_JUMPING, lambda bench: attitude_off(bench, 180.0), 2.5, undisturbed,
        lambda bench: attitude_off(bench, 0.0), 8.0, start_s=20.0, stands_s=20.0,
    ),
    Drill(
        Fault.COMPASS_DISAGREES, lambda bench: setattr(bench.other_attitude, "error_rad", math.radians(18.0)), 25.0,
        undisturbed, lambda bench: setattr(bench.other_attitude, "error_rad", 0.0), 25.0, start_s=20.0,
        options={"second_compass": True},
    ),
    Drill(
        Fault.POSITION_LOST, lambda bench: fix(bench, there=False), 8.5, in_mode("STEERING"),
        lambda bench: fix(bench, there=True), 2.5, back_in("LOITER"),
        options={"mode": LOITER, "goals": "", "settings": FAILSAFE | {"FS_POS_ACT": 2}},
    ),
    Drill(
        Fault.POSITION_JUMPING, jumped, 4.0, undisturbed, lambda bench: jumped(bench, 0.0), 5.0, stands_s=20.0,
    ),
    Drill(
        Fault.RUDDER_SILENT, lambda bench: bench.lines["rudder"].unplug(), 1.3, alert_only,
        lambda bench: bench.lines["rudder"].plug(), 4.0, rudder_follows, stands_s=3.0, options={"goals": TURN},
    ),
    Drill(
        Fault.RUDDER_ERROR, lambda bench: bench.servo.inject_error(0x10), 1.2, alert_only, nothing, 8.0,
        rudder_follows, stands_s=0.5,
    ),
    Drill(
        Fault.RUDDER_ASTRAY, led_astray, 4.0, alert_only, lambda bench: bench.world.free(), 14.0, rudder_follows,
        start_s=12.5, stands_s=0.1, options={"goals": TURN, "settings": {"RUD_AMP_MAX": 0}},
    ),
    Drill(
        Fault.RUDDER_JAMMED, lambda bench: bench.world.jam(math.radians(-20.0)), 2.5, eased,
        lambda bench: bench.world.free(), 12.0, rudder_follows, start_s=13.0, stands_s=8.0, options={"goals": TURN},
    ),
    Drill(
        Fault.RUDDER_HOT, servo_is(temperature_c=75.0), 3.0, in_mode("HOLD"), servo_is(temperature_c=60.0), 3.0,
        back_in("GUIDED"), stands_s=1.0, options={"settings": FAILSAFE | {"FS_RUD_ACT": 1}},
    ),
    Drill(
        Fault.RUDDER_OVERLOADED, servo_is(load_a=4.0), 3.0, alert_only, servo_is(load_a=0.0), 12.5, rudder_follows,
    ),
    Drill(
        Fault.RUDDER_REPOWERED, lambda bench: bench.servo.power_cycle(bench.now_s, off_s=2.0), 5.0, alert_only,
        nothing, 8.0, rudder_follows, start_s=13.0, stands_s=0.1, options={"goals": TURN},
    ),
    Drill(
        Fault.SUPPLY_LOW, servo_is(voltage_v=10.5), 6.0, in_mode("RTL"), servo_is(voltage_v=12.0), 11.0,
        back_in("GUIDED"), stands_s=1.0, options={"settings": FAILSAFE | {"BAT_LOW_VOLT": 11, "FS_VOLT_ACT": 4}},
    ),
    Drill(
        Fault.BATTERY_LOW, charged(0.25), 35.0, sails_on, charged(0.5), 65.0, back_in("GUIDED"),
        options={"settings": BATTERY, "supply": Supply()},
    ),
    Drill(
        Fault.BATTERY_CRITICAL, charged(0.05), 35.0, in_mode("STEERING"), charged(0.5), 65.0, back_in("GUIDED"),
        stands_s=32.0, options={"settings": BATTERY, "supply": Supply()},
    ),
    Drill(
        Fault.POWER_SILENT, lambda bench: setattr(bench.monitor, "silent", True), 17.0, sails_on,
        lambda bench: setattr(bench.monitor, "silent", False), 3.0, options={"supply": Supply()},
    ),
    Drill(Fault.LOOP_LATE, lambda bench: bench.server.stall(0.5), 1.5, alert_only, nothing, 3.0, stands_s=0.1),
    Drill(Fault.STORAGE_FAILING, logs_gone, 60.0, sails_on, logs_back, 60.0, options={"speed": 10.0}),
    Drill(Fault.STORAGE_FULL, disk_filled, 60.0, sails_on, disk_cleared, 60.0, options={"speed": 10.0}),
    Drill(
        Fault.CLOCK_STEPPED, lambda bench: bench.server.step_utc(365.0 * 86400.0), 1.0, sails_on, nothing, 11.0,
        stands_s=2.0,
    ),
    Drill(
        Fault.STATION_SILENT, silent_station, 11.5, in_mode("LOITER"),
        lambda bench: silent_station(bench, silent=False), 2.0, back_in("GUIDED"),
        options={"settings": FAILSAFE | {"FS_GCS_S": 10, "FS_GCS_ACT": 3}},
    ),
    Drill(
        Fault.FENCE_BREACHED, breached, 8.0, in_mode("RTL"), nothing, 150.0, start_s=5.0, stands_s=1.0,
        options={"plans": (fence(),), "settings": {"FENCE_ENABLE": 1, "LOIT_RADIUS": 10},
                 "change": lambda scenario: replace(scenario, speed_m_s=0.8)},
    ),
    Drill(
        Fault.MISSION_UNUSABLE, cleared, 3.0, lambda bench, _t0_s: back_in("AUTO")(bench),
        lambda bench: bench.order(SET_MODE, 1.0, float(GUIDED)), 2.0, back_in("GUIDED"), start_s=10.0, stands_s=1.0,
        options={"mode": AUTO, "plans": (endless(),), "goals": ""},
    ),
    Drill(
        Fault.STEERING_LOST, lambda bench: setattr(bench.world, "rudder_effect", 0.0), 90.0, alert_only,
        lambda bench: setattr(bench.world, "rudder_effect", 1.0), 240.0, start_s=10.0, stands_s=1.0,
        options={"goals": TURN},
    ),
    Drill(
        Fault.STEERING_REVERSED, lambda bench: setattr(bench.world, "rudder_effect", -1.0), 180.0, alert_only,
        lambda bench: setattr(bench.world, "rudder_effect", 1.0), 400.0, start_s=10.0, stands_s=1.0,
        options={"goals": TURN},
    ),
    Drill(Fault.KEY_LOST, key_lost, 5.0, reported_with_its_cause, key_removed, 3.0, stands_s=1.0),
    Drill(
        Fault.HELM_OSCILLATES, nothing, 300.0, alert_only, nothing, 400.0, stands_s=1.0,
        options={"goals": TURN, "change": lambda scenario: with_disturbances(scenario, "kt=1:3,delay=8")},
    ),
    Drill(
        Fault.CURRENT_STRONG, lambda bench: bench.order(SET_MODE, 1.0, float(LOITER)), 1800.0, points_into_it,
        nothing, 0.0, options={"change": lambda scenario: replace(scenario, current_m_s=0.48, **EAST)},
    ),
)  # fmt: skip


def undirected(bench, goal_deg):
    assert abs(bench.heading_error_deg(goal_deg)) < 10.0


def prepared(fault_bench, drill, tmp_path):
    options = dict(drill.options)
    no_fix = options.pop("no_fix", False)
    if drill.fault is Fault.STORAGE_FULL:
        options["settings"] = {"LOG_FREE_MB": nearly_full_mb(tmp_path)}
    bench = fault_bench(**options)
    if no_fix:
        bench.gps.fix = False
    bench.under_way(options.get("mode", GUIDED))
    if bench.now_s < drill.start_s:
        bench.run(drill.start_s - bench.now_s)
    return bench


def test_every_row_has_a_drill():
    """But two: tests/process/test_vessels.py has the ships; no device that fails makes a filter over-confident."""
    others = {Fault.VESSEL_NEAR, Fault.ESTIMATE_INCONSISTENT}
    assert sorted(drill.fault for drill in DRILLS) == sorted(set(TABLE) - others)


# Left to the proof: each of these is detected and reported in the suite by another test, of the units, the voyages or a
# process (test_cables, test_ashore, test_drill, clients/test_key_command).
PROOFS = {
    Fault.COMPASS_LOST,
    Fault.COMPASS_SILENT,
    Fault.COMPASS_FROZEN,
    Fault.COMPASS_DISAGREES,
    Fault.POSITION_JUMPING,
    Fault.RUDDER_SILENT,
    Fault.RUDDER_OVERLOADED,
    Fault.SUPPLY_LOW,
    Fault.BATTERY_LOW,
    Fault.BATTERY_CRITICAL,
    Fault.LOOP_LATE,
    Fault.POWER_SILENT,
    Fault.STORAGE_FAILING,
    Fault.STORAGE_FULL,
    Fault.CLOCK_STEPPED,
    Fault.STATION_SILENT,
    Fault.FENCE_BREACHED,
    Fault.STEERING_LOST,
    Fault.STEERING_REVERSED,
    Fault.KEY_LOST,
    Fault.HELM_OSCILLATES,
    Fault.CURRENT_STRONG,
}


@pytest.mark.parametrize(
    "drill",
    [pytest.param(drill, marks=pytest.mark.proof) if drill.fault in PROOFS else drill for drill in DRILLS],
    ids=lambda drill: drill.fault.name,
)
def test_a_fault_is_reported_acted_on_and_cleared(fault_bench, drill, tmp_path):
    row = TABLE[drill.fault]
    bench = prepared(fault_bench, drill, tmp_path)
    t0_s = 0.0 if drill.broken is nothing else bench.now_s
    t0_s = drill.broken(bench) or t0_s
    bench.until(row.text, drill.within_s, since_s=t0_s)
    if bench.now_s < t0_s + drill.stands_s:
        bench.run(t0_s + drill.stands_s - bench.now_s)
    drill.holds(bench, t0_s)
    if drill.over_s == 0.0:
        return
    t1_s = t0_s if drill.mended is nothing else bench.now_s
    drill.mended(bench)
    bench.until(row.recovery, drill.over_s, since_s=t1_s)
    drill.after(bench)


def test_a_clock_step_of_a_year_is_reported_and_does_not_affect_control(fault_bench):
    row, trails = TABLE[Fault.CLOCK_STEPPED], []
    for name, step_s in (("plain", 0.0), ("stepped", 365.0 * 86400.0)):
        bench = fault_bench(name=name, goals=TURN, scenario="sea")
        bench.under_way(GUIDED)
        bench.run(14.0 - bench.now_s)
        if step_s:
            bench.server.step_utc(step_s)
            bench.until(row.text, 1.0)
            bench.until(row.recovery, 11.0)
        bench.run(27.0 - bench.now_s)
        trails.append(bench.trail)
    assert trails[0] == trails[1]
    assert bench.widest_deg(14.0) > 10.0


@pytest.mark.parametrize("compass", ["nmea", pytest.param("pni", marks=pytest.mark.proof)])
def test_the_rudder_never_stays_far_over_without_a_heading(fault_bench, compass):
    """A compass that freezes in a turn keeps the boat turning; even with a long hold time the rudder is centred."""
    bench = fault_bench(goals=TURN, compass=compass, settings={"CTL_HOLD_S": 600})
    bench.gps.fix = False
    bench.under_way(GUIDED)
    bench.run(14.0 - bench.now_s)
    bench.compass.frozen = True
    frozen_s = bench.now_s
    bench.until("No valid heading", 33.0)
    assert TABLE[Fault.COMPASS_FROZEN].text in bench.texts_since(frozen_s)
    assert abs(bench.rudder_deg()) > 10.0
    bench.run(31.0)
    assert abs(bench.rudder_deg()) < 0.5
    bench.compass.frozen = False
    bench.until("Heading recovered", 15.0)  # from an estimate that nothing has corrected meanwhile
    bench.run(5.0)
    assert abs(bench.rudder_deg()) > 1.0


def test_a_run_with_many_faults_replays_bit_for_bit(fault_bench):
    bench = fault_bench(goals=TURN, settings={"FS_GCS_S": 5, "FS_GCS_ACT": 3, "FS_RESUME": 1})
    bench.under_way(GUIDED)
    bench.run(13.0 - bench.now_s)
    bench.world.jam(math.radians(20.0))
    bench.server.step_utc(-365.0 * 86400.0)
    bench.station.silent = True
    bench.run(12.0)
    bench.world.free()
    bench.compass.silent = True
    bench.servo.power_cycle(bench.now_s, 1.0)
    bench.run(8.0)
    bench.compass.silent = bench.station.silent = False
    jumped(bench)
    bench.run(10.0)
    logs = bench.finish()
    assert logs
    assert all(main(["replay", str(log)]) == 0 for log in logs)


@pytest.mark.proof
def test_the_servo_rests_while_the_command_stands_and_engages_before_it_moves(fault_bench):
    bench = fault_bench(scenario="calm", settings={"RUD_REST_S": 3})
    bench.under_way(GUIDED)
    bench.run(240.0 - bench.now_s)  # until the filter has learned how calm it is
    torque = []
    while bench.now_s < 280.0 or torque[-1] != 0:
        bench.run(0.5)
        torque.append(bench.servo.motor._table[64])
    assert torque.count(0) > 0.4 * len(torque)
    assert abs(bench.heading_error_deg()) < 2.0
    bench.order(CHANGE_HEADING, 1.0, 60.0)
    t0_s = bench.now_s
    bench.run(4.0)
    assert bench.widest_deg(t0_s) > 10.0
    assert not any("power" in text or "jammed" in text for text in bench.texts_since(0.0))


def test_the_other_servo_keeps_steering_when_rest_is_set(fault_bench):
    bench = fault_bench(scenario="calm", servo="volz", goals="0:0,20:60", settings={"RUD_REST_S": 3})
    bench.under_way(GUIDED)
    bench.run(25.0 - bench.now_s)
    assert bench.widest_deg(20.0) > 10.0
    assert bench.texts_since(3.0) == []


@pytest.mark.proof
@pytest.mark.parametrize("compass", ["pni", "nmea"])
def test_a_jam_at_20_degrees_is_seen_on_the_other_servo_too(fault_bench, compass):
    bench = fault_bench(servo="volz", compass=compass, goals=TURN)
    bench.under_way(GUIDED)
    bench.run(13.0 - bench.now_s)
    bench.world.jam(math.radians(-20.0))
    bench.until("Rudder jammed", 2.5)
    bench.world.free()
    bench.until("Rudder no longer jammed", 12.0)
    rudder_follows(bench)


@pytest.mark.parametrize(
    ("rate_hz", "seconds", "found_s"),
    [
        (0.5, 30.0, 6.5),
        pytest.param(1.0, 3600.0, 4.0, marks=[pytest.mark.proof, pytest.mark.timeout(900)]),
    ],
)
def test_a_slow_compass_raises_no_fault_and_its_loss_is_detected(fault_bench, rate_hz, seconds, found_s):
    bench = fault_bench(compass_rate_hz=rate_hz)
    bench.under_way(GUIDED)
    bench.run(seconds)
    assert abs(bench.heading_error_deg()) < 3.0
    texts = bench.texts_since(0.0)
    assert not any(text.startswith((row.text, "Heading lost")) for text in texts for row in TABLE.values())
    silenced(bench)
    bench.until(TABLE[Fault.COMPASS_SILENT].text, found_s)
    spoken(bench)
    bench.until(TABLE[Fault.COMPASS_SILENT].recovery, 6.0)
    logs = bench.finish()
    assert all(main(["replay", str(log)]) == 0 for log in logs)
