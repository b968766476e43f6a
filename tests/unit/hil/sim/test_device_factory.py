"""Emulated devices for a vehicle file and a seed."""

import dataclasses
import math
import tomllib

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as dialect

from firmware_py.devices import SECTIONS
from firmware_py.sensors.mavlink_frames import Encoder, Message
from firmware_py.vehicle import Vehicle, read_device
from hil.errors import UsageError
from hil.ship import scenarios
from hil.sim.adapters import open_adapters
from hil.sim.board import Board
from hil.sim.device_factory import COMPASSES, SERVOS, make_emulators
from hil.sim.vehicle_file import file_text, standard_vehicle, with_devices
from hil.sim.world import World

CALM_WORLD = World(scenarios.find_scenario("calm"), 1)


def outputs_of(vehicle: Vehicle, seed: int, seconds: float = 3.0) -> dict[str, bytes]:
    world = World(scenarios.find_scenario("tank"), seed)
    return outputs_in(make_emulators(world, vehicle, seed), seconds, world)


def outputs_in(devices, seconds, world=None):
    outputs = dict.fromkeys(devices, b"")
    while (due_s := min(device.next_output_s() for device in devices.values())) < seconds:
        if world is not None:
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
    position = set() if compass == "mavlink" else {"position"}
    assert set(make_emulators(CALM_WORLD, vehicle, 1)) == {"compass", "rudder"} | position | second


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


def test_board_serves_position_and_power_on_the_port_of_the_compass():
    vehicle = with_devices(standard_vehicle(), "mavlink", None)
    ports = {name: f"/run/{name}" for name in make_emulators(CALM_WORLD, vehicle, 1)}
    sections = tomllib.loads(file_text(vehicle, ports, {}))
    for name in ("compass", "position", "power"):
        assert sections[name] == {"driver": "mavlink", "port": "/run/compass", "baud": 115_200}
    assert "power_b" not in sections


def test_board_is_the_battery_monitor_beside_a_charger():
    sea = scenarios.with_disturbances(scenarios.find_scenario("calm"), "supply=60:0.4:500:4:0.8")
    vehicle = with_devices(standard_vehicle(), "mavlink", None)
    devices = make_emulators(World(sea, 1), vehicle, 1)
    assert set(devices) == {"compass", "rudder", "power_b"}
    assert devices["compass"].battery is devices["power_b"].plant
    assert b"IL" not in outputs_in(devices, 2.0)["power_b"]


def test_board_has_the_system_id_of_the_vehicle_file_and_the_gaps_of_the_receiver():
    sea = scenarios.with_disturbances(scenarios.find_scenario("calm"), "receiver=0.5:1")
    boat = with_devices(standard_vehicle(), "mavlink", None)
    vehicle = replace(boat, compass=replace(boat.compass, options=dataclasses.replace(boat.compass.options, system=7)))
    board = make_emulators(World(sea, 1), vehicle, 1)["compass"]
    board.receive(1.5, Encoder(192).message_interval(7, 1, Message.GPS_RAW_INT, 10))
    frames = dialect.MAVLink(None).parse_buffer(outputs_in({"compass": board}, 3.0)["compass"])
    assert {frame.get_srcSystem() for frame in frames} == {7}
    assert {frame.fix_type for frame in frames if frame.get_type() == "GPS_RAW_INT"} == {1}


def test_adapter_of_a_device_on_the_port_of_another_is_refused():
    vehicle = with_devices(standard_vehicle(), "mavlink", None)
    devices = make_emulators(CALM_WORLD, vehicle, 1)
    with (
        pytest.raises(UsageError, match="--position-port /dev/x: the position is on the port of the compass"),
        open_adapters({"position": "/dev/x"}, devices, vehicle),
    ):
        pass


@pytest.mark.parametrize(
    ("sentences", "wind", "depth"),
    [((), b"$WIMWV,", b"$SDDPT,"), (("MWD", "DBK"), b"$WIMWD,", b"$SDDBK,"), (("VWT", "DBS"), b"$WIVWT,", b"$SDDBS,")],
)
def test_wind_sensor_and_echo_sounder_send_the_sentences_of_the_vehicle_file(sentences, wind, depth):
    names = dict(zip(("wind", "depth"), ((one,) if one else () for one in (*sentences, "", "")), strict=False))
    values = {"driver": "nmea", "port": "/dev/x", "baud": 4800}
    entries = {
        name: read_device(name, values | ({"sentences": list(chosen)} if chosen else {}), name)
        for name, chosen in names.items()
    }
    outputs = outputs_of(replace(standard_vehicle(), **entries), 1)
    assert 2 <= outputs["wind"].count(wind) <= 3
    assert 2 <= outputs["depth"].count(depth) <= 3


