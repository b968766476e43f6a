"""Line following and arrival of a simulated boat."""

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


def go_to(origin, north_m, east_m, start=(0.0, 0.0), acceptance_radius_m=20.0):
    return GoTo(
        origin.at_offset(north_m, east_m),
        None if start is None else origin.at_offset(*start),
        acceptance_radius_m,
        100.0,
    )


@pytest.mark.parametrize("current_m_s", [(0.0, 0.0), (0.0, 0.2), (-0.2, 0.1), (0.3, 0.0)])
def test_boat_converges_to_the_line(simulated_boat, origin, current_m_s):
    boat = simulated_boat(0.0, 80.0, 2.0, current=current_m_s)
    task = go_to(origin, 5000.0, 0.0)
    for _ in range(2000):
        boat.step(task)
    errors_m = [abs(boat.step(task).cross_track_m) for _ in range(500)]
    assert max(errors_m) < 2.0
    assert boat.status.activity is Activity.LINE


def test_integral_compensates_an_unknown_current(simulated_boat, origin):
    boat = simulated_boat()
    task = go_to(origin, 5000.0, 0.0)
    for _ in range(3000):
        boat.step(task)
        boat.east_m += 0.1  # a second in a current that guidance does not know
    assert abs(boat.status.cross_track_m) < 1.5


def test_integral_follows_the_law_of_integral_line_of_sight(origin, task_settings):
    """Equation of Caharija et al. (2016), with the integral in seconds."""
    error_m, initial_integral_s = 8.0, 200.0
    motion = VesselMotion(origin.at_offset(100.0, error_m), 0.0, 0.4, 0.0, 0.0)
    state, status = line.update(
        task_settings, LineState(origin, initial_integral_s), go_to(origin, 1000.0, 0.0), motion, 2.0
    )
    look_m, offset_m = look_ahead_m(task_settings, motion), error_m + 0.1 * 0.4 * initial_integral_s
    assert state.integral_s - initial_integral_s == pytest.approx(
        2.0 * look_m * error_m / (look_m**2 + offset_m**2), rel=1e-3
    )
    assert status.course_rad == pytest.approx(2.0 * math.pi - math.atan2(offset_m, look_m), rel=1e-3)


@pytest.mark.parametrize(
    ("error_m", "speed_m_s", "initial_integral_s", "integral_s"),
    [
        (9.4, 0.4, 200.0, 200.0),  # constant at more than 0.3 look-ahead distances of 31.2 m
        (20.0, 0.4, 1e9, 390.0),  # at most half a look-ahead distance, at 0.1 of the speed
        (20.0, 0.4, -1e9, -390.0),
        (20.0, 0.0, 1e9, 15_600.0),
    ],
)
def test_integral_is_limited(origin, task_settings, error_m, speed_m_s, initial_integral_s, integral_s):
    motion = VesselMotion(origin.at_offset(100.0, error_m), 0.0, speed_m_s, 0.0, 0.0)
    state, _ = line.update(
        task_settings, LineState(origin, initial_integral_s), go_to(origin, 1000.0, 0.0), motion, 2.0
    )
    assert state.integral_s == pytest.approx(integral_s)


@pytest.mark.parametrize(
    ("current_m_s", "speed_m_s", "circles"),
    [(0.0, 0.4, 1.0), (0.1, 0.4, 1.25), (0.4, 0.4, 2.0), (2.0, 0.4, 2.0), (0.025, 0.0, 1.5)],
)
def test_passing_distance_grows_with_the_current(origin, task_settings, current_m_s, speed_m_s, circles):
    max_passing_m = circles * 2.0 * task_settings.turning_radius_m
    for error_m, arrived in ((0.98 * max_passing_m, True), (1.02 * max_passing_m, False)):
        motion = VesselMotion(origin.at_offset(501.0, error_m), 0.0, speed_m_s, current_m_s, 0.0)
        _, status = line.update(
            task_settings, LineState(origin), go_to(origin, 500.0, 0.0, acceptance_radius_m=1.0), motion, 1.0
        )
        assert status.arrived is arrived


