"""Fields of the telemetry messages in the units of MAVLink, for all possible snapshots."""

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.common.mode_table import Mode, StandardMode
from firmware_py.common.records import CalibrationState, FixType, PositionSample, RudderFeedback
from firmware_py.common.reports import (
    Activity,
    DeadReckoningPosition,
    Energy,
    Estimate,
    Flow,
    Home,
    MissionReport,
    MissionState,
    Navigation,
    Power,
    Snapshot,
    SwingReport,
    Water,
)
from firmware_py.faults.table import Fault
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.identity import (
    Version,
    autopilot_version,
    available_modes,
    mode_of_standard,
    protocol_version,
)
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Codec, stamp

CODEC = Codec(1, 1)
FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, math.pi / 2, 8, 1.25)
SERVO = RudderFeedback(0.0, 0.1, 31.0, 12.3, -0.25)
DEAD_RECKONING = {
    "position": FIX,
    "position_ok": False,
    "dead_reckoning": DeadReckoningPosition(0.71, -0.21, 0.3, -0.4, 250.0, 3600.0),
}


@pytest.fixture
def build(snapshot):
    def build_message(name, **changes):
        names = (
            "load",
            "refused_frames",
            "intended_mode",
            "utc_s",
            "fence_breaches",
            "override_us",
            "swing",
            "written",
        )
        values = {"load": 0.0, "refused_frames": 0, "utc_s": 1.7e9}
        values |= {key: changes.pop(key) for key in names if key in changes}
        boat = msgspec.structs.replace(snapshot, **changes)
        (row,) = (row for row in TABLE if row.name == name)
        message = row.build(TelemetryContext(boat, rudder_limit_rad=0.5, autopilot=3, **values))
        return None if message is None else CODEC.decode(stamp(CODEC.pack(message), 0))

    return build_message


# MAV_MODE_FLAG: 1 custom mode, 4 auto, 8 guided, 16 stabilized, 64 manual input, 128 armed.
@pytest.mark.parametrize(
    ("mode", "armed", "faults", "base_mode", "status"),
    [
        (Mode.MANUAL, False, 0, 1 | 64, mavlink.MAV_STATE_STANDBY),
        (Mode.STEERING, True, 0, 1 | 128 | 64 | 16, mavlink.MAV_STATE_ACTIVE),
        (Mode.HOLD, True, 1 << Fault.POSITION_LOST, 1 | 128, mavlink.MAV_STATE_ACTIVE),
        (Mode.LOITER, True, 0, 1 | 128 | 8 | 16, mavlink.MAV_STATE_ACTIVE),
        (Mode.AUTO, True, 0, 1 | 128 | 8 | 16 | 4, mavlink.MAV_STATE_ACTIVE),
        (Mode.RTL, True, 0, 1 | 128 | 8 | 16 | 4, mavlink.MAV_STATE_ACTIVE),
        (Mode.GUIDED, True, 1 << Fault.COMPASS_LOST, 1 | 128 | 8 | 16, mavlink.MAV_STATE_CRITICAL),
    ],
)
def test_heartbeat_contains_mode_and_state(build, mode, armed, faults, base_mode, status):
    heartbeat = build("HEARTBEAT", mode=mode, armed=armed, faults=faults)
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.mavlink_version) == (mavlink.MAV_TYPE_SURFACE_BOAT, 3, 3)
    assert (heartbeat.custom_mode, heartbeat.base_mode, heartbeat.system_status) == (mode, base_mode, status)


def test_attitude_and_vfr_hud_contain_the_heading(build):
    attitude = build("ATTITUDE", heading_rad=5.0)
    assert attitude.time_boot_ms == 12_500
    assert (attitude.roll, attitude.pitch, attitude.yaw) == pytest.approx((0.1, -0.2, 5.0 - 2 * math.pi))
    assert attitude.yawspeed == pytest.approx(0.01)
    hud = build("VFR_HUD", heading_rad=math.radians(359.6), position=FIX, position_ok=True)
    assert (hud.heading, hud.groundspeed, hud.alt) == (0, 0.5, 3.0)


