"""NMEA reader of the drivers: selection of sentences, counted faults, texts."""

import pytest

from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_depth import NmeaDepth, NmeaDepthOptions
from firmware_py.sensors.nmea_reader import CAPTURE_FORMAT, NmeaReader
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
    assert read("HEHDT,1,T", "HEHDT,400,T", "GPGSV,1,1,00", "HCHDM,1,M", faulty) == ["HDT"]
    # A GSV without a checksum is not counted: its kind is not selected.
    assert (monitor.health(1.0).rejected, monitor.health(1.0).text) == (4, "HEHDT: checksum")
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
    read(now_s=4.0)
    assert monitor.health(4.0).text == ""
    read("GPGSV,1,1,00", now_s=4.1)
    assert monitor.health(4.1).text == "only GPGSV and similar: port of another device?"
    monitor.accept(4.2)
    assert monitor.health(4.2).text == ""


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


@pytest.mark.parametrize(
    ("raw", "result"),
    [
        (b"$HEHDT,341.8,T*21\r\n", {"line": 1, "type": "heading", "sentence": "HEHDT", "heading_true_deg": 341.8,
                                    "true_deg": 341.8}),
        (b"\n$GPHDT,,*4F", {"line": 2, "type": "heading", "sentence": "GPHDT", "heading_true_deg": None,
                            "true_deg": None}),
        (b"$IIHDM,70.6,M*13", {"line": 1, "type": "heading", "sentence": "IIHDM", "heading_magnetic_deg": 70.6,
                               "magnetic_deg": 70.6}),
        (b"$HEHDT,341.9,T*21\r\n", {"line": 1, "type": "error", "error": "checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,341.8,T\r\n", {"line": 1, "type": "error", "error": "no checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,341.8,T", {"line": 1, "type": "error", "error": "no checksum", "sentence": "HEHDT"}),
        (b"$HEHDT,34\0", {"line": 1, "type": "error", "error": "malformed", "sentence": "HEHDT"}),
        (b"$HEHDT,400,T*35\r\n", {"line": 1, "type": "error", "error": "range", "sentence": "HEHDT",
                                  "detail": "HEHDT: heading_true_deg 400 out of range"}),
        (b"$GNFOO,,*4F\r\n", {"line": 1, "type": "other", "sentence": "GNFOO"}),
        (b"$GPROT,35.6,A*01\r\n", {"line": 1, "type": "turn_rate", "sentence": "GPROT", "turn_rate_deg_min": 35.6,
                                   "status": "A"}),
    ],
)  # fmt: skip
def test_decoded_capture(raw, result):
    assert list(CAPTURE_FORMAT.decode(raw)) == [result]


def test_values_have_nine_decimal_places(nmea):
    (result,) = CAPTURE_FORMAT.decode(nmea("GPGLL,5327.03941,N,00214.42462,W,103607.00,A,A"))
    assert (result["lat_deg"], result["lon_deg"]) == (53.450656833, -2.240410333)


def test_unknown_transducer_is_reported_once(nmea):
    results = list(CAPTURE_FORMAT.decode(nmea("SDXDR,C,23.1,C,WTHI,A,1.0,D,ROLL") * 3 + nmea("SDXDR,C,1.0,C,WTLO")))
    first, second = "WTHI (type C, unit C)", "WTLO (type C, unit C)"
    assert [result.get("unknown") for result in results] == [first, None, None, second]
    assert [result.get("roll_deg") for result in results] == [1.0, 1.0, 1.0, None]


def test_thirty_two_unknown_transducers_are_reported(nmea):
    results = CAPTURE_FORMAT.decode("".join(nmea(f"SDXDR,C,1.0,C,T{number}").decode() for number in range(34)).encode())
    unknown = [f"T{number} (type C, unit C)" for number in range(32)]
    assert [result.get("unknown") for result in results] == [*unknown, None, None]


def test_ignored_sentence_is_named_and_an_unknown_one_is_not(nmea):
    ignored, unknown = CAPTURE_FORMAT.decode(nmea("PAMTR,EN,1,1") + nmea("GPABC,1"))
    assert ignored["type"] == "other"
    assert ignored["detail"].endswith("not used")
    assert unknown == {"line": 2, "type": "other", "sentence": "GPABC"}
