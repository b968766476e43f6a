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

MIN_SPEED_M_S = 0.02  # below this speed made good, a destination cannot be reached


@functools.lru_cache(maxsize=4)
def _rally_places(rally: Plan) -> tuple[Place, ...]:
    places = (place_of(item) for item in rally.items if item.command == Command.RALLY_POINT)
    return tuple(place for place in places if place is not None)


def list_destinations(home: Home | None, rally: Plan, *, with_home: bool) -> list[Place]:
    """Return the possible destinations: rally points, and home if `with_home` is set or there are no rally points."""
    destinations = list(_rally_places(rally))
    if home is not None and (with_home or not destinations):
        destinations.append(Place(home.latitude_rad, home.longitude_rad))
    return destinations


def choose_return_place(motion: VesselMotion, home: Home | None, rally: Plan, *, with_home: bool) -> Place | None:
    """Return the destination that the boat reaches first, the nearest one if it can reach none, or None without any."""
    return min(
        list_destinations(home, rally, with_home=with_home), key=lambda place: _rank(motion, place), default=None
    )


def _rank(motion: VesselMotion, place: Place) -> tuple[bool, float]:
    """Return the sort key of a destination: (False, time in s), or (True, distance in m) if it cannot be reached."""
    distance_m, bearing_rad = motion.place.distance_and_bearing(place)
    speed_m_s = speed_made_good(bearing_rad, motion.speed_m_s, motion.current_north_m_s, motion.current_east_m_s)
    if not speed_m_s > MIN_SPEED_M_S or not math.isfinite(distance_m):
        return True, distance_m
    return False, distance_m / speed_m_s


def return_task(
    settings: TaskSettings, motion: VesselMotion, home: Home | None, rally: Plan, *, with_home: bool
) -> GoTo | None:
    """Return the task of RTL, or None without a destination."""
    place = choose_return_place(motion, home, rally, with_home=with_home)
    return None if place is None else GoTo(place, None, settings.acceptance_radius_m, settings.station_radius_m)
