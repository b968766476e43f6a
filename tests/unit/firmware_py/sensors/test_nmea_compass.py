"""Which sentences become headings, and what is said of those that do not."""

import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, NorthReference
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions


@pytest.fixture
def compass(line):
    return NmeaCompass(line, NmeaCompassOptions())


@pytest.fixture
def hear(line, nmea):
    """Give bodies of sentences to a compass at a time; return the samples."""

    def give(compass, *bodies, now_s=1.0):
        for body in bodies:
            line.inbox += nmea(body)
        compass.receive(now_s)
        return compass.poll()

    return give


def degrees_of(samples):
    return [(round(math.degrees(sample.heading_rad), 6), sample.reference.name) for sample in samples]


def test_hdg_is_true_with_a_variation_and_magnetic_without(hear, near, compass):
    (sample,) = hear(compass, "INHDG,180,5,W,10,W", now_s=3.5)
    assert near(sample.heading_rad, 165.0)
    assert near(sample.variation_rad, -10.0)
    assert (sample.t_s, sample.source, sample.reference) == (3.5, 0, NorthReference.TRUE)
    (sample,) = hear(compass, "HCHDG,98.3,2.0,E,,")
    assert near(sample.heading_rad, 100.3)
    assert (sample.reference, sample.variation_rad) == (NorthReference.MAGNETIC, None)


@pytest.mark.parametrize(
    ("body", "expected"),
    [("HEHDT,341.8,T", (341.8, "TRUE")), ("IIHDM,70.6,M", (70.6, "MAGNETIC")), ("GPTHS,77.5,A", (77.5, "TRUE")),
     ("GPTHS,77.5,E", (77.5, "TRUE")), ("HEHDT,360.0,T", (0.0, "TRUE"))],
)  # fmt: skip
def test_other_sentences(line, hear, body, expected):
    assert degrees_of(hear(NmeaCompass(line, NmeaCompassOptions()), body)) == [expected]


def test_pashr_brings_roll_and_pitch(hear, near, compass):
    (sample,) = hear(compass, "PASHR,204132.000,010.51,T,+00.39,-00.79,-00.84,0.151,0.075,0.555,1,0")
    assert near(sample.heading_rad, 10.51)
    assert near(sample.roll_rad, 0.39)
    assert near(sample.pitch_rad, -0.79)


def test_xdr_brings_roll_and_pitch_while_they_are_fresh(line, hear, near, compass):
    (sample,) = hear(compass, "YXXDR,A,1.2,D,PTCH,A,-3.4,D,ROLL", "HCHDT,10.0,T")
    assert near(sample.pitch_rad, 1.2)
    assert near(sample.roll_rad, -3.4)
    (sample,) = hear(compass, "WIXDR,A,5.0,D,ROLL", "HCHDT,10.0,T", now_s=3.5)
    assert near(sample.roll_rad, 5.0)
    assert near(sample.pitch_rad, 1.2)
    (sample,) = hear(compass, "HCHDT,10.0,T", now_s=3.6)
    assert near(sample.roll_rad, 5.0)
    assert sample.pitch_rad is None
    line.openings += 1
    assert hear(compass, "HCHDT,10.0,T", now_s=3.7)[0].roll_rad is None


def test_an_unknown_transducer_is_reported_once_and_is_no_rejected_sentence(hear, compass):
    hear(compass, "SDXDR,C,23.1,C,WTHI", "HCHDT,10.0,T", now_s=1.0)
    assert compass.health(1.0).text == "unknown transducer: WTHI (type C, unit C)"
    hear(compass, "SDXDR,C,23.1,C,WTHI", "HCHDT,10.0,T", now_s=15.0)
    assert (compass.health(15.0).text, compass.health(15.0).rejected) == ("", 0)


def test_turn_rate_is_attached_while_it_is_fresh_and_valid(hear, compass):
    (sample,) = hear(compass, "TIROT,-60.0,A", "HEHDT,1,T", now_s=1.0)
    assert sample.yaw_rate_rad_s == pytest.approx(math.radians(-1.0))
    assert hear(compass, "HEHDT,1,T", now_s=2.0)[0].yaw_rate_rad_s is not None
    assert hear(compass, "HEHDT,1,T", now_s=2.1)[0].yaw_rate_rad_s is None
    assert hear(compass, "TIROT,-60.0,A", "TIROT,-60.0,V", "HEHDT,1,T", now_s=2.2)[0].yaw_rate_rad_s is None
    assert hear(compass, "TIROT,-60.0,A", "TIROT,,A", "HEHDT,1,T", now_s=2.3)[0].yaw_rate_rad_s is None


