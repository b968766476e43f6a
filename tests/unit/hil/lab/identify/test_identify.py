"""Boats that are known, found from their recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit

from hil.lab.identify import manoeuvre_file, nmea_capture, report
from hil.lab.identify.filter import ALPHA, LN_K, UNKNOWNS
from hil.lab.identify.identify import identify
from hil.lab.identify.prior import Prior
from hil.lab.identify.recording import Recording
from support.ships import MANOEUVRES, draw, record, wave_yaw

DATA = Path(__file__).parents[4] / "data"
LONG = DATA / "manoeuvre" / "yacht_avnav_20160815.csv"
TRUE = (0.12, 6.0, 8.0, 0.026)


def covered(found, true):
    """Return which of the true values lie in their 95 % intervals."""
    return {name: found.judgement.estimates[name].low <= value <= found.judgement.estimates[name].high
            for name, value in true.items()}  # fmt: skip


@pytest.mark.proof
@pytest.mark.parametrize(
    ("seed", "diffusion", "manoeuvre"), [(0, 0.0, "zigzag"), (5, 0.3, "circle"), (3, 6.0, "course")]
)
def test_a_random_boat_lies_within_three_standard_errors(seed, diffusion, manoeuvre):
    ship = draw(seed, diffusion)
    found = identify([record(ship, manoeuvre, 600.0, seed)])
    for name, true in ship.values().items():
        one = found.judgement.estimates[name]
        off = np.log(one.value / true) * one.value if name in "KT" else one.value - true
        assert abs(off) < 3.0 * one.se, (name, one)


@pytest.mark.proof
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_the_intervals_of_a_hundred_boats_hold_the_truth(manoeuvre):
    hits = []
    for seed in range(100):
        ship = draw(seed, (0.0, 0.3, 2.0, 6.0)[seed % 4])
        hits.append(covered(identify([record(ship, manoeuvre, 1200.0, seed)]), ship.values()))
    shares = {name: np.mean([hit[name] for hit in hits]) for name in hits[0]}
    assert all(share >= 0.9 for share in shares.values()), shares


def steered(yard, *, delay_rows=0, lag_s=0.0, rows=1500, step=0.1):
    """Return a boat whose rudder follows its column late."""
    from scipy.signal import lfilter  # noqa: PLC0415 - takes a second to import

    time = np.arange(rows) * step
    rudder = yard.steps(time, 0.35, 15.0, 0.2)
    late = np.concatenate((np.zeros(delay_rows), rudder))[:rows]
    if lag_s:
        keep = np.exp(-step / lag_s)
        late = lfilter([1.0 - keep], [1.0, -keep], late)
    gain, lag, cubic, offset = TRUE
    return yard.recorded(time, rudder, *yard.boat(gain, lag, cubic, offset).motion(time, late))


@pytest.mark.parametrize("late", [{"delay_rows": 20}, {"lag_s": 1.5}])
def test_a_rudder_that_is_late_is_counted_in_and_reported(yard, late):
    """K was 58 % and T 108 % too large."""
    found = identify([steered(yard, **late)])
    for name, true in zip(("K", "T"), TRUE, strict=False):
        assert found.judgement.estimates[name].value == pytest.approx(true, rel=0.04)
    assert any("dead time" in text for text in found.judgement.warnings)


def test_a_closed_loop_with_rows_of_a_second_identifies_k_and_reports_that_t_is_shorter(yard):
    """K was found and refused: a rudder that a controller moves every row, of a boat with T 0.35 s."""
    source, step = np.random.default_rng(3), 0.05
    psi = rate = rudder = 0.0
    rows = []
    for n in range(200 * 20):
        if n % 20 == 0:
            goal = 0.5 * ((n // 800) % 2)
            rudder = float(np.clip(0.35 * (goal - psi), -0.4, 0.4))
            rows.append((n * step, rudder, psi + 0.003 * source.standard_normal()))
        rate += step * (0.4 * rudder - rate) / 0.35 + 0.01 / 0.35 * np.sqrt(step) * source.standard_normal()
        psi += step * rate
    time, angle, heading = np.array(rows).T
    found = identify([Recording("loop", time, angle, heading, None, np.full(time.size, 0.8))])
    gain, lag = found.judgement.estimates["K"], found.judgement.estimates["T"]
    assert found.judgement.usable
    assert gain.verdict == "identifiable"
    assert gain.low <= 0.4 <= gain.high
    assert lag.low < 1.0
    assert "shorter than the rows" in lag.why
    assert "MDL_K " in report.as_parameters(found, "rad")


def test_a_quick_boat_is_judged_in_units_of_its_t(yard):
    time = np.arange(500) * 0.05
    boat = yard.boat(1.5, 0.3)
    rudder = yard.steps(time, 0.3, 1.5, 2.0)
    found = identify([yard.recorded(time, rudder, *boat.motion(time, rudder))])
    assert found.judgement.usable
    assert covered(found, {"K": 1.5, "T": 0.3}) == {"K": True, "T": True}


def test_noise_without_a_rudder_in_it_is_no_model():
    source, time = np.random.default_rng(1), np.arange(500) * 0.2
    heading = wave_yaw(time.size, 0.05, 4.0, source)
    found = identify([Recording("still", time, 0.3 * np.sign(np.sin(time / 9.0)), heading, None, None)])
    assert not found.judgement.usable
    assert {one.verdict for one in found.judgement.estimates.values()} == {"not identifiable"}


def test_a_rudder_of_the_other_sign_is_reported(yard):
    recording = steered(yard)
    found = identify([replace(recording, rudder_rad=-recording.rudder_rad)])
    assert found.judgement.estimates["K"].value == pytest.approx(-TRUE[0], rel=0.05)
    assert any("K is negative" in text for text in found.judgement.warnings)


def test_the_model_from_a_yaw_rate_alone(yard):
    found = identify([replace(steered(yard), heading_rad=None)])
    assert found.judgement.estimates["K"].value == pytest.approx(TRUE[0], rel=0.05)
    assert "constant error of the yaw rate" in found.judgement.estimates["delta0"].why


def test_several_files_and_a_speed_that_changes(yard):
    """K follows the speed, T its inverse."""
    parts = []
    for speed in (0.5, 1.0):
        time = np.arange(700) * 0.2
        rudder = yard.steps(time, 0.35, 20.0, 0.2)
        boat = yard.boat(0.1 * speed, 4.0 / speed, 0.0)
        motion = boat.motion(time, rudder)
        parts.append(
            replace(yard.recorded(time, rudder, *motion), speed_m_s=np.full(time.size, speed), name=f"{speed}")
        )
    found = identify(parts)
    assert found.data.speed_m_s == pytest.approx(0.75)
    assert found.judgement.estimates["K"].value == pytest.approx(0.075, rel=0.05)
    assert found.judgement.estimates["T"].value == pytest.approx(4.0 / 0.75, rel=0.1)


def test_a_yacht_is_predicted_from_another_part_of_its_log():
    whole = manoeuvre_file.read(LONG)
    found = identify([whole.rows(whole.time_s < 1000.0)], [whole.rows(whole.time_s >= 1000.0)])
    (other,) = found.validate
    assert found.judgement.usable
    assert np.degrees(other.yaw_rate_rmse_rad_s) < 0.60  # a converged fit of the yaw rates by least squares: 0.54


def test_the_prediction_of_a_higher_order_hull_equals_least_squares(yard):
    """The likelihood of one step ahead took what the model leaves out for a disturbance, and predicted worse."""
    from scipy.signal import TransferFunction, lsim  # noqa: PLC0415 - takes a second to import

    time = np.arange(1000) * 0.5
    rudder = yard.zigzag(time, 0.35, 30.0, 0.1) * np.where(time < 300.0, 1.0, 0.5)
    hull = TransferFunction([0.2 * 4.0, 0.2], [20.0 * 3.0, 23.0, 1.0])  # K (1 + T3 s) / (1 + T1 s) / (1 + T2 s)
    rate = lsim(hull, rudder, time)[1]
    heading = np.concatenate(([0.0], np.cumsum(0.25 * (rate[1:] + rate[:-1]))))
    whole = yard.recorded(time, rudder, heading, rate, noise=0.02, rate_noise=0.005)
    before = time < 300.0

    def simulated(gain, lag):
        return lsim(TransferFunction([gain], [lag, 1.0]), rudder, time)[1]

    best = curve_fit(lambda _, gain, lag: simulated(gain, lag)[before], time, rate[before], (0.1, 10.0))[0]
    smallest = np.sqrt(np.mean((simulated(*best) - rate)[~before] ** 2))
    found = identify([whole.rows(before)], [whole.rows(~before)])
    assert not found.fit.likeliest
    assert found.validate[0].yaw_rate_rmse_rad_s < 1.05 * smallest
    assert any("not a pure K-T boat" in text for text in found.judgement.warnings)


def test_a_boat_of_the_equation_keeps_the_likeliest_model(yard):
    """Averaging of rows must not count as an error of the likeliest model."""
    time = np.arange(1200) * 0.5
    rudder = yard.zigzag(time, 0.25, 35.0, 0.17)
    motion = yard.boat(0.2, 25.0, 6.0).motion(time, rudder)
    found = identify([yard.recorded(time, rudder, *motion, noise=0.1, rate_noise=0.005)])
    assert found.fit.likeliest
    assert found.judgement.estimates["K"].value == pytest.approx(0.2, rel=0.02)


def test_a_capture_of_nmea_0183_is_read():
    path = DATA / "nmea" / "gpsd_bundg_zeus_9.nmea"
    assert nmea_capture.is_one(path)
    recording = nmea_capture.read(path)
    assert np.median(np.diff(recording.time_s)) == pytest.approx(1.0, rel=0.1)  # of the rudder; headings come at 10 Hz
    assert np.max(np.abs(recording.rudder_rad)) < np.radians(40.0)
    assert not nmea_capture.is_one(LONG)
    lag = identify([recording]).judgement.estimates["T"]  # was 0.036 s from the rows of the headings
    assert 0.2 < lag.value < 3.0


def test_the_slopes_of_the_prior_are_those_of_its_cost():
    prior = Prior.of(4.0, 0.1, 0.2)
    values = prior.start(0.1, 3.0)
    values[ALPHA] = 40.0
    gradient, _ = prior.derivatives(values)
    for place in range(UNKNOWNS):
        by = 1e-6 * max(1.0, abs(values[place]))
        up, down = values.copy(), values.copy()
        up[place] += by
        down[place] -= by
        assert (prior.cost(up) - prior.cost(down)) / (2.0 * by) == pytest.approx(gradient[place], abs=1e-5), place
    assert prior.cost(values) < prior.cost(np.where(np.arange(UNKNOWNS) == LN_K, 2.0, values))