@pytest.mark.parametrize("name", ["ATTITUDE", "VFR_HUD"])
@pytest.mark.parametrize("changes", [{"heading_ok": False}, {"heading_rad": None}])
def test_old_heading_is_not_sent(build, name, changes):
    assert build(name, **changes) is None


def test_global_position_is_the_fix(build):
    position = build("GLOBAL_POSITION_INT", position=FIX, position_ok=True, home=Home(0.7, -0.2, 1.0))
    assert (position.lat, position.lon) == (round(math.degrees(0.7) * 1e7), round(math.degrees(-0.2) * 1e7))
    assert (position.alt, position.relative_alt, position.vx, position.vy) == (3000, 2000, 0, 50)
    assert position.hdg == round(math.degrees(1.0) * 100)
    assert build("GLOBAL_POSITION_INT", position=FIX, position_ok=True, heading_ok=False).hdg == 65535
    assert build("GLOBAL_POSITION_INT", position=FIX, position_ok=False) is None
    assert build("GLOBAL_POSITION_INT", heading_rad=math.radians(359.998), position=FIX, position_ok=True).hdg == 0
    incomplete = {"position": PositionSample(0.0, FixType.FIX_2D, 0.7, -0.2), "position_ok": True}
    position = build("GLOBAL_POSITION_INT", **incomplete)
    assert (position.alt, position.relative_alt, position.vx, position.vy) == (0, 0, 0, 0)
    incomplete["position"] = msgspec.structs.replace(FIX, course_over_ground_rad=None)
    position = build("GLOBAL_POSITION_INT", **incomplete)
    assert (position.relative_alt, position.vx, position.vy) == (0, 50, 0)
    incomplete["position"] = msgspec.structs.replace(FIX, course_over_ground_rad=math.inf)
    position = build("GLOBAL_POSITION_INT", **incomplete)
    assert (position.vx, position.vy) == (0, 0)


def test_dead_reckoning_is_sent_without_a_fix(build):
    for name, latitude in (("GLOBAL_POSITION_INT", "lat"), ("HIGH_LATENCY2", "latitude")):
        assert getattr(build(name, **DEAD_RECKONING), latitude) == round(math.degrees(0.71) * 1e7)
    position, raw = build("GLOBAL_POSITION_INT", **DEAD_RECKONING), build("GPS_RAW_INT", **DEAD_RECKONING)
    assert (position.vx, position.vy, position.alt) == (30, -40, 3000)
    assert (raw.fix_type, raw.lat) == (1, 0)
    assert not build("SYS_STATUS", **DEAD_RECKONING).onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_GPS


def test_gps_raw_int_has_the_numbers_for_unknown(build):
    known = build("GPS_RAW_INT", position=FIX, position_ok=True)
    assert (known.fix_type, known.eph, known.epv, known.vel, known.cog) == (3, 125, 65535, 50, 9000)
    assert (known.satellites_visible, known.lat) == (8, round(math.degrees(0.7) * 1e7))
    old = build("GPS_RAW_INT", position=FIX, position_ok=False)
    assert (old.fix_type, old.lat, old.vel) == (1, 0, 65535)
    assert build("GPS_RAW_INT", position=msgspec.structs.replace(FIX, t_s=3.5), position_ok=True).time_usec == 3_500_000
    without_receiver = build("GPS_RAW_INT")
    velocity = (without_receiver.eph, without_receiver.vel, without_receiver.cog)
    assert (without_receiver.fix_type, *velocity, without_receiver.satellites_visible) == (0, *[65535] * 3, 255)


def test_goal_is_sent(build):
    nav = build("NAV_CONTROLLER_OUTPUT", bearing_rad=3.0, distance_m=1e6)
    assert (nav.nav_bearing, nav.target_bearing, nav.wp_dist) == (115, 172, 65535)
    target = build("ATTITUDE_TARGET", goal_heading_rad=2.0)
    assert 2 * math.atan2(target.q[3], target.q[0]) == pytest.approx(2.0)
    assert build("NAV_CONTROLLER_OUTPUT", navigation=Navigation(cross_track_m=-12.5)).xtrack_error == -12.5
    assert build("NAV_CONTROLLER_OUTPUT", goal_heading_rad=None) is None
    assert build("ATTITUDE_TARGET", goal_heading_rad=None) is None


