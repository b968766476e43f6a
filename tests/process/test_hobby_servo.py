"""Hobby servos and the rudder angle sensor with the real program: cables, power, foreign bytes, estimate and sensor."""

import itertools
import math

import pytest

from firmware_py.__main__ import main

CHANGE_HEADING, HEADING_TYPE = 43002, 1.0
GUIDED = 15


@pytest.fixture
def start(make_boat):
    """Function that starts a boat and runs until it steers."""

    def start(servo, **options):
        boat = make_boat(servo=servo, **options).start()
        boat.get_under_way(GUIDED)
        boat.run(3.0)
        return boat

    return start


def steer(boat, heading_deg):
    boat.send_command(CHANGE_HEADING, HEADING_TYPE, heading_deg)


def moves(boat, heading_deg):
    """Return whether the rudder moves toward a new heading."""
    steer(boat, heading_deg)
    boat.run(2.0)
    return abs(boat.rudder_deg()) > 8.0


def finish(boat):
    logs = boat.finish()
    assert abs(boat.rudder_deg()) < 1.0
    assert all(main(["replay", str(log)]) == 0 for log in logs)


@pytest.mark.parametrize("servo", ["maestro", "pwm"])
def test_servo_steers_again_after_cable_and_power_losses(start, servo):
    boat = start(servo)
    assert "Rudder angle: estimated" in boat.output_text()
    boat.lines["rudder"].unplug()
    boat.run_until_text("Rudder servo not responding", 3.0)
    boat.lines["rudder"].plug()
    boat.run_until_text("Rudder servo responding again", 5.0)
    assert moves(boat, 60.0)
    begin_s = boat.now_s
    boat.servo.power_cycle(boat.now_s, off_s=1.5)
    if servo == "maestro":
        boat.run_until_text("Rudder servo not responding", 3.0, begin_s)
        boat.run_until_text("Rudder servo responding again", 5.0, begin_s)
        boat.run_until_text("Rudder servo lost power: configured again", 1.0, begin_s)
    assert moves(boat, 300.0)
    finish(boat)


def test_foreign_bytes_cause_no_jam_and_another_baud_rate_is_reported(start):
    boat = start("maestro")
    boat.servo_line.garbage, boat.servo_line.flip = 0.2, 0.002
    boat.run(5.0)
    boat.servo_line.garbage = boat.servo_line.flip = 0.0
    assert moves(boat, 60.0)
    begin_s = boat.now_s
    boat.servo_line.flip = 0.9  # what another baud rate makes of the bytes
    boat.run_until_text("Rudder servo not responding", 4.0, begin_s)
    boat.servo_line.flip = 0.0
    boat.run_until_text("Rudder servo responding again", 4.0, begin_s)
    assert "Rudder jammed" not in boat.output_text()
    finish(boat)


def test_jam_is_reported_with_the_sensor_and_the_estimate_replaces_a_lost_sensor(start):
    boat = start("maestro", rudder_angle=True)
    assert "Rudder angle: estimated" not in boat.output_text()
    boat.world.jam(math.radians(-15.0))
    boat.run_until_text("Rudder jammed", 10.0)
    boat.world.free()
    boat.run_until_text("Rudder no longer jammed", 14.0)
    boat.lines["rudder_angle"].unplug()
    boat.run_until_text("Rudder angle: estimated", 2.0)
    boat.world.jam(math.radians(-15.0))
    begin_s = boat.now_s
    boat.run(10.0)
    assert not [text for text in boat.texts_since(begin_s) if text.startswith("Rudder jammed")]
    boat.world.free()
    boat.lines["rudder_angle"].plug()
    boat.run_until_text("Rudder angle: measured", 3.0)
    finish(boat)


@pytest.mark.proof
@pytest.mark.parametrize("scenario", ["tank", "sea"])
@pytest.mark.parametrize("angle_deg", [None, -20.0], ids=["blade lost", "jammed"])
def test_lost_and_jammed_rudder_are_reported_by_the_turns_of_the_boat(start, scenario, angle_deg):
    """Turns of 40 degrees every minute, with a rudder whose angle is not measured."""
    boat = start("maestro", scenario=scenario)
    headings = itertools.cycle((40.0, 0.0))
    for _ in range(5):
        steer(boat, next(headings))
        boat.run(60.0)
    steer(boat, next(headings))
    boat.run(2.0)
    begin_s = boat.now_s
    if angle_deg is None:
        boat.world.rudder_effect = 0.0
    else:
        boat.world.jam(math.radians(angle_deg))
    while not any(text.startswith(("Steering lost", "Steering reversed")) for text in boat.texts_since(begin_s)):
        assert boat.now_s < begin_s + 600.0, boat.output_text()
        boat.run(60.0)
        steer(boat, next(headings))
    assert not [text for text in boat.texts_since(begin_s) if text.startswith("Rudder jammed")]
