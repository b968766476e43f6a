"""Tasks under dead reckoning: without a certain position the boat waits for a fix."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.reports import Activity
from firmware_py.guidance import task_follower
from firmware_py.guidance.guidance_reports import dead_reckoning_events
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.guidance.tasks import GoTo, HeadingTarget, HoldHeading, HoldStation, Orbit, VesselMotion

FAR_M = 3000.0
TEXTS = {
    "at waypoint": "Probably at the waypoint (no GPS); waiting for a fix",
    "on the way": "Position too uncertain; holding here until GPS returns",
}


@pytest.fixture
def follower(origin, task_settings):
    """Follows the task to a place FAR_M north; the test sets the positions."""

    class Follower:
        settings = replace(task_settings, dead_reckoning_limit_m=500.0)
        task = GoTo(origin.at_offset(FAR_M, 0.0), origin, 20.0, 100.0)
        state = TaskFollowerState()
        status = None
        texts = ()

        def at(self, north_m, spread_m, heading_rad=0.0, task=None):
            motion = VesselMotion(origin.at_offset(north_m, 0.0), heading_rad, 0.4, 0.0, 0.0, spread_m=spread_m)
            previous = self.state
            self.state, self.status = task_follower.update(self.settings, previous, task or self.task, motion, 1.0)
            self.texts = [event.text for event in dead_reckoning_events(previous, self.state, begins=False)]
            return self

        @property
        def north_m(self):
            return origin.offset_m(self.status.target)[0]

    return Follower()


@pytest.mark.parametrize(("spread_m", "has_arrived"), [(0.0, True), (20.0, True), (20.1, False), (900.0, False)])
def test_place_is_reached_only_with_a_certain_position(follower, spread_m, has_arrived):
    assert follower.at(FAR_M - 15.0, spread_m).state.arrived is has_arrived
    assert follower.status.activity is Activity.STATION
    assert follower.north_m == pytest.approx(FAR_M, abs=0.1)
    assert follower.texts == ([] if has_arrived else [TEXTS["at waypoint"]])
    assert follower.at(FAR_M - 15.0, spread_m).texts == []
    assert follower.at(FAR_M - 15.0, 0.0).state.arrived  # with a fix
    assert follower.state.halt is None


def test_fix_far_from_the_estimated_position_resumes_the_line(follower):
    for north_m in range(2900, 3000, 2):
        follower.at(float(north_m), 25.0)
    follower.at(FAR_M - 300.0, 0.0)
    assert not follower.state.arrived
    assert follower.status.activity is Activity.LINE
    assert math.cos(follower.status.heading_target.angle_rad) == pytest.approx(1.0)


def test_waypoint_is_not_passed_by_dead_reckoning_alone(follower):
    for north_m in range(2400, 3400, 5):
        assert not follower.at(float(north_m), 25.0).state.arrived


def test_boat_with_a_too_uncertain_position_waits_for_a_fix(follower):
    assert follower.at(1000.0, 500.0).status.activity is Activity.LINE
    assert follower.at(1100.0, 500.1).texts == [TEXTS["on the way"]]
    for north_m, spread_m in ((1150.0, 600.0), (1080.0, 450.0), (1250.0, 700.0)):
        assert follower.at(north_m, spread_m).texts == []
        assert (follower.status.activity, follower.state.arrived) == (Activity.STATION, False)
        assert follower.north_m == pytest.approx(1100.0, abs=0.1)
    back_rad = follower.status.heading_target.angle_rad
    assert math.cos(back_rad) == pytest.approx(-1.0)  # straight back into the circle
    assert follower.at(1400.0, 0.0).status.activity is Activity.LINE
    assert follower.state.halt is None


def test_station_keeping_and_orbits_continue_with_an_uncertain_position(follower, origin):
    station, circle = HoldStation(origin, 100.0), Orbit(origin, 200.0, clockwise=True)
    follower.at(50.0, 100.1, task=station)
    assert (follower.status.activity, follower.state.arrived, follower.texts) == (Activity.STATION, False, [])
    assert follower.at(50.0, 100.0, task=station).state.arrived
    follower.at(200.0, 200.1, task=circle)
    assert (follower.status.activity, follower.state.arrived, follower.texts) == (Activity.CIRCLE, False, [])
    assert follower.at(200.0, 200.0, task=circle).state.arrived


@pytest.mark.parametrize(("distance_m", "is_counted"), [(29.9, False), (30.1, True), (89.9, True), (90.1, False)])
@pytest.mark.parametrize(("clockwise", "sign"), [(True, 1.0), (False, -1.0)])
def test_turns_are_counted_within_half_a_radius_of_the_circle(
    origin, task_settings, distance_m, is_counted, clockwise, sign
):
    circle = Orbit(origin, 60.0, clockwise)
    state = TaskFollowerState(circle)
    for bearing_rad in (0.0, 0.5):
        place = origin.at_offset(distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad))
        motion = VesselMotion(place, 0.0, 0.4, 0.0, 0.0)
        state, status = task_follower.update(task_settings, state, circle, motion, 1.0)
    assert state.arrived is is_counted
    assert state.orbit.turned_rad == pytest.approx(sign * 0.5 * is_counted, abs=0.001)
    assert (status.target, status.radius_m) == (origin, 60.0)
    assert (status.bearing_rad, status.distance_m) == pytest.approx((0.5 + math.pi, distance_m), abs=0.001)
    assert status.cross_track_m == pytest.approx(sign * (60.0 - distance_m), abs=0.001)


def test_heading_needs_no_position_and_another_task_waits_for_one(origin, task_settings):
    heading, station = HoldHeading(1.0), HoldStation(origin, 100.0)
    state, status = task_follower.update(task_settings, TaskFollowerState(station), heading, None, 1.0)
    assert state == TaskFollowerState(heading)
    assert status == TaskStatus(HeadingTarget(1.0, over_ground=False), Activity.HEADING)
    assert task_follower.update(task_settings, state, station, None, 1.0) == (state, None)
    assert task_follower.update(task_settings, state, None, None, 1.0) == (TaskFollowerState(), TaskStatus())


def test_turns_are_counted_only_with_a_certain_position(follower, origin):
    circle = Orbit(origin, 200.0, clockwise=True)
    for spread_m, is_counted in ((200.1, False), (200.0, True)):
        follower.state = TaskFollowerState(circle)
        for bearing_rad in (0.0, 0.5, 1.0):
            place = origin.at_offset(200.0 * math.cos(bearing_rad), 200.0 * math.sin(bearing_rad))
            motion = VesselMotion(place, bearing_rad + math.pi / 2, 0.4, 0.0, 0.0, spread_m=spread_m)
            follower.state, _ = task_follower.update(follower.settings, follower.state, circle, motion, 1.0)
        assert (follower.state.orbit.turned_rad == pytest.approx(1.0, abs=0.01)) is is_counted