@pytest.mark.parametrize(
    ("command_rad", "pulse_us"), [(0.0, 1500), (0.5, 2000), (-0.5, 1000), (0.25, 1750), (9.0, 2000)]
)
def test_servo_output_is_the_command_and_rudder_the_measured_angle(build, command_rad, pulse_us):
    assert build("SERVO_OUTPUT_RAW", rudder_command_rad=command_rad).servo1_raw == pulse_us
    assert build("NAMED_VALUE_FLOAT RUDDER").value == pytest.approx(math.degrees(0.2), abs=1e-5)
    assert build("NAMED_VALUE_FLOAT RUD_CMD").value == pytest.approx(math.degrees(0.25), abs=1e-5)
    assert build("NAMED_VALUE_FLOAT RUDDER", rudder_rad=None) is None
    assert build("NAMED_VALUE_FLOAT RUD_EST") is None
    estimated = build("NAMED_VALUE_FLOAT RUD_EST", rudder_rad=None, rudder_estimate_rad=-0.1)
    assert (estimated.name, estimated.value) == ("RUD_EST", pytest.approx(math.degrees(-0.1), abs=1e-5))


COMPASS_SENSORS = 1 | 2 | 4  # gyro, accelerometer, magnetometer


def test_sys_status_shows_healthy_and_failed_sensors(build):
    healthy = build("SYS_STATUS", position=FIX, position_ok=True, servo=SERVO, load=0.015, refused_frames=70_000)
    sensors = COMPASS_SENSORS | mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert healthy.onboard_control_sensors_present & sensors == sensors
    assert healthy.onboard_control_sensors_health & sensors == sensors
    assert (healthy.voltage_battery, healthy.current_battery, healthy.battery_remaining) == (12_300, 25, -1)
    assert (healthy.load, healthy.errors_comm) == (15, 65535)
    rudder = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    assert healthy.onboard_control_sensors_health & rudder
    for faults in (1 << Fault.RUDDER_SILENT, 1 << Fault.RUDDER_ERROR):
        assert not build("SYS_STATUS", faults=faults).onboard_control_sensors_health & rudder
    assert not build("SYS_STATUS", rudder_ok=False).onboard_control_sensors_health & rudder
    storage = mavlink.MAV_SYS_STATUS_LOGGING
    health = [
        build("SYS_STATUS", faults=faults).onboard_control_sensors_health for faults in (0, 1 << Fault.STORAGE_FAILING)
    ]
    assert [bool(bits & storage) for bits in health] == [True, False]
    failed = build("SYS_STATUS", heading_ok=False, position=FIX, prearm_refusal="no heading")
    assert failed.onboard_control_sensors_present & sensors == sensors
    assert failed.onboard_control_sensors_health & sensors == 0
    assert (failed.voltage_battery, failed.current_battery) == (65535, -1)
    assert not build("SYS_STATUS").onboard_control_sensors_present & mavlink.MAV_SYS_STATUS_SENSOR_GPS


FENCE = mavlink.MAV_SYS_STATUS_GEOFENCE


def test_sys_status_shows_presence_enabling_and_breach_of_the_fence(build):
    def fence_bits(**changes):
        status = build("SYS_STATUS", **changes)
        fields = ("present", "enabled", "health")
        return [bool(getattr(status, f"onboard_control_sensors_{name}") & FENCE) for name in fields]

    fence = {"mission": MissionReport(identities=(0, 77, 0))}
    enabled = {"navigation": Navigation(fence_enabled=True)}
    assert fence_bits() == [False, False, True]
    assert fence_bits(**enabled) == [False, False, True]
    assert fence_bits(**fence) == [True, False, True]
    assert fence_bits(**fence, **enabled) == [True, True, True]
    assert fence_bits(**fence, **enabled, faults=1 << Fault.FENCE_BREACHED) == [True, True, False]


