"""What passes from a line to a driver, and what is counted on the way."""

import pytest

from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea_reader import NmeaReader


@pytest.fixture
def monitor(line):
    return DeviceMonitor(line, DeviceRole.COMPASS)


def kinds(found):
    return [sentence.kind for sentence, _ in found]


def test_only_the_wanted_pass_and_damage_of_any_kind_counts(line, monitor, nmea):
    reader = NmeaReader(line, monitor, {"HDT"})
    line.inbox += nmea("HEHDT,1,T") + nmea("GPGSV,1,1,00") + nmea("HCHDM,1,M")
    line.inbox += b"$GPGSV,1,1,00*00\r\n$GPGSV,1,1,00\r\n$HEHDT,1,T\r\n$HEHDT,1,T*00\r\n"
    assert kinds(reader.read(1.0)) == ["HDT"]
    # A GSV without a checksum is not counted: it is not a selected kind.
    assert monitor.health(1.0).rejected == 3
    assert reader.read(1.1) == []


def test_a_restart_forgets_what_was_begun(line, monitor, nmea):
    reader = NmeaReader(line, monitor, {"HDT"})
    line.inbox += nmea("HEHDT,1,T")[:8]
    reader.read(1.0)
    reader.restart()
    line.inbox += nmea("HEHDT,1,T")[8:]
    assert reader.read(1.1) == []
    assert monitor.health(1.1).rejected == 0


def test_sentences_of_another_device_are_distinguished_from_a_wrong_baud_rate(line, monitor, nmea):
    reader = NmeaReader(line, monitor, {"HDT"})
    monitor.notice_reopening()
    line.inbox += b"\x80\xfe\x00"
    reader.read(1.0)
    assert monitor.health(1.0).text == "data not understood: wrong baud rate?"
    line.inbox += nmea("GPGSV,1,1,00")
    reader.read(1.1)
    assert monitor.health(1.1).text == "only GPGSV and similar: port of another device?"
    monitor.accept(1.2)
    assert monitor.health(1.2).text == ""
