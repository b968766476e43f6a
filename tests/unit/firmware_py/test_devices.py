"""The registry of drivers: what it makes, what calibrates, what decodes."""

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.devices import CAPTURE_FORMATS, COMPASSES, SECTIONS, calibrator_of, decode

ROLES = {"compass": DeviceRole.COMPASS, "position": DeviceRole.POSITION, "rudder": DeviceRole.RUDDER}


class UnpluggedLine:
    name = "/dev/x"
    baud = 57600
    openings = 0
    connected = False

    def fileno(self):
        return -1

    def read(self):
        return b""

    def write(self, data):
        return False


@pytest.mark.parametrize(("section", "name"), [(section, name) for section in ROLES for name in SECTIONS[section]])
def test_every_driver_is_made_with_its_defaults_and_waits_for_its_port(section, name):
    driver = SECTIONS[section][name]
    device = driver.make(UnpluggedLine(), driver.options())
    device.receive(0.0)
    health = device.health(0.0)
    assert (health.role, health.state) == (ROLES[section], DeviceState.ABSENT)
    assert list(device.poll()) == []


def test_of_the_compasses_only_the_pni_calibrates_itself():
    calibrating = []
    for name, driver in COMPASSES.items():
        compass = driver.make(UnpluggedLine(), driver.options())
        if (calibrator := calibrator_of(name, compass)) is not None:
            assert calibrator is compass
            assert not calibrator.calibrate(0.0)  # its port is away
            calibrating.append(name)
    assert calibrating == ["pni_tcm"]


def test_captures_are_decoded_by_the_names_of_the_protocols():
    assert list(CAPTURE_FORMATS) == ["nmea", "pni", "mti", "ubx", "vedirect"]
    (result,) = decode("nmea", b"$HEHDT,341.8,T*21\r\n")
    assert (result["type"], result["true_deg"]) == ("heading", 341.8)
