"""Tests of the OS5000 driver: sentences of the manual, cuts, damage, and the driver against the emulator."""

import math

import pytest
from rambler_os5000 import DRIVER, Os5000Options, read_sentence
from rambler_os5000_emulator import sentence

from firmware_py.common.records import DeviceState, NorthReference

# The examples of the manual, revision 5.0, page 12.
FACTORY = b"$C320.5P0.2R-18.3T19.0*3C"
ALL_FIELDS = b"$C212.4P2.5R-14.0T28.4Mx107977.90My-79422.00Mz173.27Ax0.045Ay-0.245Az0.977*3A"


class Line:
    """A line whose received bytes the test sets."""

    name, baud, openings, connected = "/dev/test", 19200, 1, True

    def __init__(self):
        self.inbox = b""

    def fileno(self):
        return -1

    def read(self):
        data, self.inbox = self.inbox, b""
        return data

    def write(self, _data):
        raise AssertionError("the driver writes nothing")


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def compass(line):
    return DRIVER.make(line, Os5000Options())


def receive(line, compass, data, now_s=1.0):
    line.inbox = data
    compass.receive(now_s)
    return compass.poll()


def test_sentences_of_the_manual():
    assert read_sentence(FACTORY) == {"C": 320.5, "P": 0.2, "R": -18.3, "T": 19.0}
    assert read_sentence(ALL_FIELDS)["C"] == 212.4
    assert read_sentence(ALL_FIELDS)["Az"] == 0.977


def test_heading_is_magnetic_with_roll_pitch_and_temperature(line, compass):
    (sample,) = receive(line, compass, FACTORY + b"\r\n")
    assert sample.heading_rad == pytest.approx(math.radians(320.5))
    assert (sample.reference, sample.t_s, sample.temperature_c) == (NorthReference.MAGNETIC, 1.0, 19.0)
    assert math.degrees(sample.roll_rad) == pytest.approx(-18.3)
    assert math.degrees(sample.pitch_rad) == pytest.approx(0.2)
    assert compass.health(1.0).state is DeviceState.RUNNING


def test_sentence_may_arrive_byte_by_byte(line, compass):
    samples = [sample for byte in FACTORY + b"\n" for sample in receive(line, compass, bytes([byte]))]
    assert len(samples) == 1


def test_one_damaged_byte_never_gives_a_wrong_heading():
    for position in range(len(FACTORY)):
        for change in (1, 2, 4, 8, 16, 32, 64, 128):
            damaged = bytearray(FACTORY)
            damaged[position] ^= change
            with pytest.raises(ValueError, match=r"checksum|format|number|range"):
                read_sentence(bytes(damaged))


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("C360.1P0.0R0.0T20.0", "C 360.1 is out of range"),
        ("C10.0P90.1", "P 90.1 is out of range"),
        ("C10.0R-180.1", "R -180.1 is out of range"),
        ("C10.0T121.0", "T 121 is out of range"),
        ("C1e3", "a field is not a number"),
        ("Cnan", "a field is not a number"),
    ],
)
def test_impossible_sentence_is_refused_with_its_reason(body, reason):
    with pytest.raises(ValueError, match=reason):
        read_sentence(sentence(body).rstrip())


def test_heading_of_360_degrees_is_north(line, compass):
    (sample,) = receive(line, compass, sentence("C360.0"))
    assert sample.heading_rad == 0.0


def test_other_bytes_give_no_sample_and_a_text(line, compass):
    assert receive(line, compass, b"\xff" * 5000 + b"\n" + sentence("P1.0")) == []
    health = compass.health(1.0)
    assert (health.state, health.accepted) == (DeviceState.STARTING, 0)
    assert len(receive(line, compass, b"\xff\n" + FACTORY + b"\n", 2.0)) == 1


def test_roll_sign(line):
    (sample,) = receive(line, DRIVER.make(line, Os5000Options(roll_sign=-1)), FACTORY + b"\n")
    assert math.degrees(sample.roll_rad) == pytest.approx(18.3)
    with pytest.raises(ValueError, match="roll_sign"):
        Os5000Options(roll_sign=0)
