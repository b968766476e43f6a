"""Registry of drivers: creation, calibrators, capture formats."""

import subprocess
import sys

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.devices import CAPTURE_FORMATS, COMPASSES, SECTIONS, calibrator_of, decode
from support.line import FakeLine
from support.paths import ROOT

ROLES = {
    "compass": DeviceRole.COMPASS,
    "position": DeviceRole.POSITION,
    "rudder": DeviceRole.RUDDER,
    "wind": DeviceRole.WIND,
    "depth": DeviceRole.DEPTH,
}


def closed_line():
    line = FakeLine()
    line.unplug()
    return line


@pytest.mark.parametrize(("section", "name"), [(section, name) for section in ROLES for name in SECTIONS[section]])
def test_drivers_are_created_with_their_defaults_and_wait_for_the_port(section, name):
    driver = SECTIONS[section][name]
    device = driver.make(closed_line(), driver.options())
    device.receive(0.0)
    health = device.health(0.0)
    assert (health.role, health.state) == (ROLES[section], DeviceState.ABSENT)
    assert list(device.poll()) == []


def test_compasses_that_are_sent_commands_need_a_serial_port():
    assert {"pni_tcm", "mti", "rion", "witmotion"} <= {name for name, driver in COMPASSES.items() if driver.writes}


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
