"""Tasks under dead reckoning: arrival needs a certain position, otherwise the boat waits."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.reports import Activity
from firmware_py.guidance import task_follower
from firmware_py.guidance.guidance_reports import dead_reckoning_events
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, HoldStation, Orbit, VesselMotion

FAR_M = 3000.0
TEXTS = {
    "there": "Probably at the waypoint (no GPS); waiting for a fix",
    "here": "Position too uncertain; holding here until GPS returns",
}


@pytest.fixture
def way(origin, tight):
    """Guidance towards a place FAR_M north, at given positions."""

    class Way:
        settings = replace(tight, dead_reckoning_limit_m=500.0)
        task = GoTo(origin.at_offset(FAR_M, 0.0), origin, 20.0, 100.0)
        state = TaskFollowerState()
        status = None
        texts = ()

        def at(self, north_m, spread_m, heading_rad=0.0, task=None):
            motion = VesselMotion(origin.at_offset(north_m, 0.0), heading_rad, 0.4, 0.0, 0.0, spread_m=spread_m)
            before = self.state
            self.state, self.status = task_follower.update(self.settings, before, task or self.task, motion, 1.0)
            self.texts = [event.text for event in dead_reckoning_events(before, self.state, begins=False)]
            return self

        @property
        def north_m(self):
            return origin.offset_m(self.status.target)[0]

    return Way()


@pytest.mark.parametrize(("spread_m", "arrived"), [(0.0, True), (19.0, True), (21.0, False), (900.0, False)])
def test_a_place_is_reached_only_if_the_position_is_certain(way, spread_m, arrived):
    assert way.at(FAR_M - 15.0, spread_m).state.arrived is arrived
    assert way.status.activity is Activity.STATION
    assert way.north_m == pytest.approx(FAR_M, abs=0.1)
    assert way.texts == ([] if arrived else [TEXTS["there"]])
    assert way.at(FAR_M - 15.0, spread_m).texts == []
    assert way.at(FAR_M - 15.0, 0.0).state.arrived  # with a fix
    assert way.state.halt is None


def test_a_fix_far_from_the_estimated_position_resumes_the_line(way):
    for north_m in range(2900, 3000, 2):
        way.at(float(north_m), 25.0)
    way.at(FAR_M - 300.0, 0.0)
    assert not way.state.arrived
    assert way.status.activity is Activity.LINE
    assert math.cos(way.status.heading_target.angle_rad) == pytest.approx(1.0)


def test_dead_reckoning_alone_does_not_pass_a_waypoint(way):
    for north_m in range(2400, 3400, 5):
        assert not way.at(float(north_m), 25.0).state.arrived


def test_too_uncertain_on_the_way_the_boat_waits_for_a_fix(way):
    assert way.at(1000.0, 499.0).status.activity is Activity.LINE
    assert way.at(1100.0, 501.0).texts == [TEXTS["here"]]
    for north_m, spread_m in ((1150.0, 600.0), (1080.0, 450.0), (1250.0, 700.0)):
        assert way.at(north_m, spread_m).texts == []
        assert (way.status.activity, way.state.arrived) == (Activity.STATION, False)
        assert way.north_m == pytest.approx(1100.0, abs=0.1)
    back_rad = way.status.heading_target.angle_rad
    assert math.cos(back_rad) == pytest.approx(-1.0)  # out of the circle, straight back
    assert way.at(1400.0, 0.0).status.activity is Activity.LINE
    assert way.state.halt is None


def test_station_keeping_and_orbits_continue_with_an_uncertain_position(way, origin):
    station, circle = HoldStation(origin, 100.0), Orbit(origin, 200.0, clockwise=True)
    way.at(50.0, 5000.0, task=station)
    assert (way.status.activity, way.state.arrived, way.texts) == (Activity.STATION, False, [])
    way.at(200.0, 5000.0, task=circle)
    assert (way.status.activity, way.state.arrived, way.texts) == (Activity.CIRCLE, False, [])
    assert way.at(200.0, 199.0, task=circle).state.arrived


def test_turns_count_while_the_circle_is_certain(way, origin):
    circle = Orbit(origin, 200.0, clockwise=True)
    for spread_m, turned in ((5000.0, False), (50.0, True)):
        way.state = TaskFollowerState(circle)
        for bearing_rad in (0.0, 0.5, 1.0):
            place = origin.at_offset(200.0 * math.cos(bearing_rad), 200.0 * math.sin(bearing_rad))
            motion = VesselMotion(place, bearing_rad + math.pi / 2, 0.4, 0.0, 0.0, spread_m=spread_m)
            way.state, _ = task_follower.update(way.settings, way.state, circle, motion, 1.0)
        assert (way.state.orbit.turned_rad == pytest.approx(1.0, abs=0.01)) is turned
