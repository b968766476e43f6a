"""A sensor in any mounting gives the attitude of the boat: the driver's matrices against the emulator's quaternions."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.sensors.mounting import MOUNTINGS, Mounting, rotation
from hil.devices.mounting import euler_deg, sensor_in_ned, to_sensor

HEADINGS = st.floats(0.0, 6.28)
PITCHES = st.floats(-1.39, 1.39)  # up to 79.6 degrees
ROLLS = st.floats(-math.pi, math.pi)


def is_near(first_rad, second_rad, tolerance_rad=1e-6):
    return abs(math.remainder(first_rad - second_rad, math.tau)) < tolerance_rad


@given(
    mounting=st.sampled_from(MOUNTINGS),
    heading_rad=HEADINGS,
    pitch_rad=PITCHES,
    roll_rad=ROLLS,
    yaw_rate_rad_s=st.floats(-1.0, 1.0),
)
def test_attitude_and_yaw_rate_of_the_boat_do_not_depend_on_the_mounting(
    mounting, heading_rad, pitch_rad, roll_rad, yaw_rate_rad_s
):
    orientation = sensor_in_ned(mounting, heading_rad, pitch_rad, roll_rad)
    sensor_roll_deg, sensor_pitch_deg, sensor_yaw_deg = euler_deg(orientation)
    ned_from_sensor = rotation(*(math.radians(angle) for angle in (sensor_roll_deg, sensor_pitch_deg, sensor_yaw_deg)))
    boat = Mounting(mounting).boat_attitude(ned_from_sensor, to_sensor(orientation, (0.0, 0.0, yaw_rate_rad_s)))
    # Near a vertical forward axis of the sensor, Euler angles have a resolution of the root of the rounding error.
    tolerance_rad = 1e-6 / math.cos(pitch_rad) / max(math.cos(math.radians(sensor_pitch_deg)), 1e-3)
    assert boat is not None
    assert is_near(boat.heading_rad, heading_rad, tolerance_rad)
    assert is_near(boat.pitch_rad, pitch_rad, tolerance_rad)
    assert is_near(boat.roll_rad, roll_rad, tolerance_rad)
    assert boat.yaw_rate_rad_s == pytest.approx(yaw_rate_rad_s, abs=10.0 * tolerance_rad)


@given(mounting=st.sampled_from(MOUNTINGS), heading_rad=HEADINGS)
def test_wrong_mounting_gives_another_attitude(mounting, heading_rad):
    """Each pair of mountings differs by at least 45 degrees, so a test with one sensor distinguishes them."""
    orientation = sensor_in_ned(mounting, heading_rad, 0.0, 0.0)
    ned_from_sensor = rotation(*(math.radians(angle) for angle in euler_deg(orientation)))
    for other in MOUNTINGS:
        boat = Mounting(other).boat_attitude(ned_from_sensor)
        is_right = boat is not None and all(
            is_near(*pair, 0.7)
            for pair in ((boat.heading_rad, heading_rad), (boat.pitch_rad, 0.0), (boat.roll_rad, 0.0))
        )
        assert is_right is (other == mounting)
