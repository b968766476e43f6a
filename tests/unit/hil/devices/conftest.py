"""A world small enough to hold in one hand, for the emulators' tests."""

import math
from dataclasses import dataclass

import numpy as np
import pytest


@dataclass
class Boat:
    """Fulfils Attitude and Whereabouts."""

    heading: float = 0.0
    rate: float = 0.0
    latitude: float = 35.5
    longitude: float = -120.25
    speed: float = 0.4
    course: float = 0.0
    utc: float = 1_700_000_000.0

    def heading_rad(self):
        return self.heading

    def yaw_rate_rad_s(self):
        return self.rate

    def latitude_deg(self):
        return self.latitude

    def longitude_deg(self):
        return self.longitude

    def speed_over_ground_m_s(self):
        return self.speed

    def course_over_ground_rad(self):
        return self.course

    def utc_s(self):
        return self.utc


@pytest.fixture
def boat():
    return Boat(heading=math.radians(98.3))


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def run():
    """Poll an emulator at its due times; return its output as [(time, bytes)]."""

    def until(emulator, end_s):
        output = []
        while (due_s := emulator.next_output_s()) <= end_s:
            data = emulator.take_output(due_s)
            if data:
                output.append((due_s, data))
        return output

    return until
