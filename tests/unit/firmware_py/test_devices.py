"""Registry of drivers: creation, calibrators, capture formats."""

import re
import subprocess
import sys

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.devices import CAPTURE_FORMATS, COMPASSES, SECTIONS, calibrator_of, decode, find_capture
from support.line import FakeLine
from support.paths import ROOT

ROLES = {
    "compass": DeviceRole.COMPASS,
    "position": DeviceRole.POSITION,
    "rudder": DeviceRole.RUDDER,
    "wind": DeviceRole.WIND,
    "depth": DeviceRole.DEPTH,
    "rudder_angle": DeviceRole.RUDDER_ANGLE,
    "power": DeviceRole.POWER,
    "ais": DeviceRole.AIS,
}
# Section, driver, option, default, and the limits of a number.
OPTIONS = """
compass nmea require_checksum True
compass pni_tcm rate_hz 10.0 0.5 100
compass mti rate_hz 10 1 100
compass rion identifier auto
compass rion address 0 0 239
compass rion rate_hz 10.0 0.5 20
compass rion mounting none
compass witmotion algorithm read
compass witmotion rate_hz 0 0 200
compass witmotion save_rate False
compass bno08x_rvc rate_hz 10.0 1 100
compass bno08x_rvc clockwise True
compass mavlink system 0 0 255
compass mavlink component 1 1 255
compass mavlink rate_hz 10 1 50
compass mavlink reference true
compass mavlink require_status True
compass nmea2000 source -1 -1 251
compass nmea2000 gateway auto
position nmea require_checksum True
position mavlink rate_hz 1 1 10
position mavlink solution receiver
rudder dynamixel id 1 0 252
rudder volz id 1 1 30
rudder feetech id 1 0 253
rudder maestro centre_us 1500.0 400 2600
rudder maestro us_per_rad 636.6 50 5000
rudder maestro minus_us None 400 2600
rudder maestro plus_us None 400 2600
rudder maestro end_deg 45.0 5 120
rudder maestro reversed False
rudder maestro min_us 1000.0 400 2600
rudder maestro max_us 2000.0 400 2600
rudder maestro channel 0 0 23
rudder maestro device 12 0 127
rudder maestro crc False
rudder maestro speed 0 0 16383
rudder maestro acceleration 0 0 255
rudder_angle nmea offset_deg 0.0 -90 90
rudder_angle nmea scale 1.0 -10 10
rudder_angle nmea require_checksum True
rudder_angle nmea2000 instance -1 -1 252
rudder_angle nmea2000 offset_deg 0.0 -90 90
rudder_angle nmea2000 scale 1.0 -10 10
power mavlink battery 0 0 255
ais nmea own_mmsi 0 0 1e+09
ais nmea2000 own_mmsi 0 0 1e+09
wind nmea offset_deg 0.0 -180 180
wind nmea require_checksum True
wind nmea2000 offset_deg 0.0 -180 180
depth nmea transducer_depth_m 0.0 0 100
depth nmea keel_depth_m 0.0 0 100
depth nmea require_checksum True
depth nmea2000 transducer_depth_m 0.0 0 100
"""


def closed_line():
    line = FakeLine()
    line.unplug()
    return line


@pytest.mark.parametrize(("section", "name"), [(section, name) for section in ROLES for name in SECTIONS[section]])
def test_drivers_are_created_with_their_defaults_and_wait_for_the_port(section, name):
    driver = SECTIONS[section][name]
    line = closed_line()
    device = driver.make(line, driver.options())
    device.receive(0.0)
    health = device.health(0.0)
    assert (health.role, health.state) == (ROLES[section], DeviceState.ABSENT)
    assert (list(device.poll()), device.fileno()) == ([], -1)
    line.plug()
    assert device.fileno() == (-1 if section == "ais" else 7)  # AIS data do not wake the loop