@pytest.mark.parametrize(
    ("closest_m", "distance_m", "has_arrived"), [(25.0, 29.9, False), (25.0, 30.1, True), (32.0, 60.0, False)]
)
def test_boat_that_moves_away_from_a_near_waypoint_has_arrived(
    origin, task_settings, closest_m, distance_m, has_arrived
):
    state, task = LineState(origin, closest_m=closest_m), go_to(origin, 500.0, 0.0, acceptance_radius_m=1.0)
    motion = VesselMotion(origin.at_offset(500.0 - distance_m, 0.0), math.pi, 0.4, 0.0, 0.0)
    assert line.update(task_settings, state, task, motion, 1.0)[1].arrived is has_arrived


def test_look_ahead_grows_with_speed_between_limits(origin, task_settings):
    def look_m(speed_m_s):
        return look_ahead_m(task_settings, VesselMotion(origin, 0.0, speed_m_s, 0.0, 0.0))

    assert look_m(0.05) == pytest.approx(2 * 15.6)
    assert look_m(1.0) == 60.0
    assert look_m(50.0) == 500.0


@pytest.mark.parametrize("distance_m", [3.0, 18.0, 70.0])
@pytest.mark.parametrize("current_m_s", [(0.0, 0.0), (0.15, 0.2), (-0.3, 0.0)])
def test_place_within_the_turning_circle_is_reached(simulated_boat, origin, distance_m, current_m_s):
    for angle_rad in map(math.radians, range(0, 360, 45)):
        boat = simulated_boat(current=current_m_s)
        place_m = distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad)
        task = go_to(origin, *place_m, None, acceptance_radius_m=2.0)
        while not boat.follower.arrived:
            boat.step(task)
            assert boat.t_s < 5000.0, angle_rad
        assert boat.distance_m(*place_m) < 60.0, angle_rad


