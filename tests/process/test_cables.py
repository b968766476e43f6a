"""Cables are unplugged and power is cut while the autopilot runs in real time, without a restart."""

import functools
import math
import operator

import pytest

from firmware_py.__main__ import main
from firmware_py.log.reader import read_log

OPERATING_MODE = 33  # register of the Feetech servo; 0: position
SETTINGS = {"BOOT_ARM": 1, "BOOT_MODE": 15, "CTL_HOLD_S": 1, "EST_MODE": 0, "CTL_MODE": 0}


@pytest.fixture
def make_moored_boat(make_boat):
    """Return a function that makes a boat in real time without a ground station; its goal is its heading."""
    return lambda compass, servo: make_boat(
        scenario="calm", compass=compass, servo=servo, speed=None, settings=SETTINGS, without=("position", "link")
    )


@pytest.fixture(
    params=[
        pytest.param(("nmea", "dynamixel"), id="nmea-dynamixel"),
        pytest.param(("pni", "volz"), id="pni-volz", marks=pytest.mark.proof),
    ]
)
def bench(make_moored_boat, request):
    boat = make_moored_boat(*request.param).start()
    boat.run_until_written("Mode GUIDED")
    boat.run(1.5)
    yield boat
    assert replays(boat)


def replays(bench):
    """Return whether the logs of the run replay bit for bit."""
    logs = bench.finish()
    return bool(logs) and all(main(["replay", str(log)]) == 0 for log in logs)


def turn_boat(bench):
    """Turn the boat by 30 degrees, so that the rudder moves."""
    bench.world._hull._plant.heading_rad += math.radians(30.0)


def responds_to_heading(bench):
    """Return whether the rudder moves after a turn of the boat."""
    turn_boat(bench)
    initial_rad = bench.world.shaft.angle_rad()
    bench.run(1.5)
    return abs(bench.world.shaft.angle_rad() - initial_rad) > math.radians(5.0)


def test_unplugged_servo_and_compass_recover_and_the_end_centres_the_rudder(bench):
    bench.lines["rudder"].unplug()
    bench.run_until_written("Rudder servo not responding")
    bench.lines["rudder"].plug()
    bench.run_until_written("Rudder servo responding again")
    bench.run(1.0)
    assert responds_to_heading(bench)
    bench.lines["compass"].unplug()
    bench.run_until_written("No valid heading: rudder held, then centred")
    bench.run(2.5)
    assert abs(bench.world.shaft.angle_rad()) < math.radians(1.0)
    bench.lines["compass"].plug()
    bench.run_until_written("Heading recovered")
    bench.run(1.5)
    assert abs(bench.world.shaft.angle_rad()) > math.radians(5.0)  # the boat was turned off its goal
    assert bench.process.running()
    bench.process.terminate()
    bench.run(2.5)
    assert not bench.process.running()
    assert bench.process.exit_code() == 0
    assert abs(bench.world.shaft.angle_rad()) < math.radians(1.0)


@pytest.mark.parametrize("compass", ["mti", pytest.param("pni", marks=pytest.mark.proof)])
def test_compass_power_cut_and_restored(make_moored_boat, compass):
    bench = make_moored_boat(compass, "dynamixel").start()
    bench.run_until_written("Mode GUIDED")
    bench.run(1.5)
    bench.compass_device.power_cycle(bench.world.now_s, off_s=1.5)
    bench.run_until_written("No valid heading: rudder held, then centred")
    bench.run_until_written("Heading recovered")
    assert responds_to_heading(bench)


