import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hil.devices.emulator import METRES_PER_DEGREE
from hil.devices.nmea_gps import Gaps, NmeaGpsEmulator
from hil.devices.nmea_text import clock_and_date, coordinate


def quiet(boat, **options):
    return NmeaGpsEmulator(boat, np.random.default_rng(1), position_noise_m=0.0, velocity_noise_m_s=0.0, **options)


def parsed(output):
    lines = b"".join(data for _, data in output).splitlines(keepends=True)
    return [NMEAReader.parse(line, validate=1) for line in lines]


def test_sentences_by_an_independent_parser(boat, run):
    boat.course = math.radians(123.45)
    boat.speed = 0.9
    rmc, gga, vtg = parsed(run(quiet(boat), 0.9))
    assert (rmc.status, rmc.lat, rmc.lon) == ("A", pytest.approx(35.5, abs=1e-6), pytest.approx(-120.25, abs=1e-6))
    assert rmc.spd == pytest.approx(0.9 * 3600 / 1852, abs=1e-3)
    assert rmc.cog == pytest.approx(123.45, abs=0.01)
    assert (rmc.date.isoformat(), rmc.time.isoformat()) == ("2023-11-14", "22:13:20")
    assert (gga.quality, gga.lat, gga.lon) == (1, rmc.lat, rmc.lon)
    assert (vtg.cogt, vtg.sogk) == (rmc.cog, pytest.approx(3.24, abs=1e-3))


def test_fields_without_a_fix(boat, run):
    receiver = quiet(boat)
    receiver.fix = False
    rmc, gga, vtg = parsed(run(receiver, 0.9))
    assert (rmc.status, rmc.lat, rmc.lon, rmc.spd, rmc.cog) == ("V", "", "", "", "")
    assert (gga.quality, gga.lat) == (0, "")
    assert vtg.cogt == ""
    assert rmc.time.isoformat() == "22:13:20"


def test_a_lost_fix_does_not_change_the_noise(boat, run):
    steady, broken = (NmeaGpsEmulator(boat, np.random.default_rng(4)) for _ in range(2))
    broken.fix = False
    run(steady, 5.5)
    run(broken, 5.5)
    broken.fix = True
    assert run(steady, 6.5) == run(broken, 6.5)


def test_position_noise(boat, run):
    receiver = NmeaGpsEmulator(boat, np.random.default_rng(2), position_noise_m=2.0, rate_hz=1.0)
    north_m = [(m.lat - 35.5) * METRES_PER_DEGREE for m in parsed(run(receiver, 1000.0)) if m.msgID == "GGA"]
    assert np.std(north_m) == pytest.approx(2.0, rel=0.5)
    assert np.std(np.diff(north_m)) < 0.6


def test_latency_and_transfer(boat, run):
    (due_s, data), *_ = run(quiet(boat, phase_s=0.25, latency_s=0.1, baud=9600), 1.0)
    assert due_s == pytest.approx(0.35 + len(data) * 10 / 9600)


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(35.5, "3530.00000,N"), (-35.99999999999, "3600.00000,S"), (0.0, "0000.00000,N"), (1 / 60, "0001.00000,N")],
)
def test_minutes_are_never_60(angle_deg, text):
    assert coordinate(angle_deg, degree_digits=2, letters=("N", "S")) == text


def test_time_and_date_at_midnight():
    assert clock_and_date(1_704_067_199.999) == ("000000.00", "010124")
    assert clock_and_date(1_704_067_199.98) == ("235959.98", "311223")


def test_date_line(boat, run):
    boat.longitude = 180.0
    assert parsed(run(quiet(boat), 0.9))[0].lon == pytest.approx(-180.0)


def test_velocity_filter(boat, run):
    boat.speed, boat.course = 1.0, 0.0
    receiver = quiet(boat, velocity_filter_s=2.0)
    run(receiver, 3.95)
    boat.speed, boat.course = 1.0, math.pi / 2
    found = [m for m in parsed(run(receiver, 8.0)) if m.msgID == "VTG"]
    # The first epoch is at 4 s, when the filter has had one sample of the new way.
    for number, vtg in enumerate(found):
        gone = 1.0 - math.exp(-(number * 10 + 1) * 0.1 / 2.0)
        assert vtg.sogk / 3.6 == pytest.approx(math.hypot(1.0 - gone, gone), abs=1e-3)
        assert vtg.cogt == pytest.approx(math.degrees(math.atan2(gone, 1.0 - gone)), abs=0.02)
    assert len(found) == 4


def test_latency_longer_than_the_period(boat, run):
    output = run(quiet(boat, latency_s=1.5), 6.0)
    assert len(output) == 5
    for epoch_s, (due_s, data) in enumerate(output):
        assert due_s == pytest.approx(epoch_s + 1.5 + len(data) * 10 / 9600)


def test_share_of_gaps():
    gaps = Gaps(0.3, 10.0, np.random.default_rng(5))
    fixed = np.array([not gaps.cover(float(t_s)) for t_s in range(100_000)])
    assert 1.0 - np.mean(fixed) == pytest.approx(0.3, abs=0.02)
    # A gap that falls between two questions is not seen.
    assert np.sum(np.diff(fixed.astype(int)) < 0) == pytest.approx(0.3 * 100_000.0 / 10.0, rel=0.1)


def test_a_gap_does_not_change_the_noise(boat, run):
    whole, broken = (
        NmeaGpsEmulator(boat, np.random.default_rng(4), gaps=gaps)
        for gaps in (None, Gaps(0.3, 10.0, np.random.default_rng(5)))
    )
    complete, found = ([m for m in parsed(run(one, 100.0)) if m.msgID == "RMC"] for one in (whole, broken))
    assert {m.status for m in found} == {"A", "V"}
    assert all(b.lat == a.lat for a, b in zip(complete, found, strict=True) if b.status == "A")


def test_shares_0_and_1():
    always, never = (Gaps(share, 10.0, np.random.default_rng(1)) for share in (1.0, 0.0))
    assert all(always.cover(t_s) and not never.cover(t_s) for t_s in (0.0, 1.0, 1e6))
