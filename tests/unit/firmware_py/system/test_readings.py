"""Values of devices for operators: a compass, and a gyroscope without north."""

import math

from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.system.readings import heading_values


def test_compass_has_a_heading_with_its_reference():
    values = heading_values(HeadingSample(1.0, math.radians(98.3), NorthReference.MAGNETIC, yaw_rate_rad_s=0.1))
    assert values == {"heading_magnetic_deg": 98.3, "roll_deg": None, "pitch_deg": None, "temperature_c": None}


def test_gyroscope_has_no_heading_and_says_so():
    values = heading_values(HeadingSample(1.0, math.radians(98.3), NorthReference.RELATIVE, yaw_rate_rad_s=-0.1))
    assert values == {"yaw_rate_deg_s": -5.73, "turned_deg": 98.3, "north": "none, gyro only"}
