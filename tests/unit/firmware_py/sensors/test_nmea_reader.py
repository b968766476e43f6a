"""What passes from a line to a driver, and what is counted on the way."""

import pytest

from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea_reader import NmeaReader


@pytest.fixture
def condition(line):
    return DeviceMonitor(line, DeviceRole.COMPASS)


def kinds(found):
    return [sentence.kind for sentence, _ in found]


def test_only_the_wanted_pass_and_damage_of_any_kind_counts(line, condition, nmea):
    reader = NmeaReader(line, condition, {"HDT"})
    line.inbox += nmea("HEHDT,1,T") + nmea("GPGSV,1,1,00") + nmea("HCHDM,1,M")
    line.inbox += b"$GPGSV,1,1,00*00\r\n$GPGSV,1,1,00\r\n$HEHDT,1,T\r\n$HEHDT,1,T*00\r\n"
    assert kinds(reader.read(1.0)) == ["HDT"]
    # The GSV without a checksum is no damage, and nobody wanted it.
    assert condition.health(1.0).rejected == 3
    assert reader.read(1.1) == []


def test_one_talker_among_several(line, condition, nmea):
    reader = NmeaReader(line, condition, {"HDT"}, talker="HE")
    line.inbox += nmea("GPHDT,1,T") + nmea("HEHDT,2,T")
    assert [decoded.numbers["heading_true_deg"] for _, decoded in reader.read(1.0)] == [2.0]


def test_a_restart_forgets_what_was_begun(line, condition, nmea):
    reader = NmeaReader(line, condition, {"HDT"})
    line.inbox += nmea("HEHDT,1,T")[:8]
    reader.read(1.0)
    reader.restart()
    line.inbox += nmea("HEHDT,1,T")[8:]
    assert reader.read(1.1) == []
    assert condition.health(1.1).rejected == 0
