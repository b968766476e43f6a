"""Missions at metres from the start of every run."""

import math

from firmware_py.common.angles import radians
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.system.state_directory import PLAN_FILES

EARTH_M = 6371008.8
START_RAD = (radians(36.0), radians(121.0))


def placed(north_m, east_m):
    """Latitude and longitude of a place north and east of the start."""
    latitude_rad = START_RAD[0] + north_m / EARTH_M
    return latitude_rad, START_RAD[1] + east_m / (EARTH_M * math.cos(START_RAD[0]))


def item(command, north_m=None, east_m=None, *params, autocontinue=True):
    """A mission item, at metres from the start."""
    x = y = 0
    if north_m is not None:
        x, y = (round(math.degrees(angle) * 1e7) for angle in placed(north_m, east_m))
    filled = (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4]
    return PlanItem(command, 3, autocontinue, filled, x, y)


def mission(*items):
    return Plans(mission=Plan.of(PlanKind.MISSION, items))


def mission_file(*items):
    """The name and content of the file that a state directory keeps a mission in."""
    return PLAN_FILES[PlanKind.MISSION], plan_to_text(mission(*items).mission)
