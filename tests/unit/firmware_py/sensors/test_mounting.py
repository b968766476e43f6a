"""Mounting of a sensor: the attitude of the boat from that of the sensor, by examples that a person can check."""

import math

import pytest

from firmware_py.sensors.mounting import MOUNTINGS, Mounting, mounting_option, multiply, rotation

DEG = math.pi / 180.0


def boat_deg(mounting, heading_deg, pitch_deg=0.0, roll_deg=0.0, rates_rad_s=None):
    """Return heading, pitch and roll of the boat from those of the sensor."""
    ned_from_sensor = rotation(roll_deg * DEG, pitch_deg * DEG, heading_deg * DEG)
    boat = Mounting(mounting).boat_attitude(ned_from_sensor, rates_rad_s)
    return (boat.heading_rad / DEG, boat.pitch_rad / DEG, boat.roll_rad / DEG), boat.yaw_rate_rad_s


@pytest.mark.parametrize(
    ("mounting", "sensor_deg", "expected_deg"),
    [
        ("none", (98.5, 10.0, -20.0), (98.5, 10.0, -20.0)),
        # The forward mark points to starboard: bow up is starboard side of the sensor down.
        ("yaw_90", (100.0, 0.0, 10.0), (10.0, 10.0, 0.0)),
        ("yaw_90", (100.0, -10.0, 0.0), (10.0, 0.0, 10.0)),
        ("yaw_180", (100.0, 10.0, 5.0), (280.0, -10.0, -5.0)),
        ("yaw_270", (100.0, 10.0, 0.0), (190.0, 0.0, 10.0)),
        ("yaw_45", (100.0, 0.0, 0.0), (55.0, 0.0, 0.0)),
        # The label points down, the forward mark to the bow.
        ("roll_180", (100.0, 10.0, 180.0), (100.0, 10.0, 0.0)),
        ("roll_180", (100.0, 0.0, -170.0), (100.0, 0.0, 10.0)),
        # The label points down, the forward mark astern.
        ("pitch_180", (280.0, 0.0, 180.0), (100.0, 0.0, 0.0)),
        ("roll_180_yaw_90", (190.0, 0.0, 180.0), (100.0, 0.0, 0.0)),
        # The starboard side of the sensor is down.
        ("roll_90", (100.0, 0.0, 90.0), (100.0, 0.0, 0.0)),
        ("roll_270", (100.0, 0.0, -90.0), (100.0, 0.0, 0.0)),
        ("pitch_90", (0.0, 90.0, 0.0), (0.0, 0.0, 0.0)),
        ("pitch_270", (0.0, -90.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_attitude_of_the_boat(mounting, sensor_deg, expected_deg):
    angles_deg, _ = boat_deg(mounting, *sensor_deg)
    errors_deg = [
        math.remainder(angle - expected, 360.0) for angle, expected in zip(angles_deg, expected_deg, strict=True)
    ]
    assert errors_deg == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("mounting", "rates_rad_s", "expected_rad_s"),
    [("none", (0.0, 0.0, 0.2), 0.2), ("roll_180", (0.0, 0.0, -0.2), 0.2), ("pitch_90", (-0.2, 0.0, 0.0), 0.2)],
)
def test_yaw_rate_of_a_level_boat(mounting, rates_rad_s, expected_rad_s):
    sensor_deg = {"none": (0.0, 0.0, 0.0), "roll_180": (0.0, 0.0, 180.0), "pitch_90": (0.0, 90.0, 0.0)}[mounting]
    _, yaw_rate_rad_s = boat_deg(mounting, *sensor_deg, rates_rad_s=rates_rad_s)
    assert yaw_rate_rad_s == pytest.approx(expected_rad_s, abs=1e-9)


def test_yaw_rate_of_a_heeling_and_pitching_boat_is_the_rate_of_its_heading():
    _, heeling_rad_s = boat_deg("none", 50.0, 0.0, 60.0, (0.0, 0.3, 0.1))
    assert heeling_rad_s == pytest.approx(0.3 * math.sin(60.0 * DEG) + 0.1 * math.cos(60.0 * DEG))
    _, pitching_rad_s = boat_deg("none", 50.0, 60.0, 0.0, (0.0, 0.0, 0.1))
    assert pitching_rad_s == pytest.approx(0.2)


def test_without_rates_there_is_no_yaw_rate():
    assert boat_deg("yaw_90", 100.0)[1] is None


@pytest.mark.parametrize(("pitch_deg", "is_valid"), [(79.9, True), (80.1, False), (-79.9, True), (-80.1, False)])
def test_nearly_vertical_boat_has_no_attitude(pitch_deg, is_valid):
    boat = Mounting("none").boat_attitude(rotation(0.0, pitch_deg * DEG, 1.0))
    assert (boat is not None) is is_valid


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rounding_errors_of_a_vertical_sensor_do_not_raise(sign):
    almost_unit = ((0.0, 0.0, sign), (0.0, 1.0, 0.0), (-1.0000000000000002 * sign, 0.0, 0.0))
    assert Mounting("none").boat_attitude(almost_unit) is None


def test_rotation_has_orthogonal_axes():
    matrix = rotation(0.4, 0.7, 1.9)
    rows = multiply(matrix, tuple(zip(*matrix, strict=True)))
    assert [value for row in rows for value in row] == pytest.approx([1, 0, 0, 0, 1, 0, 0, 0, 1], abs=1e-12)


def test_heading_is_less_than_a_full_turn():
    boat = Mounting("none").boat_attitude(rotation(0.0, 0.0, -1e-20))
    assert 0.0 <= boat.heading_rad < 2.0 * math.pi


def test_names_are_those_of_mavlink_and_differ_in_effect():
    assert len(MOUNTINGS) == 20
    assert MOUNTINGS[:8] == ("none", "yaw_45", "yaw_90", "yaw_135", "yaw_180", "yaw_225", "yaw_270", "yaw_315")
    level = rotation(0.1, 0.2, 0.3)
    attitudes = [Mounting(name).boat_attitude(level) for name in MOUNTINGS]
    for number, attitude in enumerate(attitudes):
        assert attitude is None or attitude not in attitudes[:number]


def test_option_has_the_names_and_no_rotation_as_default():
    field = mounting_option()
    assert field.default == "none"
    assert field.metadata["option"].choices == MOUNTINGS