def test_disturbances_wind_and_depth_add_their_sensors():
    scenario = scenarios.parse_scenario("calm+wind=12:90:0,depth=30:0.5")
    world = World(scenario, 1)
    assert set(make_emulators(world, standard_vehicle(), 1)) - {"compass", "position", "rudder"} == {"wind", "depth"}
    assert world.air_velocity_m_s() == pytest.approx((0.0, -12.0))
    assert world.water_depth_m() == pytest.approx(30.0)
    world.advance_to(100.0)
    north_m = (world.latitude_deg() - 36.0) * 111_194.93
    assert north_m > 20.0  # it starts to the north
    assert world.water_depth_m() == pytest.approx(30.0 - 0.5 * north_m, abs=0.1)
    only_depth = World(scenarios.parse_scenario("calm+depth"), 1)
    assert "wind" not in make_emulators(only_depth, standard_vehicle(), 1)
    assert only_depth.water_depth_m() == 50.0


def test_every_driver_has_an_emulated_device():
    assert {device.driver for device in COMPASSES.values()} == set(SECTIONS["compass"])
    assert {device.driver for device in SERVOS.values()} == set(SECTIONS["rudder"])


def with_rudder_angle(vehicle, **options):
    values = {"driver": "nmea", "port": "/dev/x", "baud": 4800, **options}
    return replace(vehicle, rudder_angle=read_device("rudder_angle", values, "[rudder_angle]"))


def test_rudder_angle_sensor_is_emulated_and_does_not_change_the_other_devices():
    vehicle = with_rudder_angle(standard_vehicle(), offset_deg=20.0, scale=2.0)
    outputs, outputs_without = outputs_of(vehicle, 1), outputs_of(standard_vehicle(), 1)
    sentences = outputs.pop("rudder_angle").splitlines()
    assert 28 <= len(sentences) <= 31
    assert all(float(sentence.split(b",")[1]) == pytest.approx(20.0, abs=1.5) for sentence in sentences)
    assert outputs == outputs_without
    ports = dict.fromkeys(("compass", "position", "rudder", "rudder_angle", "link"), "/dev/y")
    section = tomllib.loads(file_text(vehicle, ports, {}))["rudder_angle"]
    assert section == {"driver": "nmea", "port": "/dev/y", "baud": 4800, "offset_deg": 20.0, "scale": 2.0}


@pytest.mark.parametrize("servo", ["maestro", "pwm"])
def test_hobby_servo_has_the_scale_of_the_vehicle_file(servo):
    boat = with_devices(standard_vehicle(), None, servo)
    options = dataclasses.replace(boat.rudder.options, minus_us=1900.0, plus_us=1200.0, end_deg=40.0)
    world = World(scenarios.find_scenario("calm"), 1)
    device = make_emulators(world, replace(boat, rudder=replace(boat.rudder, options=options)), 1)["rudder"]
    for pulse_us, angle_deg in ((1900.0, -40.0), (1350.0, 20.0)):
        quarters = round(4 * pulse_us)
        data = bytes([0x84, 0, quarters & 0x7F, quarters >> 7]) if servo == "maestro" else b"%d\n" % (1e3 * pulse_us)
        device.receive(world.now_s, data)
        assert math.degrees(world.shaft.target_rad) == pytest.approx(angle_deg)


def test_pwm_output_has_a_chip_on_the_board_and_no_adapter(tmp_path):
    vehicle = with_devices(standard_vehicle(), None, "pwm")
    devices = make_emulators(CALM_WORLD, vehicle, 1)
    with Board(CALM_WORLD, devices, tmp_path) as board:
        paths = board.paths()
        assert paths["rudder"] == f"pwm:{tmp_path}/rudder/0"
        assert board.port_at(paths["rudder"]).path == tmp_path / "rudder"
        assert (tmp_path / "rudder" / "pwm0" / "duty_cycle").is_fifo()
    assert not (tmp_path / "rudder").exists()
    with (
        pytest.raises(UsageError, match="--servo-port: a servo on a PWM output has no serial line"),
        open_adapters({"rudder": "/dev/x"}, devices, vehicle),
    ):
        pass
