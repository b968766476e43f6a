"""A simulated boat with a limited turning rate, in a plane with a current."""

import math

import pytest

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.guidance import task_follower
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import TaskSettings, VesselMotion
from firmware_py.model.crab import heading_for_course

ORIGIN = Place(0.6, 2.0)
SETTINGS = TaskSettings(acceptance_radius_m=20.0, station_radius_m=100.0, look_ahead_s=60.0, turning_radius_m=15.6)


class SimulatedBoat:
    """Heading, position and task of the boat; steps of one second."""

    def __init__(self, north_m=0.0, east_m=0.0, heading_rad=0.0, speed_m_s=0.4, current=(0.0, 0.0), leeway_rad=0.0):
        self.north_m, self.east_m, self.heading_rad = north_m, east_m, heading_rad
        self.speed_m_s, self.current, self.leeway_rad = speed_m_s, current, leeway_rad
        self.follower = TaskFollowerState()
        self.status = None
        self.t_s = 0.0
        self.turned_rad = 0.0

    @property
    def motion(self):
        place = ORIGIN.at_offset(self.north_m, self.east_m)
        is_too_strong = math.hypot(*self.current) > self.speed_m_s
        return VesselMotion(place, self.heading_rad, self.speed_m_s, *self.current, is_too_strong, self.leeway_rad)

    def step(self, task, settings=SETTINGS, fence=None):
        motion = self.motion
        self.follower, self.status = task_follower.update(settings, self.follower, task, motion, 1.0, fence)
        target = self.status.heading_target
        steer_rad = target.angle_rad
        if target.over_ground:
            steer_rad = heading_for_course(steer_rad, self.speed_m_s, *self.current) - self.leeway_rad
        error_rad = wrap_pi(steer_rad - self.heading_rad)
        max_change_rad = 0.9 * self.speed_m_s / settings.turning_radius_m
        change_rad = min(max(0.3 * error_rad, -max_change_rad), max_change_rad)
        self.heading_rad = (self.heading_rad + change_rad) % (2 * math.pi)
        self.turned_rad += abs(change_rad)
        way_rad = self.heading_rad + self.leeway_rad
        self.north_m += self.speed_m_s * math.cos(way_rad) + self.current[0]
        self.east_m += self.speed_m_s * math.sin(way_rad) + self.current[1]
        self.t_s += 1.0
        return self.status

    def distance_m(self, north_m=0.0, east_m=0.0):
        return math.hypot(self.north_m - north_m, self.east_m - east_m)


@pytest.fixture
def simulated_boat():
    return SimulatedBoat


@pytest.fixture
def origin():
    return ORIGIN


@pytest.fixture
def task_settings():
    return SETTINGS
