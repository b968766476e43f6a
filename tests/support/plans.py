"""Plans with positions in metres from the start of the simulated runs."""

import math

from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.angles import radians
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.plans.items import Command
from firmware_py.system.state_directory import PLAN_FILES
from firmware_py.system.store import Store

EARTH_M = 6371008.8
START_RAD = (radians(36.0), radians(121.0))


def placed(north_m, east_m):
    """Return latitude and longitude [rad] of a position north and east of the start."""
    latitude_rad = START_RAD[0] + north_m / EARTH_M
    return latitude_rad, START_RAD[1] + east_m / (EARTH_M * math.cos(START_RAD[0]))


def item(command, north_m=None, east_m=None, *params, autocontinue=True):
    """Return an item with a position in metres from the start, or without one; `params` are 1 to 4, others 0."""
    x = y = 0
    if north_m is not None:
        x, y = (round(math.degrees(angle) * 1e7) for angle in placed(north_m, east_m))
    filled = (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4]
    return PlanItem(int(command), mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, autocontinue, filled, x, y)


def mission(*items):
    return Plans(mission=Plan.of(PlanKind.MISSION, items))


def mission_file(*items):
    """Return name and content of the mission file in a state directory."""
    return PLAN_FILES[PlanKind.MISSION], plan_to_text(mission(*items).mission)


def save_plans(directory, plans):
    """Write plans, given as items by kind, to a state directory; return the directory."""
    store = Store(directory)
    for kind, items in plans.items():
        store.save(PLAN_FILES[kind], plan_to_text(Plan.of(kind, items)).encode())
    store.close()
    return directory


# Fence around the start: 200 m to south and west, 400 m to north and east, with two excluded areas.
FENCE_ITEMS = (
    *(
        item(Command.INCLUDED_VERTEX, north_m, east_m, 4)
        for north_m, east_m in ((-200, -200), (400, -200), (400, 400), (-200, 400))
    ),
    *(item(Command.EXCLUDED_VERTEX, north_m, east_m, 3) for north_m, east_m in ((150, 150), (200, 150), (200, 200))),
    item(Command.EXCLUDED_CIRCLE, -100, -100, 30),
)
