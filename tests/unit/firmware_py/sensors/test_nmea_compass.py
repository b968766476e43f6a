"""NMEA compass: selection of the headings, yaw rate and attitude, and reported problems."""

import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, NorthReference
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions


@pytest.fixture
def compass(line):
    return NmeaCompass(line, NmeaCompassOptions())


def headings(samples):
    return [(round(math.degrees(sample.heading_rad), 6), sample.reference.name) for sample in samples]


def test_hdg_is_true_with_a_variation_and_magnetic_without(deliver, near, compass):
    (sample,) = deliver(compass, "INHDG,180,5,W,10,W", now_s=3.5)
    assert near(sample.heading_rad, 165.0)
    assert near(sample.variation_rad, -10.0)
    assert (sample.t_s, sample.source, sample.reference) == (3.5, 0, NorthReference.TRUE)
    (sample,) = deliver(compass, "HCHDG,98.3,2.0,E,,")
    assert near(sample.heading_rad, 100.3)
    assert (sample.reference, sample.variation_rad) == (NorthReference.MAGNETIC, None)


@pytest.mark.parametrize(
    ("body", "heading_deg", "reference", "variation_deg"),
    [
        ("HCHDG,90,3.0,E,,", 93.0, "MAGNETIC", None),
        # A large deviation of a device that states no variation may be the variation.
        ("HCHDG,90,3.1,E,,", 93.1, "MAGNETIC", 3.1),
        ("HCHDG,90,3.1,W,0.0,E", 86.9, "MAGNETIC", -3.1),
        ("HCHDG,90,3.1,E,10,E", 103.1, "TRUE", 10.0),
    ],
)
def test_deviation_of_more_than_3_deg_without_a_variation(
    deliver, near, compass, body, heading_deg, reference, variation_deg
):
    (sample,) = samples = deliver(compass, body)
    assert headings(samples) == [(heading_deg, reference)]
    assert sample.variation_rad is None if variation_deg is None else near(sample.variation_rad, variation_deg)


@pytest.mark.parametrize(
    ("true_deg", "now_s", "has_variation"),
    [
        (1.5, 0.3, True),
        (358.5, 0.3, True),
        (1.6, 0.3, False),
        (358.4, 0.3, False),
        (180.0, 0.3, False),
        (0.0, 0.31, False),
    ],
)
def test_true_heading_contains_the_variation_of_an_equal_hdg(deliver, near, compass, true_deg, now_s, has_variation):
    """The headings may differ by 1.5 deg and 0.3 s; the result applies for 2 s."""
    deliver(compass, "HCHDG,350,,,10,E", now_s=0.0)
    later = [deliver(compass, f"HEHDT,{true_deg},T", now_s=now_s)[0]]
    later += [deliver(compass, "HEHDT,90,T", now_s=later_s)[0] for later_s in (0.4, 2.0)]
    for sample in later:
        assert near(sample.variation_rad, 10.0) if has_variation else sample.variation_rad is None
    assert deliver(compass, "HEHDT,90,T", now_s=2.1)[0].variation_rad is None
    deliver(compass, "HCHDG,90,,,10,E", now_s=10.0)
    assert near(deliver(compass, "HEHDT,100,T", now_s=10.25)[0].variation_rad, 10.0)
    assert deliver(compass, "HEHDT,100,T", now_s=12.1)[0].variation_rad is None


@pytest.mark.parametrize(
    ("body", "expected"),
    [("HEHDT,341.8,T", (341.8, "TRUE")), ("IIHDM,70.6,M", (70.6, "MAGNETIC")), ("GPTHS,77.5,A", (77.5, "TRUE")),
     ("GPTHS,77.5,E", (77.5, "TRUE")), ("HEHDT,360.0,T", (0.0, "TRUE"))],
)  # fmt: skip
def test_other_heading_sentences(deliver, compass, body, expected):
    assert headings(deliver(compass, body)) == [expected]


def test_pashr_contains_roll_and_pitch(deliver, near, compass):
    (sample,) = deliver(compass, "PASHR,204132.000,010.51,T,+00.39,-00.79,-00.84,0.151,0.075,0.555,1,0")
    assert near(sample.heading_rad, 10.51)
    assert near(sample.roll_rad, 0.39)
    assert near(sample.pitch_rad, -0.79)


def test_roll_and_pitch_of_xdr_are_used_while_they_are_recent(line, deliver, near, compass):
    (sample,) = deliver(compass, "YXXDR,A,1.2,D,PTCH,A,-3.4,D,ROLL", "HCHDT,10.0,T")
    assert near(sample.pitch_rad, 1.2)
    assert near(sample.roll_rad, -3.4)
    (sample,) = deliver(compass, "WIXDR,A,5.0,D,ROLL", "HCHDT,10.0,T", now_s=3.5)
    assert near(sample.roll_rad, 5.0)
    assert near(sample.pitch_rad, 1.2)
    (sample,) = deliver(compass, "HCHDT,10.0,T", now_s=3.6)
    assert near(sample.roll_rad, 5.0)
    assert sample.pitch_rad is None
    line.openings += 1
    assert deliver(compass, "HCHDT,10.0,T", now_s=3.7)[0].roll_rad is None


def test_turn_rate_is_used_while_it_is_recent_and_valid(deliver, compass):
    (sample,) = deliver(compass, "TIROT,-60.0,A", "HEHDT,1,T", now_s=1.0)
    assert sample.yaw_rate_rad_s == pytest.approx(math.radians(-1.0))
    assert deliver(compass, "HEHDT,1,T", now_s=2.0)[0].yaw_rate_rad_s is not None
    assert deliver(compass, "HEHDT,1,T", now_s=2.1)[0].yaw_rate_rad_s is None
    for invalid in ("TIROT,-60.0,V", "TIROT,,A"):
        assert deliver(compass, "TIROT,-60.0,A", invalid, "HEHDT,1,T", now_s=2.2)[0].yaw_rate_rad_s is None


