"""The vehicle file of a run."""

import tomllib

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.errors import UsageError
from hil.sim.vehicle_file import file_text, load, model_of, mounting_of, parse_settings, standard_vehicle, with_devices
from hil.sim.world import Mounting

PORTS = {"compass": '/tmp/a "b"/compass', "position": "/p", "rudder": "/r", "link": "/l"}
VEHICLE_TEXT = """
[vehicle]
name = "Test boat"
[compass]
driver = "pni_tcm"
port = "/dev/ttyUSB0"
baud = 9600
rate_hz = 5.0
[rudder]
driver = "volz"
port = "/dev/ttyUSB1"
baud = 115200
id = 7
[hull]
length_m = 3.05
[parameters]
file = "boat.param"
MDL_K = 0.1
RUD_CENTRE_DEG = 4
RUD_REVERSE = 1
"""
WITHOUT_PARAMETER_FILE = VEHICLE_TEXT.replace('file = "boat.param"', "")


def test_default_boat_has_the_tank_model():
    vehicle = standard_vehicle()
    assert model_of(vehicle) == OCEAN_RAMBLER
    assert mounting_of(vehicle) == Mounting()
    data = tomllib.loads(file_text(vehicle, PORTS, {"CTL_K1": 30.0}))
    assert data["compass"] == {"driver": "nmea", "port": PORTS["compass"], "baud": 38400}
    assert data["rudder"] == {"driver": "dynamixel", "port": "/r", "baud": 57600}
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600}
    assert data["link"] == {"urls": ["serial:/l:57600"]}
    assert data["parameters"] == {"CTL_K1": 30.0}


def test_file_keeps_all_values_but_the_ports(tmp_path):
    (tmp_path / "boat.vehicle").write_text(VEHICLE_TEXT)
    (tmp_path / "boat.param").write_text("MDL_K 0.2\nMDL_T_S 3\n")
    vehicle = load(tmp_path / "boat.vehicle")
    data = tomllib.loads(file_text(vehicle, PORTS, {"MDL_K": 0.5}))
    assert data["vehicle"]["name"] == "Test boat"
    assert data["compass"] == {"driver": "pni_tcm", "port": PORTS["compass"], "baud": 9600, "rate_hz": 5.0}
    assert data["rudder"] == {"driver": "volz", "port": "/r", "baud": 115200, "id": 7}
    assert data["hull"] == {"length_m": 3.05}
    assert data["parameters"]["MDL_K"] == 0.5
    assert data["parameters"]["MDL_T_S"] == 3.0
    # The settings do not change the ship model.
    assert model_of(vehicle).turning_ability_1_s == pytest.approx(0.1)
    assert model_of(vehicle).turning_lag_s == 3.0
    assert mounting_of(vehicle) == Mounting(radians(4.0), rudder_reversed=True)


def test_options_of_position_and_ais_are_kept_for_the_emulated_driver(tmp_path):
    sections = """
[position]
driver = "nmea"
port = "/dev/ttyUSB2"
baud = 4800
require_checksum = false
[ais]
driver = "nmea"
port = "/dev/ttyUSB3"
baud = 38400
own_mmsi = 235000099
"""
    (tmp_path / "boat.vehicle").write_text(WITHOUT_PARAMETER_FILE + sections)
    vehicle = load(tmp_path / "boat.vehicle")
    data = tomllib.loads(file_text(vehicle, {**PORTS, "ais": "/a"}, {}))
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600, "require_checksum": False}
    assert data["ais"] == {"driver": "nmea", "port": "/a", "baud": 38400, "own_mmsi": 235000099}
    (tmp_path / "boat.vehicle").write_text(
        WITHOUT_PARAMETER_FILE + '[position]\ndriver = "ubx"\nport = "/dev/x"\nbaud = 38400\n'
    )
    data = tomllib.loads(file_text(load(tmp_path / "boat.vehicle"), PORTS, {}))
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600}


