import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices.emulator import METRES_PER_DEGREE
from hil.devices.nmea_gps import Gaps, NmeaGpsEmulator
from hil.devices.nmea_text import format_clock_and_date, format_coordinate


def noiseless(boat, **options):
    return NmeaGpsEmulator(boat, np.random.default_rng(1), position_noise_m=0.0, velocity_noise_m_s=0.0, **options)


def parse(output):
    """Parse the sentences with an independent library."""
    lines = b"".join(data for _, data in output).splitlines(keepends=True)
    return [NMEAReader.parse(line, validate=1) for line in lines]


def parse_kind(output, kind):
    return [message for message in parse(output) if message.msgID == kind]


def test_sentences_with_a_fix_contain_the_motion(boat, run):
    boat.course, boat.speed = math.radians(123.45), 0.9
    rmc, gga, vtg = parse(run(noiseless(boat), 0.9))
    assert (rmc.status, rmc.lat, rmc.lon) == ("A", pytest.approx(35.5, abs=1e-6), pytest.approx(-120.25, abs=1e-6))
    assert rmc.spd == pytest.approx(0.9 * 3600 / 1852, abs=1e-3)
    assert rmc.cog == pytest.approx(123.45, abs=0.01)
    assert (rmc.date.isoformat(), rmc.time.isoformat()) == ("2023-11-14", "22:13:20")
    assert (gga.quality, gga.lat, gga.lon) == (1, rmc.lat, rmc.lon)
    assert (vtg.cogt, vtg.sogk) == (rmc.cog, pytest.approx(3.24, abs=1e-3))


def test_sentences_without_a_fix_contain_only_the_time(boat, run):
    receiver = noiseless(boat)
    receiver.fix = False
    rmc, gga, vtg = parse(run(receiver, 0.9))
    assert (rmc.status, rmc.lat, rmc.lon, rmc.spd, rmc.cog) == ("V", "", "", "", "")
    assert (gga.quality, gga.lat, vtg.cogt) == (0, "", "")
    assert rmc.time.isoformat() == "22:13:20"


def test_time_without_a_fix_does_not_change_the_noise(boat, run):
    steady, interrupted = (NmeaGpsEmulator(boat, np.random.default_rng(4)) for _ in range(2))
    interrupted.fix = False
    run(steady, 5.5)
    run(interrupted, 5.5)
    interrupted.fix = True
    assert run(steady, 6.5) == run(interrupted, 6.5)


def test_position_noise_has_its_deviation_and_is_correlated(boat, run):
    receiver = NmeaGpsEmulator(boat, np.random.default_rng(2), position_noise_m=2.0, rate_hz=1.0)
    north_m = [(gga.lat - 35.5) * METRES_PER_DEGREE for gga in parse_kind(run(receiver, 1000.0), "GGA")]
    assert np.std(north_m) == pytest.approx(2.0, rel=0.5)
    assert np.std(np.diff(north_m)) < 0.6


def test_output_time_is_latency_plus_transfer(boat, run):
    (due_s, data), *_ = run(noiseless(boat, phase_s=0.25, latency_s=0.1, baud=9600), 1.0)
    assert due_s == pytest.approx(0.35 + len(data) * 10 / 9600)


def test_latency_longer_than_the_period_keeps_the_rate(boat, run):
    output = run(noiseless(boat, latency_s=1.5), 6.0)
    assert len(output) == 5
    for epoch_s, (due_s, data) in enumerate(output):
        assert due_s == pytest.approx(epoch_s + 1.5 + len(data) * 10 / 9600)


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(35.5, "3530.00000,N"), (-35.99999999999, "3600.00000,S"), (0.0, "0000.00000,N"), (1 / 60, "0001.00000,N")],
)
def test_coordinate_never_has_60_minutes(angle_deg, text):
    assert format_coordinate(angle_deg, degree_digits=2, letters=("N", "S")) == text


@pytest.mark.parametrize(
    ("utc_s", "texts"), [(1_704_067_199.999, ("000000.00", "010124")), (1_704_067_199.98, ("235959.98", "311223"))]
)
def test_time_and_date_are_rounded_together(utc_s, texts):
    assert format_clock_and_date(utc_s) == texts


def test_longitude_at_the_date_line_is_wrapped(boat, run):
    boat.longitude = 180.0
    assert parse(run(noiseless(boat), 0.9))[0].lon == pytest.approx(-180.0)


def test_velocity_filter_is_of_first_order(boat, run):
    boat.speed, boat.course = 1.0, 0.0
    receiver = noiseless(boat, velocity_filter_s=2.0)
    run(receiver, 3.95)
    boat.speed, boat.course = 1.0, math.pi / 2
    sentences = parse_kind(run(receiver, 8.0), "VTG")
    assert len(sentences) == 4
    # At the first epoch, 4 s, the filter has had one sample of the new course.
    for number, vtg in enumerate(sentences):
        east = 1.0 - math.exp(-(number * 10 + 1) * 0.1 / 2.0)
        assert vtg.sogk / 3.6 == pytest.approx(math.hypot(1.0 - east, east), abs=1e-3)
        assert vtg.cogt == pytest.approx(math.degrees(math.atan2(east, 1.0 - east)), abs=0.02)


def test_gaps_have_their_share_and_length():
    gaps = Gaps(0.3, 10.0, np.random.default_rng(5))
    fixed = np.array([not gaps.is_gap(float(t_s)) for t_s in range(100_000)])
    assert 1.0 - np.mean(fixed) == pytest.approx(0.3, abs=0.02)
    # A gap between two samples is not counted.
    assert np.sum(np.diff(fixed.astype(int)) < 0) == pytest.approx(0.3 * 100_000.0 / 10.0, rel=0.1)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_gaps_of_share_0_or_1_never_change(share):
    gaps = Gaps(share, 10.0, np.random.default_rng(1))
    assert {gaps.is_gap(t_s) for t_s in (0.0, 1.0, 1e6)} == {share == 1.0}


def test_gaps_do_not_change_the_noise(boat, run):
    all_gaps = (None, Gaps(0.3, 10.0, np.random.default_rng(5)))
    receivers = [NmeaGpsEmulator(boat, np.random.default_rng(4), gaps=gaps) for gaps in all_gaps]
    without, with_gaps = (parse_kind(run(receiver, 100.0), "RMC") for receiver in receivers)
    assert {rmc.status for rmc in with_gaps} == {"A", "V"}
    assert all(b.lat == a.lat for a, b in zip(without, with_gaps, strict=True) if b.status == "A")