def test_unknown_transducer_is_reported_once_and_not_counted_as_rejected(deliver, compass):
    deliver(compass, "SDXDR,C,23.1,C,WTHI", "HCHDT,10.0,T", now_s=1.0)
    assert compass.health(1.0).text == "unknown transducer: WTHI (type C, unit C)"
    deliver(compass, "SDXDR,C,23.1,C,WTHI", "HCHDT,10.0,T", now_s=15.0)
    assert (compass.health(15.0).text, compass.health(15.0).rejected) == ("", 0)


def test_empty_heading_gives_no_sample(deliver, compass):
    assert deliver(compass, "GPHDT,,", "GPHDT,,T", "HCHDG,,,,,", "PASHR,1,,T,0,0,0", "GPTHS,,V", "GPTHS,12,S") == ()
    health = compass.health(1.0)
    assert (health.role, health.state) == (DeviceRole.COMPASS, DeviceState.STARTING)
    assert (health.accepted, health.rejected, health.text) == (0, 0, "GPTHS: heading not valid")
    deliver(compass, "GPHDT,,T")
    assert compass.health(1.0).text == "GPHDT: no heading"
    deliver(compass, "GPHDT,5,T")
    assert (compass.health(1.0).state, compass.health(1.0).text) == (DeviceState.RUNNING, "")
    assert compass.health(4.0).state is DeviceState.SILENT


def test_vhw_and_sentences_of_other_devices_are_ignored(deliver, compass):
    assert deliver(compass, "SDVHW,67.5,T,66.6,M,5.3,N,9.8,K", "GPGSV,1,1,00", "GPRMC,nonsense") == ()
    assert compass.health(1.0).rejected == 0


def test_heading_out_of_range_is_rejected_and_reported(deliver, compass):
    assert deliver(compass, "HEHDT,400,T") == ()
    health = compass.health(1.0)
    assert (health.accepted, health.rejected) == (0, 1)
    assert health.text == "HEHDT: heading_true_deg 400 out of range"


def test_missing_checksum_is_rejected_unless_the_option_allows_it(line, deliver, compass):
    assert deliver(compass, b"$HEHDT,341.8,T\r\n$PXYZ,1\r\n") == ()
    assert compass.health(1.0).rejected == 1
    assert "require_checksum = false" in compass.health(1.0).text
    lenient = NmeaCompass(line, NmeaCompassOptions(require_checksum=False))
    # Truncated sentences without a checksum must not give a heading.
    truncated = b"$GPHDT,27\r\n$GPHDT,274.07,\r\n$HEHDT,341.9,T*21\r\n$HCHDG,98.3,0.0,E,12\r\n"
    assert headings(deliver(lenient, b"$HEHDT,341.8,T\r\n" + truncated)) == [(341.8, "TRUE")]
    assert lenient.health(1.0).rejected == 4


def test_rare_true_headings_do_not_suppress_magnetic_ones(deliver, compass):
    """Otherwise the heading would be valid for one second in three."""
    for tenths in range(300):
        bodies = ("HCHDM,8,M", "HCHDT,20,T") if tenths % 30 == 0 else ("HCHDM,8,M",)
        references = [reference for _, reference in headings(deliver(compass, *bodies, now_s=tenths / 10))]
        assert references == ["MAGNETIC", "TRUE"][: len(bodies)]


def test_frequent_true_headings_suppress_magnetic_ones(deliver, compass):
    counts = [len(deliver(compass, "HEHDT,10,T", "HCHDM,8,M", now_s=float(second))) for second in range(10, 14)]
    assert counts == [2, 2, 1, 1]
    assert deliver(compass, "HCHDM,8,M", now_s=15.0) == ()
    assert headings(deliver(compass, "HCHDM,8,M", now_s=15.1)) == [(8.0, "MAGNETIC")]
    assert compass.health(15.1).rejected == 0


def test_only_selected_sentences_are_used(line, deliver):
    compass = NmeaCompass(line, NmeaCompassOptions(sentences=("HDG",)))
    samples = deliver(compass, "HEHDT,10,T", "HCHDT,10,T", "HCHDG,12,,,1,E", "PASHR,1,9,T,0,0,0")
    assert headings(samples) == [(13.0, "TRUE")]
    with pytest.raises(ValueError, match="sentences: 'VHW' is not known; use one of HDG"):
        NmeaCompassOptions(sentences=("HDG", "VHW"))


def test_reopened_port_discards_the_incomplete_sentence_and_the_turn_rate(line, deliver, nmea, compass):
    deliver(compass, *["HEHDT,10,T"] * 3, "TIROT,60,A", nmea("HEHDT,20,T")[:9])
    line.unplug()
    compass.receive(1.1)
    assert (compass.fileno(), compass.health(1.1).state) == (-1, DeviceState.ABSENT)
    line.plug()
    assert deliver(compass, nmea("HEHDT,20,T")[9:], now_s=1.2) == ()
    assert compass.health(1.2).state is DeviceState.STARTING
    assert len(deliver(compass, "HCHDM,8,M", now_s=1.2)) == 1  # true headings are not preferred yet
    assert deliver(compass, "HEHDT,30,T", now_s=1.3)[0].yaw_rate_rad_s is None
