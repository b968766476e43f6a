"""Station keeping of a simulated boat."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.reports import Activity
from firmware_py.guidance import station_keeping
from firmware_py.guidance.station_keeping import StationKeepingState
from firmware_py.guidance.tasks import HeadingTarget, HoldStation, VesselMotion


@pytest.mark.parametrize(
    ("speed_ratio", "toward_rad", "leeway_deg"),
    [
        *((ratio, toward_rad, 0.0) for ratio, toward_rad in ((0.0, 0.0), (0.3, 2.0), (0.7, 0.0), (0.85, 2.0))),
        *((0.7, 0.5 * math.pi, leeway_deg) for leeway_deg in (0.0, 20.0, -20.0)),
    ],
)
def test_boat_stays_in_the_circle_with_few_turns(simulated_boat, origin, speed_ratio, toward_rad, leeway_deg):
    current_m_s = 0.4 * speed_ratio
    boat = simulated_boat(
        current=(current_m_s * math.cos(toward_rad), current_m_s * math.sin(toward_rad)),
        leeway_rad=math.radians(leeway_deg),
    )
    inside, against = 0, 0
    for _ in range(8000):
        boat.step(HoldStation(origin, 100.0))
        inside += boat.distance_m() <= 100.0
        against += math.cos(boat.heading_rad - toward_rad) < -0.8
    assert inside >= 0.97 * 8000
    if leeway_deg == 0.0:
        # A continuous turn at full rudder has more than three times this angle.
        assert boat.turned_rad < 8000 * 0.4 / 15.6 / 3.0
        if toward_rad == 0.5 * math.pi:
            assert against > 0.5 * 8000  # the boat heads against the current


def test_boat_returns_straight_from_outside(simulated_boat, origin):
    boat = simulated_boat(600.0, -300.0, current=(0.1, -0.1))
    task = HoldStation(origin, 100.0)
    status = boat.step(task)
    assert status.activity is Activity.STATION
    assert status.heading_target.over_ground
    start_m = boat.distance_m()
    while boat.distance_m() > 100.0:
        boat.step(task)
        assert boat.t_s < 3000.0
    assert not boat.follower.arrived
    assert not boat.step(task).heading_target.over_ground
    assert boat.follower.arrived
    assert start_m / boat.t_s > 0.2


@pytest.mark.parametrize(
    ("radius_m", "turning_radius_m", "north_m"),
    [(100.0, 15.6, 60.91), (40.0, 5.0, 22.10)],
)
@pytest.mark.parametrize(("off_m", "is_kept"), [(-0.1, True), (0.1, False)])
def test_leg_ends_where_a_turn_back_after_10_s_would_leave_the_margin(
    origin, task_settings, radius_m, turning_radius_m, north_m, off_m, is_kept
):
    """The margin is a tenth of the radius, at least 6 m; the turn is at 0.7 of the full rate."""
    settings = replace(task_settings, turning_radius_m=turning_radius_m)
    north_m += off_m
    motion = VesselMotion(origin.at_offset(north_m, 0.0), 0.0, 0.4, 0.0, 0.0)
    state, _ = station_keeping.update(
        settings, StationKeepingState(0.0), HoldStation(origin, radius_m), motion, north_m
    )
    assert (state.way_rad == 0.0) is is_kept


def expected_leg_rad(motion, turning_radius_m, north_m, east_m, limit_m):
    """Return the leg with the longest time inside the limit, by an independent computation of all turns.

    A turn is an arc at 0.7 of the full rate that drifts with the current; a radian of it costs 30 s.
    """
    speed_m_s, way_rad = motion.speed_m_s, motion.heading_rad + motion.leeway_rad
    current = np.array([motion.current_north_m_s, motion.current_east_m_s])
    start, radius_m = np.array([north_m, east_m]), turning_radius_m / 0.7
    values = {}
    for number in range(36):
        angle_rad = wrap_pi(math.radians(10.0 * number))
        side = math.copysign(1.0, angle_rad)

        def arc(rad, side=side):
            return side * radius_m * np.array([math.sin(way_rad + rad), -math.cos(way_rad + rad)])

        turn_s = abs(angle_rad) * radius_m / max(speed_m_s, 0.05)
        middle, end = (start + arc(share * angle_rad) - arc(0.0) + share * turn_s * current for share in (0.5, 1.0))
        leg_rad = way_rad + angle_rad
        velocity = current + speed_m_s * np.array([math.cos(leg_rad), math.sin(leg_rad)])
        stay_s = 0.0
        if np.hypot(*end) < limit_m:
            stay_s = min(
                7200.0, max(np.roots([velocity @ velocity, 2.0 * end @ velocity, end @ end - limit_m**2]).real)
            )
        outside_m = max(0.0, max(np.hypot(*place) for place in (start, middle, end)) - limit_m)
        values[leg_rad] = (-round(outside_m, 9), turn_s + stay_s - 30.0 * abs(angle_rad))
    return max(values, key=values.get)


def test_next_leg_is_that_with_the_longest_time_inside(origin, task_settings):
    rng = random.Random(5)
    for number in range(150):
        radius_m, speed_m_s = rng.choice((30.0, 100.0, 400.0)), rng.choice((0.02, 0.2, 0.4, 0.8))
        distance_m, bearing_rad = radius_m * rng.uniform(0.0, 0.99), rng.uniform(0.0, 2.0 * math.pi)
        north_m, east_m = distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)
        current = [rng.uniform(-0.9, 0.9) * speed_m_s * (number % 3 > 0) for _ in "ne"]
        motion = VesselMotion(
            origin.at_offset(north_m, east_m),
            rng.uniform(0.0, 6.28),
            speed_m_s,
            *current,
            leeway_rad=rng.uniform(-0.2, 0.2),
        )
        task = HoldStation(origin, radius_m)
        state, target = station_keeping.update(task_settings, StationKeepingState(), task, motion, distance_m)
        limit_m = radius_m - min(max(6.0, 0.1 * radius_m), 0.25 * radius_m)
        expected_rad = expected_leg_rad(motion, 15.6, *origin.offset_m(motion.place), limit_m)
        assert math.remainder(state.way_rad - expected_rad, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6), number
        assert target == HeadingTarget(pytest.approx((state.way_rad - motion.leeway_rad) % (2.0 * math.pi)), False)


@pytest.mark.parametrize(("heading_rad", "is_kept"), [(0.34, False), (0.36, True), (-0.34, False), (-0.36, True)])
def test_leg_is_kept_during_the_turn_to_it(origin, task_settings, heading_rad, is_kept):
    motion = VesselMotion(origin.at_offset(80.0, 0.0), heading_rad, 0.4, 0.0, 0.0)
    task = HoldStation(origin, 100.0)
    state, _ = station_keeping.update(task_settings, StationKeepingState(0.0), task, motion, 80.0)
    assert (state.way_rad == 0.0) is is_kept


@pytest.mark.parametrize("leeway_deg", [0.0, 8.0, -8.0])
def test_boat_heads_against_a_current_that_is_too_strong(simulated_boat, origin, leeway_deg):
    boat = simulated_boat(current=(0.0, 0.48), leeway_rad=math.radians(leeway_deg))
    for _ in range(3000):
        boat.step(HoldStation(origin, 100.0))
    assert boat.distance_m() > 100.0
    assert math.degrees(boat.heading_rad) == pytest.approx(270.0 - leeway_deg, abs=1.0)


def test_boat_stays_near_a_circle_smaller_than_the_turning_circle(simulated_boat, origin):
    boat = simulated_boat()
    max_distance_m = 0.0
    for second in range(6000):
        boat.step(HoldStation(origin, 10.0))
        max_distance_m = max(max_distance_m, boat.distance_m()) if second > 500 else 0.0
    assert max_distance_m < 70.0


angles = st.floats(-math.pi, math.pi)


@given(
    st.builds(Place, st.floats(-math.pi / 2, math.pi / 2), angles),
    st.builds(Place, st.floats(-math.pi / 2, math.pi / 2), angles),
    angles,
    st.floats(0.0, 5.0),
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.none() | angles,
    st.floats(10.0, 1e4),
)
def test_angle_is_finite_for_any_input(
    here, centre, heading_rad, speed_m_s, current_north_m_s, current_east_m_s, leg_rad, radius_m
):
    from tests.unit.firmware_py.guidance.conftest import SETTINGS  # noqa: PLC0415

    motion = VesselMotion(here, heading_rad, speed_m_s, current_north_m_s, current_east_m_s)
    distance_m, _ = here.distance_and_bearing(centre)
    _, target = station_keeping.update(
        SETTINGS, StationKeepingState(leg_rad), HoldStation(centre, radius_m), motion, distance_m
    )
    assert math.isfinite(target.angle_rad)
