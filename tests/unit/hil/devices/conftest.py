"""A boat with constant state and a loop that runs an emulator, for the tests of the emulators."""

import math
from types import SimpleNamespace

import pytest


class Boat(SimpleNamespace):
    """An Attitude and a Whereabouts with constant quantities."""

    def __init__(self):
        super().__init__(heading=math.radians(98.3), rate=0.0, latitude=35.5, longitude=-120.25, speed=0.4, course=0.0)
        self.utc_s = lambda: 1_700_000_000.0
        self.heading_rad, self.yaw_rate_rad_s = lambda: self.heading, lambda: self.rate
        self.latitude_deg, self.longitude_deg = lambda: self.latitude, lambda: self.longitude
        self.speed_over_ground_m_s, self.course_over_ground_rad = lambda: self.speed, lambda: self.course


@pytest.fixture
def boat():
    return Boat()


@pytest.fixture
def run():
    """Poll an emulator at its due times; return its output as [(time, bytes)]."""

    def run_until(emulator, end_s):
        output = []
        while (due_s := emulator.next_output_s()) <= end_s:
            if data := emulator.take_output(due_s):
                output.append((due_s, data))
        return output

    return run_until
