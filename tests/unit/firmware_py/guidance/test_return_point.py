"""Choice of the destination of RTL."""

import math

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.reports import Home
from firmware_py.guidance.return_point import choose_return_place, return_task
from firmware_py.guidance.tasks import VesselMotion
from firmware_py.plans.items import Command

HERE = Place(0.6, 2.0)
HOME = Home(HERE.latitude_rad, HERE.longitude_rad, 0.0)


def rally(*offsets_m):
    places = [HERE.at_offset(*offset) for offset in offsets_m]
    degrees = [(math.degrees(place.latitude_rad), math.degrees(place.longitude_rad)) for place in places]
    return Plan.of(
        PlanKind.RALLY, [PlanItem(Command.RALLY_POINT, x=round(x * 1e7), y=round(y * 1e7)) for x, y in degrees]
    )


def motion_at(north_m, east_m, current_east_m_s=0.0):
    return VesselMotion(HERE.at_offset(north_m, east_m), 0.0, 0.5, 0.0, current_east_m_s)


def choose(motion, points, *, with_home=True):
    """Return the chosen destination, north and east of HERE in metres."""
    place = choose_return_place(motion, HOME, points, with_home=with_home)
    return tuple(round(metres, -1) + 0.0 for metres in HERE.offset_m(place))


def test_destination_is_home_without_rally_points_and_none_without_both():
    assert choose(motion_at(500.0, 0.0), rally(), with_home=False) == (0.0, 0.0)
    assert choose_return_place(motion_at(0.0, 0.0), None, rally(), with_home=True) is None


def test_home_is_a_destination_beside_rally_points_with_the_parameter():
    points = rally((1000.0, 0.0), (0.0, 3000.0))
    assert choose(motion_at(300.0, 0.0), points) == (0.0, 0.0)
    assert choose(motion_at(300.0, 0.0), points, with_home=False) == (1000.0, 0.0)


def test_destination_reached_first_in_the_current_is_chosen():
    points = rally((0.0, -800.0), (0.0, 1000.0))
    assert choose(motion_at(0.0, 0.0, current_east_m_s=0.4), points, with_home=False) == (0.0, 1000.0)
    # The current exceeds the speed: a destination upstream cannot be reached.
    assert choose(motion_at(0.0, 0.0, current_east_m_s=0.9), points, with_home=False) == (0.0, 1000.0)


@pytest.mark.parametrize(("current_east_m_s", "east_m"), [(0.479, -800.0), (0.481, 50_000.0)])
def test_destination_with_less_than_two_centimetres_per_second_made_good_cannot_be_reached(current_east_m_s, east_m):
    points = rally((0.0, -800.0), (0.0, 50_000.0))
    assert choose(motion_at(0.0, 0.0, current_east_m_s), points, with_home=False)[1] == east_m


def test_nearest_destination_is_chosen_if_none_can_be_reached(task_settings):
    task = return_task(
        task_settings, motion_at(0.0, 0.0, current_east_m_s=0.9), HOME, rally((0.0, -800.0)), with_home=False
    )
    assert task.place.distance_and_bearing(HERE)[0] - 800.0 < 1.0
    assert (task.acceptance_radius_m, task.station_radius_m, task.start) == (20.0, 100.0, None)
