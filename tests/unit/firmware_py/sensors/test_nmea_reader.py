"""NMEA reader of the drivers: selection of sentences, counted faults, texts."""

import pytest

from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_depth import NmeaDepth, NmeaDepthOptions
from firmware_py.sensors.nmea_reader import NmeaReader
from firmware_py.sensors.nmea_wind import NmeaWind, NmeaWindOptions


@pytest.fixture
def monitor(line):
    return DeviceMonitor(line, DeviceRole.COMPASS)


@pytest.fixture
def read(line, monitor, nmea):
    """Function that delivers sentences and bytes to a reader of HDT and returns the kinds of its sentences."""
    reader = NmeaReader(line, monitor, {"HDT"})

    def read(*data, now_s=1.0):
        line.inbox += b"".join(nmea(item) if isinstance(item, str) else item for item in data)
        return [sentence.kind for sentence, _ in reader.read(now_s)]

    read.reader = reader
    return read


def test_selected_sentences_are_returned_and_faults_of_all_kinds_counted(read, monitor):
    faulty = b"$GPGSV,1,1,00*00\r\n$GPGSV,1,1,00\r\n$HEHDT,1,T\r\n$HEHDT,1,T*00\r\n"
    assert read("HEHDT,1,T", "GPGSV,1,1,00", "HCHDM,1,M", faulty) == ["HDT"]
    # A GSV without a checksum is not counted: its kind is not selected.
    assert (monitor.health(1.0).rejected, monitor.health(1.0).text) == (3, "HEHDT: checksum")
    assert read() == []


def test_restart_discards_an_incomplete_sentence(read, monitor, nmea):
    read(nmea("HEHDT,1,T")[:8])
    read.reader.restart()
    assert read(nmea("HEHDT,1,T")[8:]) == []
    assert monitor.health(1.0).rejected == 0


def test_sentences_of_another_device_are_distinguished_from_a_wrong_baud_rate(read, monitor):
    monitor.notice_reopening()
    read(b"\x80\xfe\x00")
    assert monitor.health(1.0).text == "data not understood: wrong baud rate?"
    read("GPGSV,1,1,00", now_s=1.1)
    assert monitor.health(1.1).text == "only GPGSV and similar: port of another device?"
    monitor.accept(1.2)
    assert monitor.health(1.2).text == ""


@pytest.mark.parametrize(
    ("driver", "options", "sentence"),
    [
        (NmeaWind, NmeaWindOptions(sentences=("MWD",)), "WIMWV,40.0,R,5.0,N,A"),
        (NmeaDepth, NmeaDepthOptions(sentences=("DBS",)), "SDDPT,5.0,0.0"),
        (NmeaCompass, NmeaCompassOptions(sentences=("HDT",)), "HCHDM,40.0,M"),
    ],
)
def test_sentences_that_the_option_excludes_name_the_option(line, deliver, driver, options, sentence):
    device = driver(line, options)
    assert deliver(device, sentence) == ()
    assert device.health(1.0).text == f"only {sentence[:5]} and similar: correct port or sentences"
    assert len(deliver(driver(line, type(options)()), sentence)) == 1
    unrestricted = driver(line, type(options)())
    deliver(unrestricted, "GPGSV,1,1,00")
    assert unrestricted.health(1.0).text == "only GPGSV and similar: port of another device?"
