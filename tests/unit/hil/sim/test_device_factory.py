"""The emulated devices on the board, from the vehicle file and the seed."""

import dataclasses
import math

import pytest
from msgspec.structs import replace

from firmware_py.devices import SECTIONS
from firmware_py.vehicle import Vehicle
from hil.errors import UsageError
from hil.ship import scenarios
from hil.sim.device_factory import COMPASSES, SERVOS, emulators
from hil.sim.vehicle_file import standard_vehicle, with_devices
from hil.sim.world import World


def outputs_of(vehicle: Vehicle, seed: int, seconds: float = 3.0) -> dict[str, bytes]:
    world = World(scenarios.find_scenario("tank"), seed)
    devices = emulators(world, vehicle, seed)
    found = dict.fromkeys(devices, b"")
    while (due_s := min(device.next_output_s() for device in devices.values())) < seconds:
        world.advance_to(due_s)
        for name, device in devices.items():
            found[name] += device.take_output(due_s)
    return found


def test_output_rates_of_the_default_boat():
    found = outputs_of(standard_vehicle(), 1)
    assert 29 <= found["compass"].count(b"$HCHDT") <= 31
    assert 2 <= found["position"].count(b"$GPRMC") <= 3


@pytest.mark.parametrize("compass", COMPASSES)
@pytest.mark.parametrize("servo", SERVOS)
def test_all_combinations_of_compass_and_servo(compass, servo):
    vehicle = with_devices(standard_vehicle(), compass, servo)
    assert set(emulators(World(scenarios.find_scenario("calm"), 1), vehicle, 1)) == {"compass", "position", "rudder"}


def test_the_seed_determines_all_output():
    assert outputs_of(standard_vehicle(), 1) == outputs_of(standard_vehicle(), 1)
    assert outputs_of(standard_vehicle(), 1) != outputs_of(standard_vehicle(), 2)


def test_the_sentence_of_the_vehicle_file():
    boat = standard_vehicle()
    compass = replace(boat.compass, options=dataclasses.replace(boat.compass.options, sentences=("HDG",)))
    vehicle = replace(boat, compass=compass, parameters={"CMP_DECL_DEG": 10.0})
    sentences = outputs_of(vehicle, 1)["compass"]
    assert 29 <= sentences.count(b"$HCHDG") <= 31
    raw_deg = float(sentences.split(b",")[1])
    assert math.remainder(raw_deg - 350.0, 360.0) == pytest.approx(0.0, abs=6.0)


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"baud": 12345}, "cannot be emulated"),
        ({"driver": "new"}, "driver 'new' has no emulated device; use one of dynamixel, volz"),
    ],
)
def test_a_device_that_cannot_be_emulated_is_an_error(wrong, complaint):
    boat = standard_vehicle()
    with pytest.raises(UsageError, match=complaint):
        emulators(World(scenarios.find_scenario("calm"), 1), replace(boat, rudder=replace(boat.rudder, **wrong)), 1)


def test_every_driver_has_an_emulated_device():
    assert {device.driver for device in COMPASSES.values()} == set(SECTIONS["compass"])
    assert {device.driver for device in SERVOS.values()} == set(SECTIONS["rudder"])
