"""Emulated devices for a vehicle file and a seed."""

import dataclasses
import math

import pytest
from msgspec.structs import replace

from firmware_py.devices import SECTIONS
from firmware_py.vehicle import Vehicle
from hil.errors import UsageError
from hil.ship import scenarios
from hil.sim.device_factory import COMPASSES, SERVOS, make_emulators
from hil.sim.vehicle_file import standard_vehicle, with_devices
from hil.sim.world import World

CALM_WORLD = World(scenarios.find_scenario("calm"), 1)


def outputs_of(vehicle: Vehicle, seed: int, seconds: float = 3.0) -> dict[str, bytes]:
    world = World(scenarios.find_scenario("tank"), seed)
    devices = make_emulators(world, vehicle, seed)
    outputs = dict.fromkeys(devices, b"")
    while (due_s := min(device.next_output_s() for device in devices.values())) < seconds:
        world.advance_to(due_s)
        for name, device in devices.items():
            outputs[name] += device.take_output(due_s)
    return outputs


def test_default_boat_has_the_output_rates():
    outputs = outputs_of(standard_vehicle(), 1)
    assert 29 <= outputs["compass"].count(b"$HCHDT") <= 31
    assert 2 <= outputs["position"].count(b"$GPRMC") <= 3


@pytest.mark.parametrize("compass", COMPASSES)
@pytest.mark.parametrize("servo", SERVOS)
def test_devices_of_every_compass_and_servo_are_created(compass, servo):
    vehicle = with_devices(standard_vehicle(), compass, servo)
    second = {"compass_b"} if compass == "bno08x_rvc" else set()
    assert set(make_emulators(CALM_WORLD, vehicle, 1)) == {"compass", "position", "rudder"} | second


def test_second_compass_is_emulated_and_does_not_change_the_other_devices():
    vehicle = with_devices(standard_vehicle(), "bno08x_rvc", None)
    outputs, outputs_without = outputs_of(vehicle, 1), outputs_of(standard_vehicle(), 1)
    frames = outputs.pop("compass_b")
    assert 290 <= len(frames) / 19 <= 301
    assert frames.startswith(b"\xaa\xaa\x00")
    assert outputs == outputs_without


@pytest.mark.parametrize("compass", ["nmea", "mti"])
def test_seed_determines_all_output(compass):
    vehicle = with_devices(standard_vehicle(), compass, None)
    outputs = [outputs_of(vehicle, seed) for seed in (1, 1, 2)]
    assert outputs[0] == outputs[1]
    assert all(outputs[0][name] != outputs[2][name] for name in ("compass", "position"))


def test_compass_sends_the_sentence_of_the_vehicle_file():
    boat = standard_vehicle()
    compass = replace(boat.compass, options=dataclasses.replace(boat.compass.options, sentences=("HDG",)))
    vehicle = replace(boat, compass=compass, parameters={"CMP_DECL_DEG": 10.0})
    sentences = outputs_of(vehicle, 1)["compass"]
    assert 29 <= sentences.count(b"$HCHDG") <= 31
    raw_deg = float(sentences.split(b",")[1])
    assert math.remainder(raw_deg - 350.0, 360.0) == pytest.approx(0.0, abs=6.0)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"baud": 12345}, "cannot be emulated"),
        ({"driver": "new"}, "driver 'new' has no emulated device; use one of dynamixel, volz"),
    ],
)
def test_device_that_cannot_be_emulated_raises_an_error(changes, error):
    boat = standard_vehicle()
    with pytest.raises(UsageError, match=error):
        make_emulators(CALM_WORLD, replace(boat, rudder=replace(boat.rudder, **changes)), 1)


def test_every_driver_has_an_emulated_device():
    assert {device.driver for device in COMPASSES.values()} == set(SECTIONS["compass"])
    assert {device.driver for device in SERVOS.values()} == set(SECTIONS["rudder"])
