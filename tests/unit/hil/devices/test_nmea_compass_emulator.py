import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices.nmea_compass import NmeaCompassEmulator


def quiet(boat, **options):
    return NmeaCompassEmulator(boat, np.random.default_rng(1), noise_deg=0.0, rate_noise_deg_s=0.0, **options)


def test_sentences_of_the_protocol_page(boat, run):
    boat.heading = math.radians(98.3 + 12.6)
    raw = quiet(boat, sentence="HDG", declination_deg=12.6, variation_deg=-12.6, deviation_deg=0.0)
    assert run(raw, 0.05)[0][1] == b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n"
    boat.heading = math.radians(341.8)
    assert run(quiet(boat, talker="HE"), 0.05)[0][1] == b"$HEHDT,341.8,T*21\r\n"


def test_deviation_in_the_raw_reading(boat, run):
    # The sentence of the protocol page: raw 180, magnetic 175 with 5 W, true 165 with 10 W.
    boat.heading = math.radians(165.0)
    compass = quiet(
        boat, sentence="HDG", talker="IN", declination_deg=-10.0, variation_deg=-10.0, deviation_deg=-5.0,
    )  # fmt: skip
    assert run(compass, 0.05)[0][1].startswith(b"$INHDG,180.0,5.0,W,10.0,W*")


def test_magnetic_heading_and_unknown_corrections(boat, run):
    boat.heading = math.radians(10.0)
    assert run(quiet(boat, sentence="HDM", declination_deg=12.6), 0.05)[0][1].startswith(b"$HCHDM,357.4,M*")
    assert run(quiet(boat, sentence="HDG"), 0.05)[0][1].startswith(b"$HCHDG,10.0,,,,*")


@pytest.mark.parametrize("degrees", [359.96, 360.0, -0.04, 719.99, 0.0])
def test_never_360(boat, run, degrees):
    boat.heading = math.radians(degrees)
    assert run(quiet(boat), 0.05)[0][1].startswith(b"$HCHDT,0.0,T*")


def test_rate_of_turn(boat, run):
    boat.rate = math.radians(-1.5)
    assert b"$HCROT,-90.0,A*" in run(quiet(boat, rot=True), 0.05)[0][1]


def test_sentences_are_valid_for_pynmeagps(boat, run):
    compass = NmeaCompassEmulator(boat, np.random.default_rng(3), sentence="HDG", rot=True, variation_deg=3.0)
    output = b"".join(data for _, data in run(compass, 5.0))
    lines = output.splitlines(keepends=True)
    assert len(lines) == 100
    for line in lines:
        assert NMEAReader.parse(line, validate=1).msgID in ("HDG", "ROT")


def test_transfer_time_of_a_sentence(boat, run):
    compass = quiet(boat, baud=4800, phase_s=0.02)
    times = [due_s for due_s, _ in run(compass, 1.0)]
    length = len(b"$HCHDT,98.3,T*1A\r\n")
    assert times[0] == pytest.approx(0.02 + length * 10 / 4800)
    assert np.diff(times) == pytest.approx(0.1)


def test_age_of_the_sample(boat):
    compass = quiet(boat, baud=4800)
    assert compass.take_output(0.0) == b""
    boat.heading = 0.0
    assert compass.take_output(compass.next_output_s()).startswith(b"$HCHDT,98.3,")


def test_noise_and_resolution(boat, run):
    compass = NmeaCompassEmulator(boat, np.random.default_rng(5), noise_deg=0.3, resolution_deg=0.1)
    output = [float(data.split(b",")[1]) for _, data in run(compass, 200.0)]
    assert np.std(output) == pytest.approx(0.3, rel=0.1)
    assert np.mean(output) == pytest.approx(98.3, abs=0.03)


def test_coarse_resolution(boat, run):
    assert run(quiet(boat, resolution_deg=0.5), 0.05)[0][1].startswith(b"$HCHDT,98.5,T")
    assert run(quiet(boat, resolution_deg=1.0), 0.05)[0][1].startswith(b"$HCHDT,98,T")


def test_a_seed_repeats_the_output(boat, run):
    runs = [run(NmeaCompassEmulator(boat, np.random.default_rng(seed)), 3.0) for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_invalid_options(boat):
    for options in ({"rate_hz": 0.0}, {"resolution_deg": 0.0}, {"sentence": "XYZ"}, {"baud": 0}):
        with pytest.raises(ValueError):
            quiet(boat, **options)