def test_estimates_are_sent_as_named_values(build):
    estimate = Estimate(
        1, *(math.radians(number) for number in range(2, 7)), 0.1, 6.5, 0.2, *([0.5] * 5), 0.3, 0.0, 0.9,
        yaw_diffusion_rad2_s=2.5 * math.radians(1.0) ** 2, prediction_square=1.1,
    )  # fmt: skip
    water = Water(0.8, 0.05, 0.1, -0.2, 0.04, leeway_rad=math.radians(7.0))
    values = {
        "LEEWAY": 7,
        "HDG_SRC": 1,
        "HDG_SD": 3,
        "TRIM": 6,
        "WAVE_SD": math.degrees(0.2),
        "WAVE_T": 6.5,
        "YAW_DIFF": 2.5,
        "PRED_SQ": 1.1,
        "HDG_INNOV": math.degrees(0.3),
        "HDG_NIS": 0.9,
        "WATER_SPD": 0.8,
        "CURR_N": 0.1,
        "CURR_E": -0.2,
        "CURR_SD": 0.04,
    }
    for name, value in values.items():
        assert build(f"NAMED_VALUE_FLOAT {name}", estimate=estimate, water=water).value == pytest.approx(value), name
        assert build(f"NAMED_VALUE_FLOAT {name}") is None
    assert build("VFR_HUD", water=water).airspeed == pytest.approx(0.8)
    assert build("HIGH_LATENCY2", water=water).airspeed == 4


@pytest.mark.parametrize(
    ("name", "changes", "value"),
    [
        ("STO_WRITES", {"written": (7, 2_500_000)}, 7),
        ("STO_MB", {"written": (7, 2_500_000)}, 2.5),
        ("RUD_TRAVEL", {"energy": Energy(travel_rad_per_h=math.radians(900.0))}, 900),
        ("RUD_REVERS", {"energy": Energy(reversals_per_h=12.0)}, 12),
        ("RUD_WH", {"energy": Energy(energy_j=5400.0, power_w=0.5)}, 1.5),
        ("RUD_WATT", {"energy": Energy(energy_j=5400.0, power_w=0.5)}, 0.5),
    ],
)
def test_storage_and_energy_are_sent_as_named_values(build, name, changes, value):
    message = build(f"NAMED_VALUE_FLOAT {name}", **changes)
    assert (message.name, message.value, message.time_boot_ms) == (name, pytest.approx(value), 12_500)
    assert build(f"NAMED_VALUE_FLOAT {name}") is None
    assert build("NAMED_VALUE_FLOAT RUD_WH", energy=Energy(energy_j=5400.0)) is None
    assert build("NAMED_VALUE_FLOAT HELM_SOFT", gain_reduction=8.0).value == 8.0


def test_battery_status_has_one_voltage(build):
    assert build("BATTERY_STATUS", servo=SERVO) is None  # the supply of the servo is not the battery
    battery = build("BATTERY_STATUS", power=Power(12.3))
    assert battery.voltages == [12_300] + [65535] * 9
    assert (battery.temperature, battery.current_consumed, battery.battery_remaining) == (32767, -1, -1)
    assert build("BATTERY_STATUS") is None


BATTERY_BIT = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
BATTERY = Power(13.1, -1.5, 0.876, 9.5, 20.0, 39.65, load=Flow(7200.0, 60.0), discharged=Flow(720.0, 60.0))


def test_measured_battery_replaces_the_supply_of_the_servo(build):
    battery = build("BATTERY_STATUS", servo=SERVO, power=BATTERY)
    assert (battery.voltages[0], battery.current_battery, battery.battery_remaining) == (13_100, 150, 88)
    assert (battery.temperature, battery.energy_consumed) == (950, 72)
    status = build("SYS_STATUS", servo=SERVO, power=BATTERY)
    assert (status.voltage_battery, status.current_battery, status.battery_remaining) == (13_100, 150, 88)
    assert status.onboard_control_sensors_present & status.onboard_control_sensors_health & BATTERY_BIT
    report = build("HIGH_LATENCY2", servo=SERVO, power=BATTERY)
    assert (report.battery, report.custom1) == (88, 66)
    assert build("NAMED_VALUE_FLOAT SOLAR_W", power=BATTERY).value == 20.0
    assert build("NAMED_VALUE_FLOAT LOAD_W", power=BATTERY).value == pytest.approx(39.65)