def test_an_empty_heading_is_unknown_and_not_north(hear, compass):
    assert hear(compass, "GPHDT,,", "GPHDT,,T", "HCHDG,,,,,", "PASHR,1,,T,0,0,0", "GPTHS,,V", "GPTHS,12,S") == ()
    health = compass.health(1.0)
    assert (health.role, health.state, health.accepted, health.rejected) == (
        DeviceRole.COMPASS, DeviceState.STARTING, 0, 0
    )  # fmt: skip
    assert "THS: heading not valid" in health.text
    hear(compass, "GPHDT,,T")
    assert compass.health(1.0).text == "GPHDT: no heading"
    hear(compass, "GPHDT,5,T")
    assert (compass.health(1.0).state, compass.health(1.0).text) == (DeviceState.RUNNING, "")
    assert compass.health(4.0).state is DeviceState.SILENT


def test_the_slow_repeat_in_vhw_and_foreign_sentences_are_not_taken(hear, compass):
    assert hear(compass, "SDVHW,67.5,T,66.6,M,5.3,N,9.8,K", "GPGSV,1,1,00", "GPRMC,nonsense") == ()
    assert compass.health(1.0).rejected == 0


def test_a_compass_that_says_400_degrees_is_refused_and_reported(hear, compass):
    assert hear(compass, "HEHDT,400,T") == ()
    health = compass.health(1.0)
    assert (health.accepted, health.rejected) == (0, 1)
    assert health.text == "HEHDT: heading_true_deg 400 out of range"


def test_a_missing_checksum_is_refused_unless_the_vehicle_allows_it(line, hear):
    strict = NmeaCompass(line, NmeaCompassOptions())
    lenient = NmeaCompass(line, NmeaCompassOptions(require_checksum=False))
    line.inbox += b"$HEHDT,341.8,T\r\n$PXYZ,1\r\n"
    strict.receive(1.0)
    assert strict.poll() == ()
    assert (strict.health(1.0).rejected, strict.health(1.0).text) == (
        1,
        "HEHDT: no checksum; accept it with require_checksum = false",
    )
    # Without a checksum, what a cut leaves of 274.07 must not become a heading.
    line.inbox += b"$HEHDT,341.8,T\r\n$GPHDT,27\r\n$GPHDT,274.07,\r\n$HEHDT,341.9,T*21\r\n$HCHDG,98.3,0.0,E,12\r\n"
    lenient.receive(1.0)
    assert degrees_of(lenient.poll()) == [(341.8, "TRUE")]
    assert lenient.health(1.0).rejected == 4


def test_rare_true_headings_do_not_suppress_frequent_magnetic_ones(hear, compass):
    """Otherwise the compass would be valid for one second in three, with the course fallback between."""
    samples = []
    for tenths in range(300):
        texts = ("HCHDM,8,M", "HCHDT,20,T") if tenths % 30 == 0 else ("HCHDM,8,M",)
        samples += [
            (tenths, *degrees) for text in texts for degrees in degrees_of(hear(compass, text, now_s=tenths / 10))
        ]
    assert [tenths for tenths, _, reference in samples if reference == "MAGNETIC"] == list(range(300))
    assert len(samples) == 310


def test_a_magnetic_heading_is_dropped_once_true_ones_are_established(hear, compass):
    mixed = ("HEHDT,10,T", "HCHDM,8,M")
    found = [degrees_of(hear(compass, *mixed, now_s=float(second))) for second in range(4)]
    assert [len(samples) for samples in found] == [2, 2, 1, 1]
    assert degrees_of(hear(compass, "HCHDM,8,M", now_s=5.1)) == [(8.0, "MAGNETIC")]  # the true one has gone
    assert compass.health(5.1).rejected == 0


def test_named_sentences_are_the_only_ones(line, hear):
    compass = NmeaCompass(line, NmeaCompassOptions(sentences=("HDG",)))
    found = hear(compass, "HEHDT,10,T", "HCHDT,10,T", "HCHDG,12,,,1,E", "PASHR,1,9,T,0,0,0")
    assert degrees_of(found) == [(13.0, "TRUE")]
    with pytest.raises(ValueError, match="sentences: 'VHW' is not known; use one of HDG"):
        NmeaCompassOptions(sentences=("HDG", "VHW"))


def test_a_reopened_port_begins_again(line, hear, nmea, compass):
    hear(compass, "HEHDT,10,T", "TIROT,60,A")
    line.inbox += nmea("HEHDT,20,T")[:9]
    compass.receive(1.0)
    line.unplug()
    compass.receive(1.1)
    assert (compass.fileno(), compass.health(1.1).state) == (-1, DeviceState.ABSENT)
    line.plug()
    line.inbox += nmea("HEHDT,30,T")[9:]  # the tail of another sentence must not join the old head
    compass.receive(1.2)
    assert compass.poll() == ()
    assert compass.health(1.2).state is DeviceState.STARTING
    assert hear(compass, "HEHDT,30,T", now_s=1.3)[0].yaw_rate_rad_s is None


def test_samples_without_polls_are_bounded(line, nmea, compass):
    for _ in range(40):
        line.inbox += nmea("HEHDT,1,T") * 200
        compass.receive(1.0)
    assert len(compass.poll()) == 512
