import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices.nmea_compass import NmeaCompassEmulator


def noiseless(boat, **options):
    return NmeaCompassEmulator(boat, np.random.default_rng(1), noise_deg=0.0, rate_noise_deg_s=0.0, **options)


@pytest.mark.parametrize(
    ("heading_deg", "options", "sentence"),
    [
        (110.9, {"sentence": "HDG", "declination_deg": 12.6, "variation_deg": -12.6, "deviation_deg": 0.0},
         b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n"),
        (341.8, {"talker": "HE"}, b"$HEHDT,341.8,T*21\r\n"),
        # Raw 180, magnetic 175 with 5 W, true 165 with 10 W.
        (165.0, {"sentence": "HDG", "talker": "IN", "declination_deg": -10.0, "variation_deg": -10.0,
                 "deviation_deg": -5.0}, b"$INHDG,180.0,5.0,W,10.0,W*"),
        (10.0, {"sentence": "HDM", "declination_deg": 12.6}, b"$HCHDM,357.4,M*"),
        (10.0, {"sentence": "HDG"}, b"$HCHDG,10.0,,,,*"),
        (98.3, {"resolution_deg": 0.5}, b"$HCHDT,98.5,T"),
        (98.3, {"resolution_deg": 1.0}, b"$HCHDT,98,T"),
        *[(degrees, {}, b"$HCHDT,0.0,T*") for degrees in (359.96, 360.0, -0.04, 719.99, 0.0)],
    ],
)  # fmt: skip
def test_sentence_contains_heading_and_corrections(boat, run, heading_deg, options, sentence):
    """The first three are examples of the protocol page."""
    boat.heading = math.radians(heading_deg)
    assert run(noiseless(boat, **options), 0.05)[0][1].startswith(sentence)


def test_rate_of_turn_is_in_degrees_per_minute(boat, run):
    boat.rate = math.radians(-1.5)
    assert b"$HCROT,-90.0,A*" in run(noiseless(boat, rot=True), 0.05)[0][1]


def test_sentences_are_valid_for_pynmeagps(boat, run):
    compass = NmeaCompassEmulator(boat, np.random.default_rng(3), sentence="HDG", rot=True, variation_deg=3.0)
    output = b"".join(data for _, data in run(compass, 5.0))
    lines = output.splitlines(keepends=True)
    assert len(lines) == 100
    for line in lines:
        assert NMEAReader.parse(line, validate=1).msgID in ("HDG", "ROT")


def test_sentence_is_complete_after_its_transfer(boat, run):
    compass = noiseless(boat, baud=4800, phase_s=0.02)
    times = [due_s for due_s, _ in run(compass, 1.0)]
    length = len(b"$HCHDT,98.3,T*1A\r\n")
    assert times[0] == pytest.approx(0.02 + length * 10 / 4800)
    assert np.diff(times) == pytest.approx(0.1)


def test_sentence_contains_the_heading_at_its_start(boat):
    compass = noiseless(boat, baud=4800)
    assert compass.take_output(0.0) == b""
    boat.heading = 0.0
    assert compass.take_output(compass.next_output_s()).startswith(b"$HCHDT,98.3,")


def test_noise_has_its_deviation_and_no_bias(boat, run):
    compass = NmeaCompassEmulator(boat, np.random.default_rng(5), noise_deg=0.3, resolution_deg=0.1)
    headings_deg = [float(data.split(b",")[1]) for _, data in run(compass, 200.0)]
    assert np.std(headings_deg) == pytest.approx(0.3, rel=0.1)
    assert np.mean(headings_deg) == pytest.approx(98.3, abs=0.03)