def test_wind_and_depth_keep_their_options(tmp_path):
    sections = """
[wind]
driver = "nmea"
port = "udp:10110"
offset_deg = 5
[depth]
driver = "nmea"
port = "/dev/ttyUSB2"
baud = 9600
sentences = ["DBT"]
"""
    (tmp_path / "boat.vehicle").write_text(WITHOUT_PARAMETER_FILE + sections)
    data = tomllib.loads(file_text(load(tmp_path / "boat.vehicle"), {**PORTS, "wind": "/w", "depth": "/d"}, {}))
    assert data["wind"] == {"driver": "nmea", "port": "/w", "baud": 38400, "offset_deg": 5.0}
    assert data["depth"] == {"driver": "nmea", "port": "/d", "baud": 9600, "sentences": ["DBT"]}
    assert {"wind", "depth"}.isdisjoint(tomllib.loads(file_text(standard_vehicle(), PORTS, {})))


def test_another_device_replaces_its_section(tmp_path):
    (tmp_path / "boat.vehicle").write_text(WITHOUT_PARAMETER_FILE)
    vehicle = load(tmp_path / "boat.vehicle")
    changed = with_devices(vehicle, "pni", "dynamixel")
    assert changed.compass == vehicle.compass
    assert (changed.rudder.driver, changed.rudder.baud, changed.rudder.options.id) == ("dynamixel", 57600, 1)
    assert with_devices(vehicle, None, None) == vehicle


def test_gyroscope_without_north_becomes_the_second_compass(tmp_path):
    (tmp_path / "boat.vehicle").write_text(WITHOUT_PARAMETER_FILE)
    vehicle = load(tmp_path / "boat.vehicle")
    changed = with_devices(vehicle, "bno08x_rvc", None)
    assert changed.compass == vehicle.compass
    assert (changed.compass_b.driver, changed.compass_b.baud) == ("bno08x_rvc", 115200)
    assert "[compass_b]" not in file_text(changed, PORTS, {})  # without an emulated device
    path = tmp_path / "written.toml"
    path.write_text(file_text(changed, PORTS | {"compass_b": "/b"}, {}))
    written = load(path).compass_b
    assert (written.driver, written.port, written.baud) == ("bno08x_rvc", "/b", 115200)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[compass", "not valid TOML"),
        ("compass = 3", "must be a section"),
        ("[compass]\ndriver = 'astrolabe'\n", "nmea, pni_tcm"),
        (VEHICLE_TEXT.replace("id = 7", "id = 7\nrate_hz = 5"), "'rate_hz' is not read by driver volz, which has id"),
        (VEHICLE_TEXT, "boat.param cannot be read"),
        (VEHICLE_TEXT.replace('file = "boat.param"', "CTL_K9 = 3"), "unknown parameter"),
        (VEHICLE_TEXT.replace('file = "boat.param"', "CTL_K1 = 'x'"), "expected a number"),
        (VEHICLE_TEXT.replace('file = "boat.param"', "CTL_K1 = nan"), "not a number"),
    ],
)
def test_error_names_the_file(tmp_path, text, error):
    path = tmp_path / "boat.vehicle"
    path.write_text(text)
    with pytest.raises(UsageError, match=error) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith("vehicle file ") and str(tmp_path) in line for line in lines)
    assert sum(error in line for line in lines) == 1


def test_missing_file_raises_an_error(tmp_path):
    with pytest.raises(UsageError, match="no such vehicle file"):
        load(tmp_path / "missing")


def test_valid_settings_are_parsed():
    assert parse_settings(["CTL_K1=30", "LOOP_RATE_HZ=20"]) == {"CTL_K1": 30.0, "LOOP_RATE_HZ": 20.0}


@pytest.mark.parametrize("pair", ["CTL_K1", "CTL_K1=", "CTL_K1=x", "CTL_K1=nan", "CTL_K1=1e300", "CTL_K9=1", "=1"])
def test_invalid_setting_is_rejected(pair):
    with pytest.raises(UsageError):
        parse_settings([pair])
