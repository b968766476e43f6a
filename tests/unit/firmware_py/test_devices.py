"""Registry of drivers: creation, calibrators, capture formats."""

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.devices import CAPTURE_FORMATS, COMPASSES, SECTIONS, calibrator_of, decode
from support.line import FakeLine

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
