"""Quantities that the devices measure, and the recorded truth."""

import math

import pytest

from firmware_py.common.angles import degrees, radians
from hil.ship import scenarios
from hil.ship.scenarios import Scenario
from hil.sim.goals import parse_goals
from hil.sim.world import START_UTC_S, Mounting, World

CALM = scenarios.find_scenario("calm")


def with_rudder(world: World, shaft_deg: float) -> World:
    world.shaft.set_torque(on=True)
    world.shaft.set_target(radians(shaft_deg))
    return world


def test_positive_rudder_turns_the_boat_to_starboard():
    world = with_rudder(World(CALM, 1), 20.0)
    world.advance_to(60.0)
    row = world.truth[-1]
    assert row[0] == 60.0
    assert degrees(row[3]) == pytest.approx(0.9752, abs=1e-3)
    assert 0.8 < row[1] < 1.1
    assert row[7] > 0.0
    assert row[8] > 0.0
    assert world.latitude_deg() > 36.0
    assert world.longitude_deg() > 121.0
    assert world.utc_s() == START_UTC_S + 60.0


def test_full_circle_has_the_radius_of_the_paper():
    world = with_rudder(World(CALM, 1), 30.0)
    world.advance_to(400.0)
    rows = [row for row in world.truth if row[0] > 100.0]
    east = [row[8] for row in rows]
    assert (max(east) - min(east)) / 2.0 == pytest.approx(15.76, abs=0.02)


def test_servo_slew_and_command_are_separate_columns():
    world = with_rudder(World(CALM, 1), 30.0)
    world.advance_to(0.5)
    row = world.truth[-1]
    assert degrees(row[4]) == pytest.approx(15.0, abs=1e-9)
    assert degrees(row[5]) == pytest.approx(30.0, abs=1e-9)


def test_current_changes_track_course_and_speed_over_ground():
    drifting = Scenario("drift", "", 0.4, 0.0, 0.0, 0.0, 0.0, current_m_s=0.3, current_toward_deg=90.0)
    world = World(drifting, 1)
    world.advance_to(10.0)
    assert world.truth[-1][7:] == pytest.approx((4.0, 3.0, 0.4))
    assert world.speed_over_ground_m_s() == pytest.approx(0.5)
    assert world.course_over_ground_rad() == pytest.approx(math.atan2(0.3, 0.4))


def test_truth_has_a_row_each_tenth_of_a_second_until_the_end():
    world = World(CALM, 1, end_s=3.05)
    world.advance_to(100.0)
    assert [row[0] for row in world.truth] == [k / 10 for k in range(31)]


def test_goal_is_recorded_when_due_within_half_a_turn():
    world = with_rudder(World(CALM, 1, parse_goals("1:0,400:10,401:-170")), 30.0)
    world.advance_to(402.0)
    by_time = {row[0]: row for row in world.truth}
    assert by_time[0.9][6] is None
    assert by_time[1.0][6] == 0.0
    row = by_time[400.0]
    assert row[1] > 2.0 * math.pi
    assert abs(row[6] - row[1]) <= math.pi
    assert degrees(row[6]) % 360.0 == pytest.approx(10.0)


def test_wave_yaw_is_in_the_compass_heading_only():
    world = World(scenarios.find_scenario("swell"), 1)
    world.advance_to(100.0)
    assert any(abs(row[2] - row[1]) > radians(10.0) for row in world.truth)
    steps = [abs(b[1] - a[1]) for a, b in zip(world.truth, world.truth[1:], strict=False)]
    assert max(steps) < radians(0.2)


def test_mounting_affects_devices_only():
    mounting = Mounting(rudder_centre_rad=radians(5.0), rudder_reversed=True, compass_offset_rad=radians(7.0))
    world = World(CALM, 1, mounting=mounting)
    assert world.rudder_rad() == 0.0
    assert degrees(world.heading_rad()) == pytest.approx(-7.0)
    with_rudder(world, -5.0)
    world.advance_to(5.0)
    assert degrees(world.rudder_rad()) == pytest.approx(10.0)
    assert degrees(world.truth[-1][4]) == pytest.approx(10.0)
    assert world.truth[-1][1] > 0.0


def test_time_does_not_decrease():
    world = World(CALM, 1)
    world.advance_to(5.0)
    world.advance_to(1.0)
    world.advance_to(math.nan)
    assert world.now_s == 5.0


def test_truth_of_two_bodies_has_an_additional_column():
    world = with_rudder(World(scenarios.parse_scenario("calm+float=0.3:0.6"), 1), 20.0)
    world.advance_to(20.0)
    row = world.truth[-1]
    assert len(row) == 11
    assert row[2] == row[10]
    assert abs(row[1] - row[10]) > 0.01
    assert world.heading_rad() == row[10]
    assert len(World(CALM, 1).truth[-1]) == 10


def test_compass_errors_are_not_in_the_truth():
    world = World(scenarios.parse_scenario("calm+compass=2:0:3:0:0:0:0"), 1)
    world.advance_to(5.0)
    assert degrees(world.heading_rad()) == pytest.approx(-5.0)
    assert world.truth[-1][2] == 0.0


def test_utc_starts_at_the_given_time():
    world = World(CALM, 1, start_utc_s=1_900_000_000.0)
    world.advance_to(5.0)
    assert world.utc_s() == 1_900_000_005.0
    assert World(CALM, 1).utc_s() == START_UTC_S
