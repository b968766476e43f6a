"""Line following and arrival, with an ideal boat in a plane."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import Place
from firmware_py.common.reports import Activity
from firmware_py.guidance import line
from firmware_py.guidance.line import LineState, look_ahead_m
from firmware_py.guidance.tasks import GoTo, TaskSettings, VesselMotion


def go(origin, north_m, east_m, start=(0.0, 0.0), acceptance_radius_m=20.0):
    return GoTo(
        origin.at_offset(north_m, east_m),
        None if start is None else origin.at_offset(*start),
        acceptance_radius_m,
        100.0,
    )


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, 0.2), (-0.2, 0.1), (0.3, 0.0)])
def test_the_boat_joins_the_line_and_stays_on_it(simulated_boat, origin, current):
    boat = simulated_boat(0.0, 80.0, 2.0, current=current)
    task = go(origin, 5000.0, 0.0)
    for _ in range(2000):
        boat.step(task)
    off = [abs(boat.step(task).cross_track_m) for _ in range(500)]
    assert max(off) < 2.0
    assert boat.status.activity is Activity.LINE


def test_the_integral_compensates_an_unknown_current(simulated_boat, origin):
    boat = simulated_boat(current=(0.0, 0.1))
    task = go(origin, 5000.0, 0.0)
    real, boat.current = boat.current, (0.0, 0.0)
    for _ in range(3000):
        boat.step(task)
        boat.east_m += real[1]
    assert abs(boat.status.cross_track_m) < 1.5


def test_the_integral_grows_by_the_law_of_integral_line_of_sight(origin, tight):
    """Source: that of the module (Caharija et al.), the integral in seconds."""
    off_m, before_s = 8.0, 200.0
    motion = VesselMotion(origin.at_offset(100.0, off_m), 0.0, 0.4, 0.0, 0.0)
    state, status = line.update(tight, LineState(origin, before_s), go(origin, 1000.0, 0.0), motion, 2.0)
    look_m, aim_m = look_ahead_m(tight, motion), off_m + line.INTEGRAL_SPEED_FRACTION * 0.4 * before_s
    assert state.integral_s - before_s == pytest.approx(2.0 * look_m * off_m / (look_m**2 + aim_m**2), rel=1e-3)
    assert status.course_rad == pytest.approx(2.0 * math.pi - math.atan2(aim_m, look_m), rel=1e-3)


@pytest.mark.parametrize(("current_m_s", "circles"), [(0.0, 1.0), (0.1, 1.25), (0.4, 2.0), (2.0, 2.0)])
def test_the_passing_distance_grows_with_the_current(origin, tight, current_m_s, circles):
    reach_m = circles * line.PASSING_RADII * tight.turning_radius_m
    for off_m, arrived in ((0.98 * reach_m, True), (1.02 * reach_m, False)):
        motion = VesselMotion(origin.at_offset(501.0, off_m), 0.0, 0.4, current_m_s, 0.0)
        _, status = line.update(tight, LineState(origin), go(origin, 500.0, 0.0, acceptance_radius_m=1.0), motion, 1.0)
        assert status.arrived is arrived


def test_the_look_ahead_grows_with_speed_within_bounds(origin, tight):
    def at(speed_m_s):
        return look_ahead_m(tight, VesselMotion(origin, 0.0, speed_m_s, 0.0, 0.0))

    assert at(0.05) == pytest.approx(2 * 15.6)
    assert at(1.0) == 60.0
    assert at(50.0) == line.MAX_LOOK_AHEAD_M


@pytest.mark.parametrize("distance_m", [3.0, 18.0, 70.0])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.15, 0.2), (-0.3, 0.0)])
def test_a_place_within_the_turning_circle_is_reached(simulated_boat, origin, distance_m, current):
    for angle_rad in map(math.radians, range(0, 360, 45)):
        boat = simulated_boat(current=current)
        place_m = distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad)
        task = go(origin, *place_m, None, acceptance_radius_m=2.0)
        while not boat.follower.arrived:
            boat.step(task)
            assert boat.t_s < 5000.0, angle_rad
        assert boat.distance_m(*place_m) < 60.0, angle_rad


@pytest.mark.parametrize("distance_m", [26.0, 30.0, 43.0])
def test_a_place_astern_is_not_passed_during_the_turn(simulated_boat, origin, distance_m):
    boat = simulated_boat()
    task = go(origin, -distance_m, 0.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 1000.0
    assert boat.distance_m(-distance_m) <= 20.0


@pytest.mark.parametrize("setting", [-0.45, -0.41])
def test_drifting_back_from_a_waypoint_does_not_count_as_passing_it(simulated_boat, origin, setting):
    boat = simulated_boat(40.0, 0.0, 0.0)
    task = go(origin, 70.0, 0.0)
    for _ in range(20):
        boat.step(task)
    boat.current = (setting, 0.0)
    while boat.distance_m(70.0) < 90.0:
        boat.step(task)
    assert not boat.follower.arrived
    boat.current = (0.1, 0.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 10_000.0
    assert boat.distance_m(70.0) <= 20.0


def test_a_line_is_reached_in_a_stronger_current(simulated_boat, origin):
    """The turn sets the boat off the line; it returns with the current."""
    boat = simulated_boat(60.0, 0.0, 0.0, current=(0.31, 0.31))
    task = go(origin, 0.0, 800.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 6000.0
    assert boat.distance_m(0.0, 800.0) <= 20.0


def test_the_closest_distance_counts_only_while_closing(origin, tight):
    for heading_deg, bearing_deg in itertools.product(range(0, 360, 60), range(7, 360, 30)):
        bearing_rad = math.radians(bearing_deg)
        place = go(origin, 50.0 * math.cos(bearing_rad), 50.0 * math.sin(bearing_rad), acceptance_radius_m=5.0)
        motion = VesselMotion(origin, math.radians(heading_deg), 0.4, 0.1, -0.2)
        north_m_s, east_m_s = 0.4 * math.cos(motion.heading_rad) + 0.1, 0.4 * math.sin(motion.heading_rad) - 0.2
        closing_m_s = north_m_s * math.cos(bearing_rad) + east_m_s * math.sin(bearing_rad)
        state, _ = line.update(tight, LineState(origin), place, motion, 0.1)
        assert math.isfinite(state.closest_m) is (closing_m_s > 0.0), (heading_deg, bearing_deg)


def test_a_waypoint_passed_far_off_is_tried_again(origin, tight):
    task = go(origin, 500.0, 0.0)
    here = origin.at_offset(510.0, 300.0)
    motion = VesselMotion(here, 0.0, 0.4, 0.0, 0.0)
    state, status = line.update(tight, LineState(origin), task, motion, 1.0)
    assert not status.arrived
    assert (state.start, state.tries) == (here, 1)


@pytest.mark.parametrize(("too_strong", "passes"), [(False, line.MAX_TRIES), (True, 20)])
def test_passing_far_off_counts_after_several_tries_but_not_in_too_strong_a_current(origin, tight, too_strong, passes):
    task, state, arrived = go(origin, 500.0, 0.0), LineState(origin), []
    for number in range(passes + 1):
        beyond = VesselMotion(origin.at_offset(510.0, 300.0), 0.0, 0.4, 0.5, 0.0, too_strong)
        state, status = line.update(tight, LineState(origin, tries=state.tries), task, beyond, 1.0)
        arrived.append(status.arrived)
        assert state.tries == (0 if too_strong else min(number + 1, line.MAX_TRIES))
    assert arrived == [False] * passes + [not too_strong]


numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e6, max_value=1e6)
angles = st.floats(-math.pi, math.pi)
anywhere = st.builds(Place, st.floats(-math.pi / 2, math.pi / 2), angles)
speeds = st.floats(0.0, 5.0)
motions = st.builds(VesselMotion, anywhere, angles, speeds, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.booleans())


@given(motions, anywhere, anywhere, st.floats(0.1, 1e4), st.floats(-1e9, 1e9), st.floats(0.0, 5.0))
def test_any_input_gives_a_finite_course(motion, start, to, acceptance_radius_m, integral_s, step_s):
    task = GoTo(to, start, acceptance_radius_m, 100.0)
    limits = TaskSettings(20.0, 100.0, 60.0, 15.6)
    state, status = line.update(limits, LineState(start, integral_s), task, motion, step_s)
    assert 0.0 <= status.course_rad < 2 * math.pi
    assert math.isfinite(state.integral_s)
    assert state.tries <= line.MAX_TRIES


@given(
    st.floats(-300.0, 300.0),
    st.floats(-300.0, 300.0),
    st.floats(0.0, 6.28),
    st.floats(2.0, 40.0),
    st.floats(0.0, 0.75),
    st.floats(0.0, 6.28),
)
def test_acceptance_always_progresses(north_m, east_m, heading_rad, acceptance_radius_m, drift, toward_rad):
    from tests.unit.firmware_py.guidance.conftest import ORIGIN, Float  # noqa: PLC0415

    current = (0.4 * drift * math.cos(toward_rad), 0.4 * drift * math.sin(toward_rad))
    boat = Float(heading_rad=heading_rad, current=current)
    task = go(ORIGIN, north_m, east_m, None, acceptance_radius_m)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 300.0 + 20.0 * (boat.distance_m() + 500.0) / 0.4