@pytest.mark.parametrize("row", OPTIONS.strip().splitlines())
def test_defaults_and_limits_of_the_options(row):
    section, name, option, default, *limits = row.split()
    record = SECTIONS[section][name].options
    present = getattr(record(), option)
    assert str(present) == default
    allowed = rf"{option}: .* is out of range; allowed: {re.escape(' to '.join(limits))}$"
    for value in [float(limits[0]) - 1, float(limits[1]) + 1] if limits else []:
        with pytest.raises(ValueError, match=allowed):
            record(**{option: int(value) if isinstance(present, int) else value})


def test_ports_and_use_of_the_drivers():
    """Drivers that write need a serial port."""
    drivers = {f"{section} {name}": SECTIONS[section][name] for section in SECTIONS for name in SECTIONS[section].own}
    drivers = {label: driver for label, driver in drivers.items() if "_b " not in label}
    assert {label for label, driver in drivers.items() if driver.writes} == {
        *(f"compass {name}" for name in ("pni_tcm", "mti", "rion", "witmotion", "mavlink")),
        *(f"rudder {name}" for name in ("dynamixel", "volz", "feetech", "maestro", "pwm")),
        *("position mavlink", "power mavlink"),
    }
    sections = ("compass", "position", "rudder_angle", "ais", "wind", "depth")
    assert {label for label, driver in drivers.items() if driver.reads_can} == {f"{name} nmea2000" for name in sections}
    assert {label for label, driver in drivers.items() if not driver.has_north} == {"compass bno08x_rvc"}
    assert {label: driver.port for label, driver in drivers.items() if driver.port} == {"rudder pwm": "pwm:"}


def test_only_the_pni_compass_has_a_calibrator():
    calibrating = []
    for name, driver in COMPASSES.items():
        compass = driver.make(closed_line(), driver.options())
        if (calibrator := calibrator_of(name, compass)) is not None:
            assert calibrator is compass
            assert not calibrator.calibrate(0.0)  # the port is closed
            calibrating.append(name)
    assert calibrating == ["pni_tcm"]


def test_names_of_the_capture_formats():
    assert list(CAPTURE_FORMATS) == [
        "nmea",
        "pni",
        "mti",
        "rion",
        "witmotion",
        "bno08x_rvc",
        "ubx",
        "vedirect",
        "nmea2000",
    ]
    (result,) = decode("nmea", b"$HEHDT,341.8,T*21\r\n")
    assert (result["type"], result["true_deg"]) == ("heading", 341.8)


@pytest.mark.parametrize("name", ["volz", "nothing"])
def test_driver_without_a_capture_format_is_refused(name):
    with pytest.raises(ValueError, match=f"^unknown capture format: '{name}'; use one of nmea, pni, "):
        find_capture(name)


def test_only_the_drivers_that_the_vehicle_file_names_are_imported():
    """Neither another driver nor the search for packages, which takes 30 ms, costs the start anything."""
    script = (
        "import sys; from pathlib import Path; from firmware_py.assemble import wiring; "
        "from firmware_py.vehicle import load; load(Path('params/ocean_rambler.toml')); "
        "print(*(name for name in sys.modules if name.startswith(('firmware_py', 'importlib.metadata', 'can'))))"
    )
    output = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    loaded = set(output.split())
    drivers = {row.partition(":")[0] for registry in SECTIONS.values() for row in registry.own.values()}
    named = {"sensors.pni_tcm", "sensors.nmea_position", "actuator.dynamixel"}
    assert drivers & loaded == {f"firmware_py.{name}" for name in named}
    assert not {"importlib.metadata", "can"} & loaded


def test_every_driver_is_in_the_table_of_supported_devices():
    page = (ROOT / "docs/reference/devices.md").read_text()
    rows = [[cell.strip() for cell in line.split("|")] for line in page.splitlines() if line.startswith("| ")]
    described = {(section, row[2].strip("`")) for row in rows for section in row[1].split(", ")}
    missing = {
        (section, name)
        for section, registry in SECTIONS.items()
        if not section.endswith("_b")
        for name in registry.own
        if not {(section, name), (f"{section}_b", name)} & described
    }
    assert missing == set()
