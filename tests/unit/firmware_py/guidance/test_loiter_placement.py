"""Placement of a loiter circle inside a fence, and its events."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.records import Severity
from firmware_py.common.reports import Activity
from firmware_py.guidance import loiter_placement
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.guidance_reports import circle_events
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.guidance.tasks import HoldStation, Orbit
from firmware_py.plans import fence
from firmware_py.plans.items import Command

ORIGIN = Place(0.6, 2.0)
TURNING_RADIUS_M = 15.6  # of `task_settings`
OVERSHOOT_M = 3.5 * TURNING_RADIUS_M  # outside any circle
MIN_RADIUS_M = 5.0 * TURNING_RADIUS_M  # 78 m, in a current
TOO_SMALL = "below 78 m the boat may drift out"
TOO_CLOSE = "Fence too close to the loiter circle: breach possible"


def item(command, north_m, east_m, param):
    """Return a fence item; `param` is the radius of a circle in metres, or the number of vertices of a polygon."""
    place = ORIGIN.at_offset(north_m, east_m)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (place.latitude_rad, place.longitude_rad))
    return PlanItem(command, 3, True, (float(param), 0.0, 0.0, 0.0), x, y)


def polygon(*corners):
    return tuple(item(Command.INCLUDED_VERTEX, *corner, len(corners)) for corner in corners)


def plan(*items):
    return Plan.of(PlanKind.FENCE, items)


def wedge(margin_per_metre):
    """Return a fence that opens to the north; its margin is 60 m at the origin, and grows by this much per metre."""
    slope = math.tan(math.asin(margin_per_metre))
    apex_m = -60.0 / margin_per_metre
    return polygon((apex_m, 0), (2000, slope * (2000 - apex_m)), (2000, -slope * (2000 - apex_m)))


def circle_at(north_m, east_m, radius_m=100.0):
    return HoldStation(ORIGIN.at_offset(north_m, east_m), radius_m)


SQUARE = polygon((-500, -500), (500, -500), (500, 500), (-500, 500))
REEF = item(Command.EXCLUDED_CIRCLE, 0, 0, 20)
STRAIT = polygon((-60, -2000), (60, -2000), (60, 2000), (-60, 2000))
# The water has the form of a horseshoe: there is also water on the other side of the land.
HORSESHOE = polygon((-400, -400), (-400, 400), (400, 400), (400, 5), (-200, 5), (-200, -5), (400, -5), (400, -400))


def place_circle(settings, task, items):
    """Return the final placement."""
    placement = None
    for _ in range(60):
        placement = loiter_placement.update(settings, placement, task, plan(*items))
        if placement.is_final:
            return placement
    raise AssertionError("the search does not end")


def moved_m(placement):
    return math.hypot(*placement.task.centre.offset_m(placement.circle.centre))


@pytest.mark.parametrize(
    ("items", "task", "missing_m"),
    [
        (SQUARE, circle_at(0, 0), 0.0),
        (SQUARE, circle_at(0, 340), 0.0),
        (SQUARE, circle_at(0, 400), 55.0),
        (SQUARE, circle_at(20, 500), 155.0),
        (SQUARE, circle_at(20, 560), 215.0),  # outside the fence
        (SQUARE, circle_at(0, 450, 20.0), 25.0),  # smaller than the minimum radius
        (polygon((-500, 0), (0, -500), (500, 0), (0, 500)), circle_at(200, 200), 84.0),
        ((*SQUARE, REEF), circle_at(0, 60), 115.0),
    ],
)
def test_circle_is_moved_inward_by_the_missing_margin(task_settings, items, task, missing_m):
    placement = place_circle(task_settings, task, items)
    assert placement.circle.radius_m == task.radius_m
    assert fence.margin_m(plan(*items), placement.circle.centre) >= task.radius_m + OVERSHOOT_M
    assert missing_m <= moved_m(placement) + 1.0 <= 1.03 * missing_m + 2.0


def test_circle_in_a_corner_is_moved_out_of_it(task_settings):
    placement = place_circle(task_settings, circle_at(450, 450), SQUARE)
    assert placement.margin_m >= 100.0 + OVERSHOOT_M
    assert moved_m(placement) <= 160.0


@pytest.mark.parametrize(
    ("items", "task", "radius_m"),
    [
        (STRAIT, circle_at(0, 0), MIN_RADIUS_M),
        (STRAIT, circle_at(0, 0, 30.0), 30.0),
        (SQUARE, circle_at(0, 0, 1000.0), 500.0 - OVERSHOOT_M),
        (wedge(0.29), circle_at(0, 0), MIN_RADIUS_M),
    ],
)
def test_circle_without_room_shrinks_to_the_minimum_radius(task_settings, items, task, radius_m):
    placement = place_circle(task_settings, task, items)
    assert placement.circle.radius_m == pytest.approx(radius_m, abs=0.5)
    assert moved_m(placement) < 1.0


def test_circle_without_room_is_moved_if_the_margin_grows_enough(task_settings):
    placement = place_circle(task_settings, circle_at(0, 0), wedge(0.315))
    assert moved_m(placement) == pytest.approx(2.2 * (100.0 + OVERSHOOT_M - 60.0), abs=1.0)  # the outer ring
    assert placement.circle.radius_m == pytest.approx(MIN_RADIUS_M)


@pytest.mark.parametrize(("north_m", "east_m"), [(100, 8), (100, 30), (300, 40), (-100, 25)])
def test_circle_is_not_moved_across_land(task_settings, north_m, east_m):
    placement = place_circle(task_settings, circle_at(north_m, east_m, 60.0), HORSESHOE)
    assert placement.margin_m > 60.0 + OVERSHOOT_M
    assert circle_at(0, 0).centre.offset_m(placement.circle.centre)[1] > 5.0


@pytest.mark.parametrize("east_m", [60, 70, 100])
@pytest.mark.parametrize("west_m", [-300, -800])
def test_circle_without_room_on_its_side_of_the_land_stays_there(task_settings, west_m, east_m):
    items = polygon((-400, west_m), (-400, 140), (400, 140), (400, 5), (-200, 5), (-200, -5), (400, -5), (400, west_m))
    placement = place_circle(task_settings, circle_at(100, east_m, 200.0), items)
    assert circle_at(0, 0).centre.offset_m(placement.circle.centre)[1] > 5.0


def test_circle_far_outside_or_without_a_fence_is_not_moved(task_settings):
    assert place_circle(task_settings, circle_at(0, 2000), SQUARE).circle == circle_at(0, 2000)
    assert loiter_placement.update(task_settings, None, circle_at(0, 480), None) is None
    assert loiter_placement.update(task_settings, None, circle_at(0, 480), plan()) is None


def test_new_task_or_fence_restarts_the_search(task_settings):
    placement = place_circle(task_settings, circle_at(0, 480), SQUARE)
    assert loiter_placement.update(task_settings, placement, circle_at(0, 480), plan(*SQUARE)) is placement
    assert loiter_placement.update(task_settings, placement, circle_at(0, 0), plan(*SQUARE)).circle == circle_at(0, 0)
    assert loiter_placement.update(task_settings, placement, circle_at(0, 480), plan(REEF)).circle == circle_at(0, 480)


@pytest.mark.parametrize(("radius_m", "current_m_s"), [(20.0, (0.0, 0.28)), (100.0, (0.2, -0.2))])
def test_boat_near_a_fence_stays_inside(simulated_boat, radius_m, current_m_s):
    margins_m = {}
    for used_fence in (None, plan(*SQUARE)):
        boat = simulated_boat(east_m=460.0, heading_rad=math.pi, current=current_m_s)
        margins_m[used_fence] = math.inf
        for _ in range(3000):
            boat.step(circle_at(0, 460, radius_m), fence=used_fence)
            margins_m[used_fence] = min(margins_m[used_fence], fence.margin_m(plan(*SQUARE), boat.motion.place))
    assert margins_m[None] < 0.0 < margins_m[plan(*SQUARE)]


def texts(settings, previous, present):
    return [(event.severity, event.text) for event in circle_events(settings, previous, present)]


def station_state(task, placement=None, activity=Activity.STATION):
    circle = task if placement is None else placement.circle
    status = TaskStatus(activity=activity, target=circle.centre, radius_m=circle.radius_m)
    return GuidanceState(task=task, follower=TaskFollowerState(loiter_placement=placement), status=status)


def test_too_small_circle_is_reported_once(task_settings):
    small = station_state(circle_at(0, 0, 20.0))
    assert texts(task_settings, GuidanceState(), small) == [(Severity.NOTICE, f"Loiter radius 20 m: {TOO_SMALL}")]
    assert texts(task_settings, small, small) == []
    assert texts(task_settings, GuidanceState(), station_state(circle_at(0, 0, MIN_RADIUS_M))) == []
    assert texts(task_settings, GuidanceState(), station_state(circle_at(0, 0, 20.0), activity=Activity.LINE)) == []


def test_moved_circle_is_reported_once(task_settings):
    near = station_state(circle_at(0, 400))
    moved = station_state(circle_at(0, 400), place_circle(task_settings, circle_at(0, 400), SQUARE))
    text = "Fence near: loiter radius 100 m, moved 56 m inward"
    assert texts(task_settings, near, moved) == [(Severity.NOTICE, text)]
    assert texts(task_settings, moved, moved) == []
    middle = station_state(circle_at(0, 0), place_circle(task_settings, circle_at(0, 0), SQUARE))
    assert texts(task_settings, GuidanceState(), middle) == []


def test_fence_too_close_is_reported(task_settings):
    shrunk = station_state(circle_at(0, 0), place_circle(task_settings, circle_at(0, 0), STRAIT))
    text = "Fence near: loiter radius 78 m, moved 0 m inward"
    assert texts(task_settings, station_state(circle_at(0, 0)), shrunk) == [
        (Severity.NOTICE, text),
        (Severity.WARNING, TOO_CLOSE),
    ]


def test_too_small_orbit_is_reported_once(task_settings):
    task = Orbit(circle_at(0, 0).centre, 10.0, clockwise=True)
    status = TaskStatus(activity=Activity.CIRCLE, target=task.centre, radius_m=23.4)
    circling = GuidanceState(task=task, status=status)
    text = "Circle radius 10 m too small: circling at 23 m"
    assert texts(task_settings, GuidanceState(), circling) == [(Severity.NOTICE, text)]
    assert texts(task_settings, circling, circling) == []
    large = GuidanceState(task=replace(task, radius_m=23.4), status=status)
    assert texts(task_settings, GuidanceState(), large) == []
