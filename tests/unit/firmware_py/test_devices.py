"""Registry of drivers: creation, calibrators, capture formats."""

import re
import subprocess
import sys

import pytest

from firmware_py.actuator.pulse import PulseOptions
from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.devices import CAPTURE_FORMATS, COMPASSES, SECTIONS, calibrator_of, decode, find_capture
from firmware_py.sensors.ais import AisOptions
from firmware_py.sensors.bno08x_rvc import Bno08xRvcOptions
from firmware_py.sensors.mavlink_board import MavlinkOptions
from firmware_py.sensors.mavlink_compass import MavlinkCompassOptions
from firmware_py.sensors.mavlink_position import MavlinkPositionOptions
from firmware_py.sensors.mti import MtiOptions
from firmware_py.sensors.nmea2000_ais import Nmea2000AisOptions
from firmware_py.sensors.nmea2000_depth import Nmea2000DepthOptions
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from firmware_py.sensors.nmea2000_rudder import Nmea2000RudderOptions
from firmware_py.sensors.nmea2000_wind import Nmea2000WindOptions
from firmware_py.sensors.nmea_compass import NmeaCompassOptions
from firmware_py.sensors.nmea_depth import NmeaDepthOptions
from firmware_py.sensors.nmea_position import NmeaPositionOptions
from firmware_py.sensors.nmea_rudder import NmeaRudderOptions
from firmware_py.sensors.nmea_wind import NmeaWindOptions
from firmware_py.sensors.pni_tcm import PniOptions
from firmware_py.sensors.rion import RionOptions
from firmware_py.sensors.witmotion import WitmotionOptions
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
# Option, default, and the limits of a number.
OPTIONS = {
    NmeaCompassOptions: "require_checksum True",
    PniOptions: "rate_hz 10.0 0.5 100",
    MtiOptions: "rate_hz 10 1 100",
    RionOptions: "identifier auto, rate_hz 10.0 0.5 20, mounting none",
    WitmotionOptions: "algorithm read, rate_hz 0 0 200, save_rate False",
    Bno08xRvcOptions: "rate_hz 10.0 1 100, clockwise True",
    MavlinkOptions: "system 0 0 255, component 1 1 255",
    MavlinkCompassOptions: "reference true, require_status True",
    Nmea2000Options: "source -1 -1 251, gateway auto",
    NmeaPositionOptions: "require_checksum True",
    MavlinkPositionOptions: "solution receiver",
    PulseOptions: (
        "centre_us 1500.0 400 2600, us_per_rad 636.6 50 5000, minus_us None 400 2600, plus_us None 400 2600, "
        "end_deg 45.0 5 120, reversed False, min_us 1000.0 400 2600, max_us 2000.0 400 2600"
    ),
    NmeaRudderOptions: "offset_deg 0.0 -90 90, scale 1.0 -10 10, require_checksum True",
    Nmea2000RudderOptions: "instance -1 -1 252, offset_deg 0.0 -90 90, scale 1.0 -10 10",
    AisOptions: "own_mmsi 0 0 1e+09",
    Nmea2000AisOptions: "own_mmsi 0 0 1e+09",
    NmeaWindOptions: "offset_deg 0.0 -180 180, require_checksum True",
    Nmea2000WindOptions: "offset_deg 0.0 -180 180",
    NmeaDepthOptions: "transducer_depth_m 0.0 0 100, keel_depth_m 0.0 0 100, require_checksum True",
    Nmea2000DepthOptions: "transducer_depth_m 0.0 0 100",
}


def closed_line():
    line = FakeLine()
    line.unplug()
    return line


@pytest.mark.parametrize(("section", "name"), [(section, name) for section in ROLES for name in SECTIONS[section]])
def test_drivers_are_created_with_their_defaults_and_wait_for_the_port(section, name):
    driver = SECTIONS[section][name]
    line = closed_line()
    device = driver.make(line, driver.options())
    for _ in range(2):
        health = device.health(0.0)
        assert (health.role, health.state) == (ROLES[section], DeviceState.ABSENT)
        device.receive(0.0)
    assert (list(device.poll()), device.fileno()) == ([], -1)
    line.plug()
    assert device.fileno() == (-1 if section == "ais" else 7)  # AIS data do not wake the loop


@pytest.mark.parametrize(
    ("record", "row"), [(record, row) for record, rows in OPTIONS.items() for row in rows.split(", ")]
)
def test_defaults_and_limits_of_the_options(record, row):
    option, default, *limits = row.split()
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