def test_silent_battery_monitor_is_not_healthy(build):
    status = build("SYS_STATUS", servo=SERVO, power=Power())
    assert status.onboard_control_sensors_present & BATTERY_BIT
    assert not status.onboard_control_sensors_health & BATTERY_BIT
    assert (status.voltage_battery, status.battery_remaining) == (12_300, -1)


def test_charging_current_is_negative_and_not_the_number_for_unknown(build):
    assert build("SYS_STATUS", power=Power(13.1, 4.2)).current_battery == -420
    assert build("SYS_STATUS", power=Power(13.1, 0.01)).current_battery == 0
    assert build("SYS_STATUS", power=Power(13.1)).current_battery == -1
    assert build("BATTERY_STATUS", power=Power(13.1, discharged=Flow(720.0, 60.0))).energy_consumed == 7


def test_fence_status_is_sent_with_a_fence_or_after_a_breach(build):
    fence = MissionReport(identities=(0, 7, 0))
    assert build("FENCE_STATUS") is None
    intact = build("FENCE_STATUS", mission=fence)
    assert (intact.breach_status, intact.breach_count, intact.breach_type, intact.breach_time) == (0, 0, 0, 0)
    breached = build("FENCE_STATUS", mission=fence, faults=1 << Fault.FENCE_BREACHED, fence_breaches=(3, 12.5))
    values = (breached.breach_status, breached.breach_count, breached.breach_type, breached.breach_time)
    assert values == (1, 3, mavlink.FENCE_BREACH_BOUNDARY, 12_500)
    cleared = build("FENCE_STATUS", fence_breaches=(3, 12.5))
    assert (cleared.breach_status, cleared.breach_count, cleared.breach_type) == (0, 3, mavlink.FENCE_BREACH_NONE)


def test_system_time_is_zero_for_an_implausible_clock(build):
    time = build("SYSTEM_TIME", t_s=5_000_000.0)
    assert time.time_unix_usec == 1_700_000_000_000_000
    assert time.time_boot_ms == 5_000_000_000 % 2**32
    assert build("SYSTEM_TIME", utc_s=4.3e9).time_unix_usec == build("SYSTEM_TIME", utc_s=-1.0).time_unix_usec == 0


def test_lateness_and_servo_temperature_are_sent(build):
    assert build("NAMED_VALUE_FLOAT LATE_MS").value == pytest.approx(0.5)
    assert build("NAMED_VALUE_FLOAT SKIPPED", skipped_total=7).value == 7
    assert build("NAMED_VALUE_FLOAT RUD_TEMP", servo=SERVO).value == 31


def test_current_mode_contains_the_intended_mode(build):
    mode = build("CURRENT_MODE", mode=Mode.STEERING)
    assert (mode.standard_mode, mode.custom_mode, mode.intended_custom_mode) == (0, Mode.STEERING, Mode.STEERING)
    mode = build("CURRENT_MODE", mode=Mode.AUTO)
    assert (mode.standard_mode, mode.custom_mode) == (StandardMode.MISSION, Mode.AUTO)
    mode = build("CURRENT_MODE", mode=Mode.LOITER, intended_mode=int(Mode.AUTO))  # a fault changed the mode
    assert (mode.standard_mode, mode.custom_mode, mode.intended_custom_mode) == (0, Mode.LOITER, Mode.AUTO)


def test_names_are_short_and_the_index_is_complete():
    assert all(
        len(row.name.split()[-1]) <= 10 for row in TABLE if row.number == mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
    )
    assert sorted(index for rows in ROWS_OF.values() for index in rows) == list(range(len(TABLE)))


