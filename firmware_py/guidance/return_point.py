"""Destination of RTL: home, or the rally point that the boat reaches first in the present current."""

from __future__ import annotations

import functools
import math

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, place_of
from firmware_py.common.reports import Home
from firmware_py.guidance.tasks import GoTo, TaskSettings, VesselMotion
from firmware_py.model.crab import speed_made_good
from firmware_py.plans.items import Command

UNREACHABLE_M_S = 0.02


@functools.lru_cache(maxsize=4)
def _rally_places(rally: Plan) -> tuple[Place, ...]:
    destinations = (place_of(item) for item in rally.items if item.command == Command.RALLY_POINT)
    return tuple(place for place in destinations if place is not None)


def places(home: Home | None, rally: Plan, *, with_home: bool) -> list[Place]:
    """Return the possible destinations; home is one of them with `with_home`, or without rally points."""
    destinations = list(_rally_places(rally))
    if home is not None and (with_home or not destinations):
        destinations.append(Place(home.latitude_rad, home.longitude_rad))
    return destinations


def return_place(motion: VesselMotion, home: Home | None, rally: Plan, *, with_home: bool) -> Place | None:
    """Return the destination that the boat reaches first, the nearest if it can reach none, or None."""
    return min(places(home, rally, with_home=with_home), key=lambda place: _time_to(motion, place), default=None)


def _time_to(motion: VesselMotion, place: Place) -> tuple[bool, float]:
    distance_m, bearing_rad = motion.place.distance_and_bearing(place)
    speed_m_s = speed_made_good(bearing_rad, motion.speed_m_s, motion.current_north_m_s, motion.current_east_m_s)
    if not speed_m_s > UNREACHABLE_M_S or not math.isfinite(distance_m):
        return True, distance_m
    return False, distance_m / speed_m_s


def return_task(
    settings: TaskSettings, motion: VesselMotion, home: Home | None, rally: Plan, *, with_home: bool
) -> GoTo | None:
    """Return the task for RTL, None without a destination."""
    place = return_place(motion, home, rally, with_home=with_home)
    return None if place is None else GoTo(place, None, settings.acceptance_radius_m, settings.station_radius_m)