@pytest.mark.parametrize("distance_m", [26.0, 30.0, 43.0])
def test_place_astern_is_not_passed_during_the_turn(simulated_boat, origin, distance_m):
    boat = simulated_boat()
    task = go_to(origin, -distance_m, 0.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 1000.0
    assert boat.distance_m(-distance_m) <= 20.0


@pytest.mark.parametrize("current_m_s", [-0.45, -0.41])
def test_drift_back_from_a_waypoint_is_no_arrival(simulated_boat, origin, current_m_s):
    boat = simulated_boat(40.0, 0.0, 0.0)
    task = go_to(origin, 70.0, 0.0)
    for _ in range(20):
        boat.step(task)
    boat.current = (current_m_s, 0.0)
    while boat.distance_m(70.0) < 90.0:
        boat.step(task)
    assert not boat.follower.arrived
    boat.current = (0.1, 0.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 10_000.0
    assert boat.distance_m(70.0) <= 20.0


def test_end_of_the_line_is_reached_in_a_strong_current(simulated_boat, origin):
    """During the turn the current moves the boat off the line; the current also brings it back."""
    boat = simulated_boat(60.0, 0.0, 0.0, current=(0.31, 0.31))
    task = go_to(origin, 0.0, 800.0)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 6000.0
    assert boat.distance_m(0.0, 800.0) <= 20.0


def test_closest_distance_is_stored_only_while_the_distance_decreases(origin, task_settings):
    for heading_deg, bearing_deg in itertools.product(range(0, 360, 60), range(7, 360, 30)):
        bearing_rad = math.radians(bearing_deg)
        place = go_to(origin, 50.0 * math.cos(bearing_rad), 50.0 * math.sin(bearing_rad), acceptance_radius_m=5.0)
        motion = VesselMotion(origin, math.radians(heading_deg), 0.4, 0.1, -0.2)
        north_m_s, east_m_s = 0.4 * math.cos(motion.heading_rad) + 0.1, 0.4 * math.sin(motion.heading_rad) - 0.2
        closing_m_s = north_m_s * math.cos(bearing_rad) + east_m_s * math.sin(bearing_rad)
        state, _ = line.update(task_settings, LineState(origin), place, motion, 0.1)
        assert math.isfinite(state.closest_m) is (closing_m_s > 0.0), (heading_deg, bearing_deg)


def test_waypoint_passed_at_a_large_distance_is_tried_again(origin, task_settings):
    task = go_to(origin, 500.0, 0.0)
    place = origin.at_offset(510.0, 300.0)
    motion = VesselMotion(place, 0.0, 0.4, 0.0, 0.0)
    state, status = line.update(task_settings, LineState(origin, 200.0, 80.0), task, motion, 1.0)
    assert not status.arrived
    assert state == LineState(place, tries=1)


@pytest.mark.parametrize(("too_strong", "passes"), [(False, 3), (True, 20)])
def test_large_distance_is_accepted_after_several_tries_except_in_a_too_strong_current(
    origin, task_settings, too_strong, passes
):
    task, state, arrived = go_to(origin, 500.0, 0.0), LineState(origin), []
    for number in range(passes + 1):
        beyond = VesselMotion(origin.at_offset(510.0, 300.0), 0.0, 0.4, 0.5, 0.0, too_strong)
        former = LineState(origin, 200.0, 300.0, state.tries)
        state, status = line.update(task_settings, former, task, beyond, 1.0)
        arrived.append(status.arrived)
        tries = 0 if too_strong else min(number + 1, 3)
        assert state.tries == tries
        assert status.arrived or state == LineState(beyond.place, tries=tries)
    assert arrived == [False] * passes + [not too_strong]


@pytest.mark.parametrize(("east_m", "has_arrived"), [(990.0, True), (1010.0, False)])
def test_distance_that_is_accepted_after_several_tries_is_limited(origin, task_settings, east_m, has_arrived):
    motion = VesselMotion(origin.at_offset(510.0, east_m), 0.0, 0.4, 0.5, 0.0)
    _, status = line.update(task_settings, LineState(origin, tries=3), go_to(origin, 500.0, 0.0), motion, 1.0)
    assert status.arrived is has_arrived


numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e6, max_value=1e6)
angles = st.floats(-math.pi, math.pi)
anywhere = st.builds(Place, st.floats(-math.pi / 2, math.pi / 2), angles)
speeds = st.floats(0.0, 5.0)
motions = st.builds(VesselMotion, anywhere, angles, speeds, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.booleans())


@given(motions, anywhere, anywhere, st.floats(0.1, 1e4), st.floats(-1e9, 1e9), st.floats(0.0, 5.0))
def test_course_is_finite_for_any_input(motion, start, to, acceptance_radius_m, integral_s, step_s):
    task = GoTo(to, start, acceptance_radius_m, 100.0)
    limits = TaskSettings(20.0, 100.0, 60.0, 15.6)
    state, status = line.update(limits, LineState(start, integral_s), task, motion, step_s)
    assert 0.0 <= status.course_rad < 2 * math.pi
    assert math.isfinite(state.integral_s)
    assert state.tries <= 3


@given(
    st.floats(-300.0, 300.0),
    st.floats(-300.0, 300.0),
    st.floats(0.0, 6.28),
    st.floats(2.0, 40.0),
    st.floats(0.0, 0.75),
    st.floats(0.0, 6.28),
)
def test_place_is_always_reached(north_m, east_m, heading_rad, acceptance_radius_m, drift, toward_rad):
    from tests.unit.firmware_py.guidance.conftest import ORIGIN, SimulatedBoat  # noqa: PLC0415

    current_m_s = (0.4 * drift * math.cos(toward_rad), 0.4 * drift * math.sin(toward_rad))
    boat = SimulatedBoat(heading_rad=heading_rad, current=current_m_s)
    task = go_to(ORIGIN, north_m, east_m, None, acceptance_radius_m)
    while not boat.follower.arrived:
        boat.step(task)
        assert boat.t_s < 300.0 + 20.0 * (boat.distance_m() + 500.0) / 0.4


@pytest.mark.parametrize(("north_m", "integral_s"), [(501.0, 0.0), (400.0, 200.0)])
def test_passing_with_a_position_error_above_the_radius_begins_a_new_line(origin, task_settings, north_m, integral_s):
    place = origin.at_offset(north_m, 1.0)
    motion = VesselMotion(place, 0.0, 0.4, 0.0, 0.0, spread_m=50.0)
    state, status = line.update(task_settings, LineState(origin, 200.0), go_to(origin, 500.0, 0.0), motion, 0.0)
    assert not status.arrived
    assert state.integral_s == pytest.approx(integral_s)
    assert state.tries == LineState(origin).tries
