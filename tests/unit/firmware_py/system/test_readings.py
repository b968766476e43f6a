"""Values of devices for operators, rounded to their accuracy; a gyroscope without north has no heading."""

import math

import pytest

from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderFeedback,
    WindReference,
    WindSample,
)
from firmware_py.common.vessels import VesselKind, VesselPosition
from firmware_py.system.readings import (
    depth_values,
    device_values,
    heading_values,
    position_values,
    power_values,
    rudder_angle_values,
    rudder_values,
    vessel_values,
    wind_values,
)

ANGLE_RAD = 0.1234567  # 7.07354785 degrees
NUMBER = 12.3456789


@pytest.mark.parametrize(
    ("values_of", "sample", "expected"),
    [
        (
            heading_values,
            HeadingSample(1.0, math.radians(98.3), NorthReference.MAGNETIC, yaw_rate_rad_s=0.1),
            {"heading_magnetic_deg": 98.3, "roll_deg": None, "pitch_deg": None, "temperature_c": None},
        ),
        (
            heading_values,
            HeadingSample(
                1.0,
                ANGLE_RAD,
                NorthReference.TRUE,
                variation_rad=None,
                yaw_rate_rad_s=None,
                roll_rad=ANGLE_RAD,
                pitch_rad=-ANGLE_RAD,
                temperature_c=21.5,
            ),
            {"heading_true_deg": 7.07, "roll_deg": 7.1, "pitch_deg": -7.1, "temperature_c": 21.5},
        ),
        (
            heading_values,
            HeadingSample(1.0, ANGLE_RAD, NorthReference.RELATIVE, yaw_rate_rad_s=-ANGLE_RAD),
            {"yaw_rate_deg_s": -7.07, "turned_deg": 7.07, "north": "none, gyro only"},
        ),
        (
            position_values,
            PositionSample(
                1.0,
                FixType.FIX_3D,
                latitude_rad=ANGLE_RAD,
                longitude_rad=-ANGLE_RAD,
                altitude_m=None,
                speed_over_ground_m_s=NUMBER,
                course_over_ground_rad=ANGLE_RAD,
                satellites=9,
            ),
            {
                "fix": "FIX_3D",
                "lat_deg": 7.0735479,
                "lon_deg": -7.0735479,
                "sog_m_s": 12.35,
                "cog_deg": 7.1,
                "satellites": 9,
            },
        ),
        (
            rudder_values,
            RudderFeedback(
                1.0, shaft_rad=0.123456, temperature_c=21.5, voltage_v=12.3456, current_a=0.123456, hardware_error=4
            ),
            {"shaft_deg": 7.07, "temperature_c": 21.5, "voltage_v": 12.35, "current_a": 0.123, "hardware_error": 4},
        ),
        (rudder_angle_values, RudderAngleSample(1.0, ANGLE_RAD), {"rudder_deg": 7.07}),
        (
            power_values,
            PowerSample(
                1.0,
                source=0,
                voltage_v=NUMBER,
                current_a=-NUMBER,
                charge=0.876543,
                solar_w=NUMBER,
                load_a=NUMBER,
                temperature_c=21.5,
            ),
            {
                "voltage_v": 12.346,
                "current_a": -12.346,
                "charge_percent": 87.7,
                "solar_w": 12.0,
                "load_a": 12.346,
                "temperature_c": 21.5,
            },
        ),
        (
            wind_values,
            WindSample(1.0, NUMBER, -ANGLE_RAD, WindReference.NORTH),
            {"wind_m_s": 12.35, "wind_from_true_deg": 352.9},
        ),
        (depth_values, DepthSample(1.0, NUMBER, 0.56789), {"depth_m": 12.35, "transducer_m": 0.57}),
        (
            vessel_values,
            VesselPosition(
                1.0,
                211000001,
                VesselKind.CLASS_B,
                latitude_rad=ANGLE_RAD,
                longitude_rad=-ANGLE_RAD,
                speed_m_s=NUMBER,
                course_rad=-ANGLE_RAD,
                heading_rad=ANGLE_RAD,
            ),
            {
                "mmsi": 211000001,
                "kind": "class_b",
                "lat_deg": 7.073548,
                "lon_deg": -7.073548,
                "sog_m_s": 12.35,
                "cog_deg": 352.9,
                "heading_deg": 7.0,
            },
        ),
    ],
)
def test_values_are_rounded_to_their_accuracy(values_of, sample, expected):
    assert values_of(sample) == expected


def test_value_that_is_not_measured_is_absent():
    assert rudder_values(RudderFeedback(1.0))["current_a"] is None


@pytest.mark.parametrize(
    ("reference", "name"),
    [
        (WindReference.NORTH, "wind_from_true_deg"),
        (WindReference.MAGNETIC, "wind_from_magnetic_deg"),
        (WindReference.APPARENT, "apparent_wind_angle_deg"),
        (WindReference.BOW, "true_wind_angle_deg"),
        (WindReference.BOW_WATER, "true_wind_angle_deg"),
    ],
)
def test_angle_of_the_wind_is_named_by_its_reference(reference, name):
    assert list(wind_values(WindSample(1.0, 5.0, 1.0, reference))) == ["wind_m_s", name]


def test_device_that_is_absent_has_no_messages():
    values = device_values("compass", "mti", "/dev/x", None, 1.23456, "no such port")
    assert values == {
        "device": "compass", "driver": "mti", "port": "/dev/x", "state": "absent", "rate_hz": 1.23, "accepted": 0,
        "rejected": 0, "error": "no such port",
    }  # fmt: skip
    health = DeviceHealth(1.0, DeviceRole.COMPASS, DeviceState.RUNNING, 7, 3, "checksum")
    values = device_values("compass", "mti", "/dev/x", health, None)
    assert [values[name] for name in ("state", "rate_hz", "accepted", "rejected", "error")] == [
        "running", None, 7, 3, "checksum",
    ]  # fmt: skip
