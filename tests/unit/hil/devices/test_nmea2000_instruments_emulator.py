"""Wind sensor, echo sounder and rudder angle sensor on an emulated bus, against the bytes of the messages."""

import math
import tomllib

import msgspec
import pytest

from firmware_py.vehicle import read_device
from hil.devices import nmea2000, nmea2000_instruments
from hil.devices.emulator import DeviceContext
from hil.errors import UsageError
from hil.ship import scenarios
from hil.ship.noise import Stream, generator
from hil.sim.device_factory import make_emulators
from hil.sim.vehicle_file import file_text, standard_vehicle
from hil.sim.world import World


def messages(device, seconds):
    """Return PGN, source and data of the messages until a time."""
    data = b""
    while (now_s := device.next_output_s()) <= seconds:
        data += device.take_output(now_s)
    bodies = [frame[2:].replace(b"\x10\x10", b"\x10") for frame in data.split(b"\x10\x03")[:-1]]
    return [(int.from_bytes(body[3:6], "little"), body[7], body[13:-1]) for body in bodies]


def entry(section, **options):
    return read_device(section, {"driver": "nmea2000", "port": "/dev/x", "baud": 115200, **options}, "")


class Sea:
    """Wind from the north-east, 5 m/s, over a boat that lies still and heads east; 12 m of water; rudder at 10 deg."""

    turbulence = 0.0

    def bow_rad(self):
        return math.pi / 2.0

    def velocity_m_s(self):
        return 0.0, 0.0

    def air_velocity_m_s(self):
        return -3.0, -4.0

    def water_depth_m(self):
        return 12.0

    def rudder_rad(self):
        return math.radians(10.0)


def sent(make, section, seconds=2.0, world=None, **options):
    """Return the messages of an instrument whose vehicle file has these options."""
    context = DeviceContext(
        world or Sea(), 115200, entry(section, **options).options, generator(1, Stream.WIND), 0.05, 0.0, 0.0,
        generator(1, Stream.GAPS),
    )  # fmt: skip
    return messages(make(context), seconds)


def test_wind_is_apparent_and_twice_a_second():
    for offset_deg, expected_deg in ((0.0, 323.1), (20.0, 303.1)):
        found = sent(nmea2000_instruments.make_wind, "wind", offset_deg=offset_deg)
        assert [row[:2] for row in found] == [(130306, 0x40)] * 4
        data = found[0][2]
        assert int.from_bytes(data[1:3], "little") == 500
        angle_deg = math.degrees(int.from_bytes(data[3:5], "little") * 1e-4)
        assert (angle_deg, data[5] & 7) == (pytest.approx(expected_deg, abs=0.1), 2)


def test_depth_is_that_below_the_transducer_and_missing_out_of_range():
    found = sent(nmea2000_instruments.make_depth, "depth", transducer_depth_m=2.0, source=0x55)
    assert [row[:2] for row in found] == [(128267, 0x55)] * 2
    assert int.from_bytes(found[0][2][1:5], "little") * 0.01 == pytest.approx(10.0, abs=0.5)
    deep = Sea()
    deep.water_depth_m = lambda: 500.0
    assert sent(nmea2000_instruments.make_depth, "depth", world=deep)[0][2][1:5] == b"\xff" * 4


def test_rudder_angle_is_the_reading_of_the_instance():
    found = sent(nmea2000_instruments.make_rudder_angle, "rudder_angle", offset_deg=4.0, scale=-2.0, instance=1)
    assert (len(found), found[0][:2]) == (20, (127245, 0x42))
    readings = [math.degrees(int.from_bytes(row[2][4:6], "little", signed=True) * 1e-4) for row in found]
    assert (sum(readings) / 20, found[0][2][0]) == (pytest.approx(-1.0, abs=0.2), 1)
    assert sent(nmea2000_instruments.make_rudder_angle, "rudder_angle")[0][2][0] == 0


def bus_boat(**compass_options):
    sections = {name: entry(name) for name in ("wind", "depth", "rudder_angle")}
    return msgspec.structs.replace(
        standard_vehicle(), compass=entry("compass", **compass_options), compass_b=entry("compass_b", source=0x24),
        **sections,
    )  # fmt: skip


def test_boat_with_all_sections_on_a_bus_is_emulated_and_written():
    devices = make_emulators(World(scenarios.find_scenario("calm"), 1), bus_boat(), 1)
    sections = tomllib.loads(file_text(bus_boat(), {name: f"/run/{name}" for name in devices}, {}))
    for name in ("compass", "compass_b", "wind", "depth", "rudder_angle"):
        assert (sections[name]["driver"], sections[name]["port"]) == ("nmea2000", f"/run/{name}")


@pytest.mark.parametrize("source", [0x24, 0x10, 0x55])
def test_compass_has_the_address_of_the_vehicle_file_for_itself(source):
    devices = make_emulators(World(scenarios.find_scenario("calm"), 1), bus_boat(source=source), 1)
    devices["compass"].receive(0.0, nmea2000.START_COMMAND)
    found = messages(devices["compass"], 1.0)
    assert {row[1] for row in found if row[0] == 127250} == {source}
    assert sum(row[:2] == (60928, source) for row in found) == 1


def test_gateway_that_is_not_emulated_is_an_error():
    with pytest.raises(UsageError, match="gateway yd_raw: only actisense is emulated; use auto"):
        make_emulators(World(scenarios.find_scenario("calm"), 1), bus_boat(gateway="yd_raw"), 1)
    with pytest.raises(ValueError, match="only actisense"):
        sent(nmea2000_instruments.make_wind, "wind", gateway="yd_raw")
