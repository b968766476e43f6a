"""The devices on the board, chosen by the vehicle file and by chance."""

import math

import pytest

from hil.errors import UsageError
from hil.ship import scenarios
from hil.sim.device_factory import emulators
from hil.sim.vehicle_file import COMPASS_DRIVERS, SERVO_DRIVERS, VehicleFile
from hil.sim.world import World


def said(vehicle: VehicleFile, seed: int, seconds: float = 3.0) -> dict[str, bytes]:
    world = World(scenarios.named("tank"), seed)
    devices = emulators(world, vehicle, seed)
    found = dict.fromkeys(devices, b"")
    while (due_s := min(device.next_output_s() for device in devices.values())) < seconds:
        world.advance_to(due_s)
        for name, device in devices.items():
            found[name] += device.take_output(due_s)
    return found


def test_the_standard_boat_speaks_ten_headings_and_one_position_a_second():
    found = said(VehicleFile(), 1)
    assert 29 <= found["compass"].count(b"$HCHDT") <= 31
    assert 2 <= found["position"].count(b"$GPRMC") <= 3


@pytest.mark.parametrize("compass", COMPASS_DRIVERS)
@pytest.mark.parametrize("servo", SERVO_DRIVERS)
def test_every_compass_goes_with_every_servo(compass, servo):
    vehicle = VehicleFile()
    vehicle.choose(compass, servo)
    assert set(emulators(World(scenarios.named("calm"), 1), vehicle, 1)) == {"compass", "position", "rudder"}


def test_the_seed_decides_everything():
    assert said(VehicleFile(), 1) == said(VehicleFile(), 1)
    assert said(VehicleFile(), 1) != said(VehicleFile(), 2)


def test_the_sentence_and_rate_of_the_vehicle_file():
    vehicle = VehicleFile()
    vehicle.compass |= {"sentences": ["HDG"], "rate_hz": 5.0}
    vehicle.parameters = {"CMP_DECL_DEG": 10.0}
    spoken = said(vehicle, 1)["compass"]
    assert 14 <= spoken.count(b"$HCHDG") <= 16
    raw_deg = float(spoken.split(b",")[1])
    assert math.remainder(raw_deg - 350.0, 360.0) == pytest.approx(0.0, abs=6.0)


@pytest.mark.parametrize("wrong", [{"baud": 12345}, {"baud": "fast"}, {"id": 999}])
def test_a_device_that_cannot_be_is_told(wrong):
    vehicle = VehicleFile()
    vehicle.rudder |= wrong
    with pytest.raises(UsageError, match="cannot be emulated"):
        emulators(World(scenarios.named("calm"), 1), vehicle, 1)