NUMBERS = st.floats() | st.sampled_from([0.0, -0.0, 1e300, -1e300, 3.5e38, 1e-300])
OPTIONAL = st.none() | NUMBERS
COUNTS = st.integers(0, 2**70)
POSITIONS = st.builds(
    PositionSample,
    NUMBERS,
    st.sampled_from(FixType),
    OPTIONAL,
    OPTIONAL,
    OPTIONAL,
    OPTIONAL,
    OPTIONAL,
    st.none() | COUNTS,
    OPTIONAL,
)
SERVOS = st.builds(RudderFeedback, NUMBERS, OPTIONAL, OPTIONAL, OPTIONAL, OPTIONAL)
SNAPSHOTS = st.builds(
    Snapshot,
    t_s=NUMBERS, tick=COUNTS, mode=st.sampled_from(Mode), armed=st.booleans(),
    heading_rad=OPTIONAL, heading_ok=st.booleans(), yaw_rate_rad_s=OPTIONAL, roll_rad=OPTIONAL, pitch_rad=OPTIONAL,
    goal_heading_rad=OPTIONAL, heading_error_rad=OPTIONAL, bearing_rad=OPTIONAL, distance_m=OPTIONAL,
    rudder_rad=OPTIONAL, rudder_estimate_rad=OPTIONAL, rudder_command_rad=NUMBERS, rudder_ok=st.booleans(),
    servo=st.none() | SERVOS,
    position=st.none() | POSITIONS, position_ok=st.booleans(), faults=st.integers(0, 63),
    rate_hz=NUMBERS, skipped_total=COUNTS, late_s=NUMBERS, home=st.none() | st.builds(Home, NUMBERS, NUMBERS, NUMBERS),
    mission=st.builds(MissionReport, index=st.none() | COUNTS, count=COUNTS), prearm_refusal=st.text(max_size=5),
    estimate=st.none() | st.builds(Estimate, st.integers(0, 3), *([NUMBERS] * 17)),
    water=st.none() | st.builds(Water, *([NUMBERS] * 5)),
    navigation=st.builds(Navigation, st.sampled_from(Activity), *([OPTIONAL] * 4), st.booleans(), st.booleans()),
)  # fmt: skip


@settings(max_examples=25)
@given(SNAPSHOTS, NUMBERS, NUMBERS, COUNTS)
def test_any_snapshot_is_packed_or_omitted(snapshot, utc_s, load, refused):
    context = TelemetryContext(snapshot, utc_s, 0.5, 3, load, refused)
    for row in TABLE:
        message = row.build(context)
        assert message is None or CODEC.pack(message).frame


@pytest.mark.parametrize(("satellites", "sent"), [(None, 255), (0, 0), (254, 254), (255, 254), (300, 254)])
def test_number_of_satellites_is_limited_below_the_number_for_unknown(build, satellites, sent):
    fix = msgspec.structs.replace(FIX, satellites=satellites)
    assert build("GPS_RAW_INT", position=fix, position_ok=True).satellites_visible == sent


RUDDER_FAULTS = (
    Fault.RUDDER_SILENT, Fault.RUDDER_ERROR, Fault.RUDDER_ASTRAY, Fault.RUDDER_JAMMED, Fault.STEERING_LOST,
)  # fmt: skip
BATTERY_FAULTS = (Fault.SUPPLY_LOW, Fault.BATTERY_LOW, Fault.BATTERY_CRITICAL)
FAILURE_FLAGS = {
    Fault.COMPASS_LOST: mavlink.HL_FAILURE_FLAG_3D_MAG | mavlink.HL_FAILURE_FLAG_ESTIMATOR,
    Fault.POSITION_LOST: mavlink.HL_FAILURE_FLAG_GPS,
    **dict.fromkeys(RUDDER_FAULTS, mavlink.HL_FAILURE_FLAG_ENGINE),
    **dict.fromkeys(BATTERY_FAULTS, mavlink.HL_FAILURE_FLAG_BATTERY),
    Fault.FENCE_BREACHED: mavlink.HL_FAILURE_FLAG_GEOFENCE,
    Fault.MISSION_UNUSABLE: mavlink.HL_FAILURE_FLAG_MISSION,
}


@pytest.mark.parametrize("fault", Fault)
def test_failure_flags_of_satellite_reports(build, fault):
    assert build("HIGH_LATENCY2", faults=1 << fault).failure_flags == FAILURE_FLAGS.get(fault, 0)