@pytest.mark.parametrize("compass", ["rion", "witmotion"])
def test_compass_recovers_from_cable_power_cut_wrong_baud_rate_and_foreign_bytes(make_boat, compass):
    """In simulated time, which is faster."""
    bench = make_boat(scenario="calm", compass=compass, settings=SETTINGS, without=("position", "link")).start()
    bench.run_until_written("Mode GUIDED")

    def cut_and_restore(cut, restore):
        cut()
        bench.run_until_written("No valid heading: rudder held, then centred")
        restore()
        bench.run_until_written("Heading recovered")

    cut_and_restore(bench.lines["compass"].unplug, bench.lines["compass"].plug)
    cut_and_restore(lambda: bench.compass_device.power_cycle(bench.world.now_s, off_s=3.0), lambda: None)
    # A wrong baud rate on a pty: most bytes differ, in both directions.
    cut_and_restore(lambda: setattr(bench.compass, "flip", 0.7), lambda: setattr(bench.compass, "flip", 0.0))
    for _ in range(10):
        bench.lines["compass"].write(b"$HEHDT,45.0,T*1E\r\n\xfa\xff\x36\x00\xca")
        bench.run(0.1)
    assert responds_to_heading(bench)
    assert replays(bench)
    headings_deg = [
        math.degrees(math.remainder(sample.heading_rad, math.tau))
        for path in bench.logs()
        for tick in read_log(path)
        for sample in tick.inputs.headings
    ]
    assert len(headings_deg) > 20
    assert all(-5.0 < heading_deg < 35.0 for heading_deg in headings_deg)


def test_noisy_line_loses_samples_only(bench):
    bench.compass.flip = 0.002
    bench.compass.garbage = 0.2
    bench.run(6.0)
    bench.compass.flip = bench.compass.garbage = 0.0
    assert bench.process.running()
    assert responds_to_heading(bench)
    bench.finish()
    headings_deg = [
        math.degrees(sample.heading_rad)
        for path in bench.logs()
        for tick in read_log(path)
        for sample in tick.inputs.headings
    ]
    assert len(headings_deg) > 30
    assert all(heading_deg < 40.0 or heading_deg > 350.0 for heading_deg in headings_deg)


def test_impossible_value_is_not_used(make_moored_boat):
    bodies = b"HEHDT,400.0,T", b"HEHDT,nan,T"
    sentences = [b"$%s*%02X\r\n" % (body, functools.reduce(operator.xor, body)) for body in bodies]
    bench = make_moored_boat("nmea", "volz").start()
    bench.run_until_written("Mode GUIDED")
    bench.run(1.0)
    for sentence in sentences:
        for _ in range(20):
            bench.lines["compass"].write(sentence)
            bench.run(0.1)
    assert abs(bench.world.shaft.angle_rad()) < math.radians(3.0)
    assert "heading" not in bench.output_text()
    assert replays(bench)
    (path,) = bench.logs()
    headings_rad = [sample.heading_rad for tick in read_log(path) for sample in tick.inputs.headings]
    assert len(headings_rad) > 10
    assert all(min(heading_rad, 2 * math.pi - heading_rad) < 0.1 for heading_rad in headings_rad)


def test_ports_that_appear_later_are_used_and_links_without_an_address_have_no_effect(make_moored_boat):
    """At sea no server resolves names, and the network of the boat may appear later or never."""
    bench = make_moored_boat("nmea", "volz")
    for line in bench.lines.values():
        line.unplug()
    bench.start("--wait", "--link", "udpin:192.0.2.1:14550", "--link", "nmea:udpout:plotter.invalid:10110")
    bench.run_until_written("Rudder servo not responding")
    for line in bench.lines.values():
        line.plug()
    bench.run_until_written("Rudder servo responding again")
    bench.run(1.5)
    assert responds_to_heading(bench)


def test_feetech_servo_is_used_again_after_cable_and_power_losses_and_foreign_bytes(make_moored_boat):
    bench = make_moored_boat("nmea", "feetech").start()
    bench.run_until_written("Mode GUIDED")
    line = bench.lines["rudder"]
    for _ in range(10):
        line.write(b"\xff\xff\x01\x21\x00\x01\xfe" + bytes(range(40)))
        bench.run(0.05)
    assert "Rudder servo not responding" not in bench.output_text()
    line.unplug()
    bench.run_until_written("Rudder servo not responding")
    line.plug()
    bench.run_until_written("Rudder servo responding again")
    bench.servo.stored[OPERATING_MODE] = 3  # another mode after the power loss
    bench.servo.power_cycle(bench.world.now_s, off_s=0.5)
    bench.run_until_written("Rudder servo lost power: configured again")
    bench.run(0.5)
    assert responds_to_heading(bench)
    assert (bench.servo.table[OPERATING_MODE], bench.servo.stored[OPERATING_MODE]) == (0, 3)
    assert replays(bench)
