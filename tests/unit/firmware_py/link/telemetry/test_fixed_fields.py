"""Fields of MAVLink messages: values that are not measured, and limits of those that are out of range."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Activity, Flow, Home, MissionReport, Navigation, Power
from firmware_py.link.telemetry.fields import TelemetryContext, boot_ms, boot_us, to_float32
from firmware_py.link.telemetry.table import TABLE

FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, 0.3, 8, 1.25)
BOAT = {
    "position": FIX,
    "position_ok": True,
    "home": Home(0.6999, -0.2001, 1.0),
    "goal_heading_rad": 1.5,
    "bearing_rad": 1.4,
    "distance_m": 123.0,
    "navigation": Navigation(Activity.STATION, 0.7, -0.2, 40.0, 2.0),
    "power": Power(12.0, -1.0, 0.5, 20.0, 3.0, 4.0),
}
# Fields by message; 65535, 255 and -1 mean unknown.
FIXED = {
    "ATTITUDE": {"rollspeed": 0.0, "pitchspeed": 0.0},
    "VFR_HUD": {"throttle": 0, "climb": 0.0},
    "GPS_RAW_INT": {"epv": 65535},
    "GLOBAL_POSITION_INT": {"vz": 0},
    "NAV_CONTROLLER_OUTPUT": {"nav_roll": 0.0, "nav_pitch": 0.0, "alt_error": 0.0, "aspd_error": 0.0},
    "ATTITUDE_TARGET": {
        "type_mask": 71, "body_roll_rate": 0.0, "body_pitch_rate": 0.0, "body_yaw_rate": 0.0, "thrust": 0.0,
        "q": pytest.approx([math.cos(0.75), 0.0, 0.0, math.sin(0.75)]),
    },
    "SERVO_OUTPUT_RAW": {"port": 0, **{f"servo{number}_raw": 0 for number in range(2, 9)}},
    "HOME_POSITION": {
        "x": 0.0, "y": 0.0, "z": 0.0, "q": [1.0, 0.0, 0.0, 0.0],
        "approach_x": 0.0, "approach_y": 0.0, "approach_z": 0.0,
    },
    "ATTITUDE_QUATERNION": {"rollspeed": 0.0, "pitchspeed": 0.0, "repr_offset_q": [0.0, 0.0, 0.0, 0.0]},
    "LOCAL_POSITION_NED": {"vz": 0.0},
    "POSITION_TARGET_GLOBAL_INT": {
        "coordinate_frame": 0, "type_mask": 3580, "alt": 0.0, "vx": 0.0, "vy": 0.0, "vz": 0.0, "afx": 0.0, "afy": 0.0,
        "afz": 0.0, "yaw": 0.0, "yaw_rate": 0.0,
    },
    "EKF_STATUS_REPORT": {
        "velocity_variance": 0.0, "pos_horiz_variance": 0.0, "pos_vert_variance": 0.0, "terrain_alt_variance": 0.0,
        "airspeed_variance": 0.0,
    },
    "BATTERY_STATUS": {
        "id": 0, "battery_function": 1, "type": 0, "voltages": [12000, *[65535] * 9], "current_consumed": -1,
        "energy_consumed": -1, "time_remaining": 0, "charge_state": 0, "mode": 0, "fault_bitmask": 0,
    },
    "HIGH_LATENCY2": {
        "target_altitude": 0, "throttle": 0, "airspeed_sp": 0, "windspeed": 0, "wind_heading": 0, "eph": 255,
        "epv": 255, "temperature_air": 0, "climb_rate": 0,
    },
    "EXTENDED_SYS_STATE": {"vtol_state": 0, "landed_state": 0},
    "SYS_STATUS": {"drop_rate_comm": 0, "errors_count2": 0, "errors_count3": 0, "errors_count4": 0},
}  # fmt: skip


def build(name, snapshot):
    (row,) = (row for row in TABLE if row.name == name)
    boat = replace(snapshot, **BOAT)
    context = TelemetryContext(boat, utc_s=1.7e9, rudder_limit_rad=0.5, autopilot=3, load=0.25, refused_frames=0)
    return row.build(context)


@pytest.mark.parametrize("name", FIXED)
def test_fields_that_are_not_measured_have_their_fixed_value(snapshot, name):
    message = build(name, snapshot)
    values = {field: getattr(message, field) for field in FIXED[name]}
    assert {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()} == FIXED[name]


# Largest and smallest value by message and field.
LIMITS = {
    "GPS_RAW_INT": {
        "lat": (1_800_000_000, -1_800_000_000), "lon": (1_800_000_000, -1_800_000_000),
        "alt": (2_147_483_647, -2_147_483_647), "eph": (65534, 0), "vel": (65534, 0), "satellites_visible": (254, 0),
    },
    "GLOBAL_POSITION_INT": {
        "lat": (1_800_000_000, -1_800_000_000), "alt": (2_147_483_647, -2_147_483_647),
        "relative_alt": (2_147_483_647, -2_147_483_647), "vx": (32767, -32767), "vy": (32767, -32767),
    },
    "NAV_CONTROLLER_OUTPUT": {"wp_dist": (65535, 0)},
    "SERVO_OUTPUT_RAW": {"servo1_raw": (2000, 1000)},
    "HOME_POSITION": {
        "latitude": (1_800_000_000, -1_800_000_000), "altitude": (2_147_483_647, -2_147_483_647),
        "time_usec": (10**18, 0),
    },
    "GPS_GLOBAL_ORIGIN": {"altitude": (2_147_483_647, -2_147_483_647)},
    "SYS_STATUS": {
        "load": (1000, 0), "voltage_battery": (65534, 0), "current_battery": (32767, -32767),
        "battery_remaining": (100, 0), "errors_comm": (65535, 0), "errors_count1": (65535, 0),
    },
    "BATTERY_STATUS": {
        "temperature": (32766, -32767), "current_battery": (32767, -32767), "energy_consumed": (2_147_483_647, 0),
    },
    "FENCE_STATUS": {"breach_count": (65535, 0)},
    "MISSION_CURRENT": {"seq": (65535, 0), "total": (65534, 0)},
    "HIGH_LATENCY2": {
        "altitude": (32767, -32767), "target_distance": (65535, 0), "groundspeed": (255, 0), "battery": (100, 0),
        "wp_num": (65535, 0), "custom0": (127, -127), "custom1": (127, 0),
    },
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_values_out_of_range_are_limited(snapshot, name):
    (row,) = (row for row in TABLE if row.name == name)
    for column, sign in enumerate((1, -1)):
        x = sign * 1e12
        count = 10**9 if sign > 0 else -(10**9)
        fix = PositionSample(0.0, FixType.FIX_3D, sign * 10.0, sign * 10.0, x, x, math.pi / 4, count, x)
        boat = replace(
            snapshot, t_s=x, position=fix, position_ok=True, home=Home(sign * 10.0, sign * 10.0, x), distance_m=x,
            rudder_rad=x, rudder_command_rad=x, skipped_total=count,
            power=Power(x, -x, x, x, x, x, load=Flow(x, 60.0)),
            mission=MissionReport(index=count, count=count, identities=(0, 1, 0)),
        )  # fmt: skip
        if name == "GLOBAL_POSITION_INT":
            boat = replace(boat, home=Home(0.0, 0.0, 0.0))
        message = row.build(TelemetryContext(boat, 1.7e9, 0.5, 3, x, count, fence_breaches=(count, 1.0)))
        assert {field: getattr(message, field) for field in LIMITS[name]} == {
            field: limits[column] for field, limits in LIMITS[name].items()
        }


UNKNOWN = {
    "GPS_RAW_INT": {"lat": 0, "lon": 0, "alt": 0, "eph": 65535, "vel": 65535, "satellites_visible": 255},
    "GLOBAL_POSITION_INT": {"lat": 0, "lon": 0, "alt": 0, "relative_alt": 0, "vx": 0, "vy": 0},
    "NAV_CONTROLLER_OUTPUT": {"wp_dist": 0, "nav_bearing": 0, "target_bearing": 0},
    "VFR_HUD": {"heading": 0, "groundspeed": 0.0, "alt": 0.0},
    "HOME_POSITION": {"latitude": 0, "longitude": 0, "altitude": 0, "time_usec": 0},
    "GPS_GLOBAL_ORIGIN": {"latitude": 0, "longitude": 0, "altitude": 0, "time_usec": 0},
    "SYS_STATUS": {"load": 0, "voltage_battery": 65535, "current_battery": -1, "battery_remaining": -1},
    "BATTERY_STATUS": {"temperature": 32767, "current_battery": -1, "battery_remaining": -1},
    "HIGH_LATENCY2": {
        "latitude": 0, "altitude": 0, "target_distance": 0, "groundspeed": 0, "heading": 0, "battery": -1, "wp_num": 0,
        "custom0": -128, "custom1": -1,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", UNKNOWN)
def test_values_that_are_not_finite_are_unknown(snapshot, name):
    (row,) = (row for row in TABLE if row.name == name)
    nan = math.nan
    fix = PositionSample(0.0, FixType.FIX_3D, nan, nan, nan, nan, nan, None, nan)
    boat = replace(
        snapshot, t_s=nan, position=fix, position_ok=True, home=Home(nan, nan, nan), distance_m=nan, rudder_rad=nan,
        heading_rad=nan, goal_heading_rad=nan, bearing_rad=nan, power=Power(nan, nan, nan, nan, nan, nan),
    )  # fmt: skip
    message = row.build(TelemetryContext(boat, 1.7e9, 0.5, 3, nan, 0))
    assert {field: getattr(message, field) for field in UNKNOWN[name]} == UNKNOWN[name]


def test_times_and_floats_are_limited():
    assert (boot_us(1.5), boot_us(-1.0), boot_us(1e300), boot_us(math.nan)) == (1_500_000, 0, 1 << 62, 0)
    assert [boot_ms(t_s) for t_s in (1.5, -1.0, 4_294_967.295, 4_294_967.296)] == [1500, 0, 4_294_967_295, 0]
    largest = 3.4028234663852886e38
    assert [to_float32(sign * largest) for sign in (1, -1)] == [largest, -largest]
    assert [to_float32(value, 7.0) for value in (3.41e38, -3.41e38, math.inf, math.nan, None)] == [7.0] * 5
