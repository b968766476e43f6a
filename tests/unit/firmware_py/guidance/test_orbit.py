"""Circling a place with a simulated boat."""

import math

import pytest

from firmware_py.common.reports import Activity
from firmware_py.guidance import orbit
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.tasks import Orbit, VesselMotion


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, 0.2)])
def test_boat_follows_the_circle_and_counts_turns(simulated_boat, origin, clockwise, current):
    boat = simulated_boat(300.0, 0.0, 3.0, current=current)
    task = Orbit(origin, 60.0, clockwise)
    errors_m = []
    while boat.follower.orbit.turned_rad < 4 * math.pi:
        boat.step(task)
        assert boat.t_s < 9000.0
        if boat.follower.orbit.turned_rad > math.pi:
            errors_m.append(abs(boat.distance_m() - 60.0))
    assert max(errors_m) < 15.0
    assert boat.status.activity is Activity.CIRCLE
    assert boat.follower.arrived


def test_circle_below_the_minimum_radius_is_enlarged(simulated_boat, origin):
    boat = simulated_boat()
    for _ in range(600):
        boat.step(Orbit(origin, 5.0, clockwise=True))
    assert boat.status.radius_m == pytest.approx(1.5 * 15.6)
    assert boat.distance_m() == pytest.approx(1.5 * 15.6, abs=6.0)


@pytest.mark.parametrize(("distance_m", "inward_rad"), [(60.0, 0.0), (75.6, 0.25 * math.pi), (44.4, -0.25 * math.pi)])
@pytest.mark.parametrize(("clockwise", "sign"), [(True, 1.0), (False, -1.0)])
def test_course_leads_along_the_circle_and_points_to_it(origin, task_settings, distance_m, inward_rad, clockwise, sign):
    motion = VesselMotion(origin.at_offset(distance_m, 0.0), 0.0, 0.4, 0.0, 0.0)
    _, course_rad = orbit.update(task_settings, OrbitState(), Orbit(origin, 60.0, clockwise), motion)
    expected_rad = sign * (0.5 * math.pi + 8.0 * 0.4 / 60.0 + inward_rad)
    assert math.remainder(course_rad - expected_rad, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-3)
