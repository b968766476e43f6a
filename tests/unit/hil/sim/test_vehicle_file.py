"""The vehicle file of a run."""

import tomllib

import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.errors import UsageError
from hil.sim.vehicle_file import (
    file_text,
    load,
    model_of,
    mounting_of,
    parse_settings,
    standard_vehicle,
    with_devices,
)
from hil.sim.world import Mounting

PORTS = {"compass": '/tmp/a "b"/compass', "position": "/p", "rudder": "/r", "link": "/l"}
GIVEN = """
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


def test_default_boat():
    vehicle = standard_vehicle()
    assert model_of(vehicle) == OCEAN_RAMBLER
    assert mounting_of(vehicle) == Mounting()
    data = tomllib.loads(file_text(vehicle, PORTS, {"CTL_K1": 30.0}))
    assert data["compass"] == {"driver": "nmea", "port": PORTS["compass"], "baud": 38400}
    assert data["rudder"] == {"driver": "dynamixel", "port": "/r", "baud": 57600}
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600}
    assert data["link"] == {"urls": ["serial:/l:57600"]}
    assert data["parameters"] == {"CTL_K1": 30.0}


def test_a_file_keeps_all_but_its_ports(tmp_path):
    (tmp_path / "boat.vehicle").write_text(GIVEN)
    (tmp_path / "boat.param").write_text("MDL_K 0.2\nMDL_T_S 3\n")
    vehicle = load(tmp_path / "boat.vehicle")
    data = tomllib.loads(file_text(vehicle, PORTS, {"MDL_K": 0.5}))
    assert data["vehicle"]["name"] == "Test boat"
    assert data["compass"] == {"driver": "pni_tcm", "port": PORTS["compass"], "baud": 9600, "rate_hz": 5.0}
    assert data["rudder"] == {"driver": "volz", "port": "/r", "baud": 115200, "id": 7}
    assert data["hull"] == {"length_m": 3.05}
    assert data["parameters"]["MDL_K"] == 0.5
    assert data["parameters"]["MDL_T_S"] == 3.0
    # The ship model is from the file, not from the settings.
    assert model_of(vehicle).turning_ability_1_s == pytest.approx(0.1)
    assert model_of(vehicle).turning_lag_s == 3.0
    assert mounting_of(vehicle) == Mounting(radians(4.0), rudder_reversed=True)


def test_options_of_position_and_ais_are_kept_when_the_board_emulates_that_driver(tmp_path):
    more = """
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
    (tmp_path / "boat.vehicle").write_text(GIVEN.replace('file = "boat.param"', "") + more)
    vehicle = load(tmp_path / "boat.vehicle")
    data = tomllib.loads(file_text(vehicle, {**PORTS, "ais": "/a"}, {}))
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600, "require_checksum": False}
    assert data["ais"] == {"driver": "nmea", "port": "/a", "baud": 38400, "own_mmsi": 235000099}
    (tmp_path / "boat.vehicle").write_text(
        GIVEN.replace('file = "boat.param"', "") + '[position]\ndriver = "ubx"\nport = "/dev/x"\nbaud = 38400\n'
    )
    data = tomllib.loads(file_text(load(tmp_path / "boat.vehicle"), PORTS, {}))
    assert data["position"] == {"driver": "nmea", "port": "/p", "baud": 9600}


def test_another_device_replaces_its_section(tmp_path):
    (tmp_path / "boat.vehicle").write_text(GIVEN.replace('file = "boat.param"', ""))
    vehicle = load(tmp_path / "boat.vehicle")
    chosen = with_devices(vehicle, "pni", "dynamixel")
    assert chosen.compass == vehicle.compass
    assert (chosen.rudder.driver, chosen.rudder.baud, chosen.rudder.options.id) == ("dynamixel", 57600, 1)
    assert with_devices(vehicle, None, None) == vehicle


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[compass", "not valid TOML"),
        ("compass = 3", "must be a section"),
        ("[compass]\ndriver = 'astrolabe'\n", "nmea, pni_tcm"),
        (GIVEN.replace("id = 7", "id = 7\nrate_hz = 5"), "'rate_hz' is not read by driver volz, which has id"),
        (GIVEN, "boat.param cannot be read"),
        (GIVEN.replace('file = "boat.param"', "CTL_K9 = 3"), "unknown parameter"),
        (GIVEN.replace('file = "boat.param"', "CTL_K1 = 'x'"), "expected a number"),
        (GIVEN.replace('file = "boat.param"', "CTL_K1 = nan"), "not a number"),
    ],
)
def test_errors_name_the_file(tmp_path, text, complaint):
    path = tmp_path / "boat.vehicle"
    path.write_text(text)
    with pytest.raises(UsageError, match=complaint) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith("vehicle file ") and str(tmp_path) in line for line in lines)
    assert sum(complaint in line for line in lines) == 1


def test_missing_file(tmp_path):
    with pytest.raises(UsageError, match="no such vehicle file"):
        load(tmp_path / "none")


def test_settings_are_checked_against_the_table():
    assert parse_settings(["CTL_K1=30", "LOOP_RATE_HZ=20"]) == {"CTL_K1": 30.0, "LOOP_RATE_HZ": 20.0}


@pytest.mark.parametrize("pair", ["CTL_K1", "CTL_K1=", "CTL_K1=x", "CTL_K1=nan", "CTL_K1=1e300", "CTL_K9=1", "=1"])
def test_invalid_settings(pair):
    with pytest.raises(UsageError):
        parse_settings([pair])