@pytest.mark.parametrize(
    ("armed", "heading_ok", "estimate_rad", "bits"), [(True, False, None, 1), (False, True, 0.1, 2 | 4)]
)
def test_state_bits_of_satellite_reports(build, armed, heading_ok, estimate_rad, bits):
    """1: armed, 2: valid heading, 4: estimated rudder angle."""
    report = build("HIGH_LATENCY2", armed=armed, heading_ok=heading_ok, rudder_estimate_rad=estimate_rad)
    assert report.custom2 == bits
    assert build("HIGH_LATENCY2", rudder_rad=None).custom0 == -128


@pytest.mark.parametrize(
    ("mode", "report", "expected"),
    [
        (Mode.AUTO, MissionReport(MissionState.ACTIVE, 2, 5, identities=(7, 8, 9)), (3, 5, 3, 1, 7, 8, 9)),
        (Mode.HOLD, MissionReport(), (0, 65535, 1, 2, 0, 0, 0)),
    ],
)
def test_mission_current_has_item_state_and_identities(build, mode, report, expected):
    current = build("MISSION_CURRENT", mode=mode, mission=report)
    identities = (current.mission_id, current.fence_id, current.rally_points_id)
    assert (current.seq, current.total, current.mission_state, current.mission_mode, *identities) == expected


def test_swing_of_the_compass_has_progress_and_report(build):
    progress = build("MAG_CAL_PROGRESS", swing=SwingReport(CalibrationState.RUNNING, 40, sectors=0b101))
    assert progress.to_dict() == {
        "mavpackettype": "MAG_CAL_PROGRESS", "compass_id": 0, "cal_mask": 1, "cal_status": 2, "attempt": 1,
        "completion_pct": 40, "completion_mask": "\x05", "direction_x": 0, "direction_y": 0, "direction_z": 0,
    }  # fmt: skip
    report = build("MAG_CAL_REPORT", swing=SwingReport(CalibrationState.DONE, 100, residual_after_rad=math.radians(2)))
    values = report.to_dict()
    assert [values.pop(name) for name in ("compass_id", "cal_mask", "cal_status", "fitness")] == [
        0,
        1,
        4,
        pytest.approx(2),
    ]
    assert {value for name, value in values.items() if name != "mavpackettype"} == {0}
    assert build("MAG_CAL_PROGRESS") is None


def test_modes_and_protocol_have_their_numbers():
    modes = {mode.custom_mode: (mode.standard_mode, mode.properties, mode.number_modes) for mode in available_modes(0)}
    assert modes[16] == (0, 2, len(Mode) + 1)  # before the first tick; it cannot be selected
    assert {number: properties for number, (_, properties, _) in modes.items() if number != 16} == {
        mode: 0 if mode in (Mode.MANUAL, Mode.STEERING) else 4 for mode in Mode
    }
    assert {number: standard for number, (standard, _, _) in modes.items() if standard} == {10: 6, 11: 5}
    assert [mode_of_standard(number) for number in (0, 5, 6, 7)] == [None, 11, 10, None]
    version = protocol_version()
    assert (version.version, version.min_version, version.max_version) == (200, 100, 200)
    version = autopilot_version(Version())
    assert (version.flight_sw_version, version.uid, bytes(version.flight_custom_version)) == (0, 0, bytes(8))
    version = vars(autopilot_version(Version(3, 4, 5, "0123456789", (1 << 65) + 7)))
    assert version.pop("capabilities") == 4 + 8 + 32 + 64 + 128 + 256 + 8192 + 16384 + 32768 + 131072
    assert version.pop("flight_sw_version") == 0x03040500
    assert (bytes(version.pop("flight_custom_version")), version.pop("uid")) == (b"01234567", 7)
    zeros = ("middleware_sw_version", "os_sw_version", "board_version", "vendor_id", "product_id")
    assert [version[name] for name in zeros] == [0] * 5
    assert bytes(version["middleware_custom_version"]) == bytes(version["os_custom_version"]) == bytes(8)
