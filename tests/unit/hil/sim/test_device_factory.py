"""The devices on the board, chosen by the vehicle file and by chance."""

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


def said(vehicle: Vehicle, seed: int, seconds: float = 3.0) -> dict[str, bytes]:
    world = World(scenarios.named("tank"), seed)
    devices = emulators(world, vehicle, seed)
    found = dict.fromkeys(devices, b"")
    while (due_s := min(device.next_output_s() for device in devices.values())) < seconds:
        world.advance_to(due_s)
        for name, device in devices.items():
            found[name] += device.take_output(due_s)
    return found


def test_the_standard_boat_speaks_ten_headings_and_one_position_a_second():
    found = said(standard_vehicle(), 1)
    assert 29 <= found["compass"].count(b"$HCHDT") <= 31
    assert 2 <= found["position"].count(b"$GPRMC") <= 3


@pytest.mark.parametrize("compass", COMPASSES)
@pytest.mark.parametrize("servo", SERVOS)
def test_every_compass_goes_with_every_servo(compass, servo):
    vehicle = with_devices(standard_vehicle(), compass, servo)
    assert set(emulators(World(scenarios.named("calm"), 1), vehicle, 1)) == {"compass", "position", "rudder"}


def test_the_seed_decides_everything():
    assert said(standard_vehicle(), 1) == said(standard_vehicle(), 1)
    assert said(standard_vehicle(), 1) != said(standard_vehicle(), 2)


def test_the_sentence_of_the_vehicle_file():
    boat = standard_vehicle()
    compass = replace(boat.compass, options=dataclasses.replace(boat.compass.options, sentences=("HDG",)))
    vehicle = replace(boat, compass=compass, parameters={"CMP_DECL_DEG": 10.0})
    spoken = said(vehicle, 1)["compass"]
    assert 29 <= spoken.count(b"$HCHDG") <= 31
    raw_deg = float(spoken.split(b",")[1])
    assert math.remainder(raw_deg - 350.0, 360.0) == pytest.approx(0.0, abs=6.0)


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [({"baud": 12345}, "cannot be emulated"), ({"driver": "new"}, "driver 'new'; there are dynamixel, volz")],
)
def test_a_device_that_cannot_be_is_told(wrong, complaint):
    boat = standard_vehicle()
    with pytest.raises(UsageError, match=complaint):
        emulators(World(scenarios.named("calm"), 1), replace(boat, rudder=replace(boat.rudder, **wrong)), 1)


def test_every_driver_of_a_compass_and_a_rudder_has_its_device():
    assert {device.driver for device in COMPASSES.values()} == set(SECTIONS["compass"])
    assert {device.driver for device in SERVOS.values()} == set(SECTIONS["rudder"])
