import math

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.reports import Home
from firmware_py.guidance.return_point import return_place, return_task
from firmware_py.guidance.tasks import VesselMotion

HERE = Place(0.6, 2.0)
HOME = Home(HERE.latitude_rad, HERE.longitude_rad, 0.0)


def rally(*offsets_m):
    places = [HERE.at_offset(*offset) for offset in offsets_m]
    degrees = [(round(math.degrees(p.latitude_rad) * 1e7), round(math.degrees(p.longitude_rad) * 1e7)) for p in places]
    return Plan.of(PlanKind.RALLY, [PlanItem(5100, x=x, y=y) for x, y in degrees])


def at(north_m, east_m, north=0.0, east=0.0):
    return VesselMotion(HERE.at_offset(north_m, east_m), 0.0, 0.5, north, east)


def chosen(motion, points, *, with_home=True):
    place = return_place(motion, HOME, points, with_home=with_home)
    return tuple(round(metres, -1) + 0.0 for metres in HERE.offset_m(place))


def test_home_without_rally_points_and_none_without_home():
    assert chosen(at(500.0, 0.0), rally(), with_home=False) == (0.0, 0.0)
    assert return_place(at(0.0, 0.0), None, rally(), with_home=True) is None


def test_home_competes_with_rally_points_by_parameter():
    points = rally((1000.0, 0.0), (0.0, 3000.0))
    assert chosen(at(300.0, 0.0), points) == (0.0, 0.0)
    assert chosen(at(300.0, 0.0), points, with_home=False) == (1000.0, 0.0)


def test_in_a_current_the_destination_reached_first_is_chosen():
    points = rally((0.0, -800.0), (0.0, 1000.0))
    assert chosen(at(0.0, 0.0, east=0.4), points, with_home=False) == (0.0, 1000.0)
    # Stronger than the boat: a destination upstream is out of reach.
    assert chosen(at(0.0, 0.0, east=0.9), points, with_home=False) == (0.0, 1000.0)


def test_the_nearest_destination_if_none_can_be_reached(tight):
    task = return_task(tight, at(0.0, 0.0, east=0.9), HOME, rally((0.0, -800.0)), with_home=False)
    assert task.place.distance_and_bearing(HERE)[0] - 800.0 < 1.0
    assert (task.acceptance_radius_m, task.station_radius_m, task.start) == (20.0, 100.0, None)
