"""Identification of simulated boats with known parameters, and of recordings."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit

from hil.__main__ import main
from hil.lab.identify import manoeuvre_file, nmea_capture, report
from hil.lab.identify.filter import ALPHA, LN_K, UNKNOWN_COUNT
from hil.lab.identify.identify import identify
from hil.lab.identify.prior import Prior
from hil.lab.identify.recording import Recording
from support.ardupilot_log import log_bytes
from support.ships import MANOEUVRES, draw, record, wave_yaw
from support.tables import table

DATA = Path(__file__).parents[4] / "data"
YACHT_LOG = DATA / "manoeuvre" / "yacht_avnav_20160815.csv"
TRUE = (0.12, 6.0, 8.0, 0.026)


def coverage(result, true):
    """Return which of the true values are in their 95 % intervals."""
    estimates = result.judgement.estimates
    return {name: estimates[name].low <= value <= estimates[name].high for name, value in true.items()}


@pytest.mark.proof
@pytest.mark.parametrize(
    ("seed", "diffusion", "manoeuvre"), [(0, 0.0, "zigzag"), (5, 0.3, "circle"), (3, 6.0, "course")]
)
def test_errors_of_a_random_boat_are_below_three_standard_errors(seed, diffusion, manoeuvre):
    ship = draw(seed, diffusion)
    result = identify([record(ship, manoeuvre, 600.0, seed)])
    for name, true in ship.values().items():
        estimate = result.judgement.estimates[name]
        error = np.log(estimate.value / true) * estimate.value if name in "KT" else estimate.value - true
        assert abs(error) < 3.0 * estimate.se, (name, estimate)


@pytest.mark.proof
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("manoeuvre", MANOEUVRES)
def test_intervals_contain_the_true_values_of_nine_in_ten_boats(manoeuvre):
    hits = []
    for seed in range(100):
        ship = draw(seed, (0.0, 0.3, 2.0, 6.0)[seed % 4])
        hits.append(coverage(identify([record(ship, manoeuvre, 1200.0, seed)]), ship.values()))
    shares = {name: np.mean([hit[name] for hit in hits]) for name in hits[0]}
    assert all(share >= 0.9 for share in shares.values()), shares


def record_steps(simulation, delay_rows=0, lag_s=0.0):
    """Return a recording of a boat whose rudder follows the rudder column with a delay and a lag."""
    from scipy.signal import lfilter  # noqa: PLC0415 - takes a second to import

    time = np.arange(1500) * 0.1
    rudder = simulation.steps(time, 0.35, 15.0, 0.2)
    delayed = np.concatenate((np.zeros(delay_rows), rudder))[: time.size]
    if lag_s:
        keep = np.exp(-0.1 / lag_s)
        delayed = lfilter([1.0 - keep], [1.0, -keep], delayed)
    return simulation.recorded(time, rudder, *simulation.boat(*TRUE).motion(time, delayed))


@pytest.mark.parametrize("delay", [{"delay_rows": 20}, {"lag_s": 1.5}])
def test_delayed_rudder_is_estimated_and_reported(simulation, delay):
    """Without this, K was 58 % and T 108 % too large."""
    result = identify([record_steps(simulation, **delay)])
    for name, true in zip(("K", "T"), TRUE, strict=False):
        assert result.judgement.estimates[name].value == pytest.approx(true, rel=0.04)
    assert any("dead time" in text for text in result.judgement.warnings)


def test_closed_loop_with_rows_longer_than_t_identifies_k():
    """A controller moves the rudder in every row of 1 s; T is 0.35 s."""
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
    result = identify([Recording("loop", time, angle, heading, None, np.full(time.size, 0.8))])
    gain, lag = result.judgement.estimates["K"], result.judgement.estimates["T"]
    assert result.judgement.is_usable
    assert gain.verdict == "identifiable"
    assert gain.low <= 0.4 <= gain.high
    assert lag.low < 1.0
    assert "shorter than the rows" in lag.reason
    assert "MDL_K " in report.as_parameters(result, "rad")


def test_boat_with_short_t_is_identified(simulation):
    time = np.arange(500) * 0.05
    boat = simulation.boat(1.5, 0.3)
    rudder = simulation.steps(time, 0.3, 1.5, 2.0)
    result = identify([simulation.recorded(time, rudder, *boat.motion(time, rudder))])
    assert result.judgement.is_usable
    assert coverage(result, {"K": 1.5, "T": 0.3}) == {"K": True, "T": True}


def test_motion_without_rudder_effect_gives_no_model():
    source, time = np.random.default_rng(1), np.arange(500) * 0.2
    heading = wave_yaw(time.size, 0.05, 4.0, source)
    result = identify([Recording("still", time, 0.3 * np.sign(np.sin(time / 9.0)), heading, None, None)])
    assert not result.judgement.is_usable
    assert {estimate.verdict for estimate in result.judgement.estimates.values()} == {"not identifiable"}


def test_negative_k_is_reported(simulation):
    recording = record_steps(simulation)
    result = identify([replace(recording, rudder_rad=-recording.rudder_rad)])
    assert result.judgement.estimates["K"].value == pytest.approx(-TRUE[0], rel=0.05)
    assert any("K is negative" in text for text in result.judgement.warnings)


def test_model_is_identified_from_the_yaw_rate_alone(simulation):
    result = identify([replace(record_steps(simulation), heading_rad=None)])
    assert result.judgement.estimates["K"].value == pytest.approx(TRUE[0], rel=0.05)
    assert "constant error of the yaw rate" in result.judgement.estimates["delta0"].reason


def test_k_of_several_files_is_proportional_to_the_speed_and_t_to_its_inverse(simulation):
    recordings = []
    for speed in (0.5, 1.0):
        time = np.arange(700) * 0.2
        rudder = simulation.steps(time, 0.35, 20.0, 0.2)
        boat = simulation.boat(0.1 * speed, 4.0 / speed, 0.0)
        motion = boat.motion(time, rudder)
        recording = simulation.recorded(time, rudder, *motion)
        recordings.append(replace(recording, speed_m_s=np.full(time.size, speed), name=f"{speed}"))
    result = identify(recordings)
    assert result.data.speed_m_s == pytest.approx(0.75)
    assert result.judgement.estimates["K"].value == pytest.approx(0.075, rel=0.05)
    assert result.judgement.estimates["T"].value == pytest.approx(4.0 / 0.75, rel=0.1)


def test_model_of_a_yacht_predicts_another_part_of_its_log():
    whole = manoeuvre_file.read(YACHT_LOG)
    result = identify([whole.rows(whole.time_s < 1000.0)], [whole.rows(whole.time_s >= 1000.0)])
    (errors,) = result.validate
    assert result.judgement.is_usable
    assert np.degrees(errors.yaw_rate_rmse_rad_s) < 0.60  # least squares of the yaw rates: 0.54


def test_prediction_of_a_higher_order_hull_is_as_good_as_least_squares(simulation):
    """The likeliest model predicts this hull worse, because it treats the model error as a disturbance."""
    from scipy.signal import TransferFunction, lsim  # noqa: PLC0415 - takes a second to import

    time = np.arange(1000) * 0.5
    rudder = simulation.zigzag(time, 0.35, 30.0, 0.1) * np.where(time < 300.0, 1.0, 0.5)
    hull = TransferFunction([0.2 * 4.0, 0.2], [20.0 * 3.0, 23.0, 1.0])  # K (1 + T3 s) / (1 + T1 s) / (1 + T2 s)
    rate = lsim(hull, rudder, time)[1]
    heading = np.concatenate(([0.0], np.cumsum(0.25 * (rate[1:] + rate[:-1]))))
    whole = simulation.recorded(time, rudder, heading, rate, noise=0.02, rate_noise=0.005)
    is_first_part = time < 300.0

    def simulate(gain, lag):
        return lsim(TransferFunction([gain], [lag, 1.0]), rudder, time)[1]

    best = curve_fit(lambda _, gain, lag: simulate(gain, lag)[is_first_part], time, rate[is_first_part], (0.1, 10.0))[0]
    smallest = np.sqrt(np.mean((simulate(*best) - rate)[~is_first_part] ** 2))
    result = identify([whole.rows(is_first_part)], [whole.rows(~is_first_part)])
    assert not result.fit.is_likeliest
    assert result.validate[0].yaw_rate_rmse_rad_s < 1.05 * smallest
    assert any("not a pure K-T boat" in text for text in result.judgement.warnings)


def test_likeliest_model_is_kept_for_a_pure_k_t_boat(simulation):
    """The averaging of rows must not count as a model error."""
    time = np.arange(1200) * 0.5
    rudder = simulation.zigzag(time, 0.25, 35.0, 0.17)
    motion = simulation.boat(0.2, 25.0, 6.0).motion(time, rudder)
    result = identify([simulation.recorded(time, rudder, *motion, noise=0.1, rate_noise=0.005)])
    assert result.fit.is_likeliest
    assert result.judgement.estimates["K"].value == pytest.approx(0.2, rel=0.02)


def test_nmea_capture_is_read():
    path = DATA / "nmea" / "gpsd_bundg_zeus_9.nmea"
    assert nmea_capture.is_capture(path)
    recording = nmea_capture.read(path)
    # Interval of the rudder; that of the headings is 0.1 s.
    assert np.median(np.diff(recording.time_s)) == pytest.approx(1.0, rel=0.1)
    assert np.degrees(recording.rudder_rad[:2]).tolist() == pytest.approx([-4.2, -4.1])
    assert np.degrees(recording.heading_rad[0]) == pytest.approx(233.1)
    assert not nmea_capture.is_capture(YACHT_LOG)
    lag = identify([recording]).judgement.estimates["T"]  # with the rows of the headings it was 0.036 s
    assert 0.2 < lag.value < 3.0


def test_gradient_of_the_prior_equals_finite_differences():
    prior = Prior.of(4.0, 0.1, 0.2)
    values = prior.start(0.1, 3.0)
    values[ALPHA] = 40.0
    gradient, _ = prior.derivatives(values)
    for index in range(UNKNOWN_COUNT):
        change = 1e-6 * max(1.0, abs(values[index]))
        up, down = values.copy(), values.copy()
        up[index] += change
        down[index] -= change
        assert (prior.cost(up) - prior.cost(down)) / (2.0 * change) == pytest.approx(gradient[index], abs=1e-5), index
    assert prior.cost(values) < prior.cost(np.where(np.arange(UNKNOWN_COUNT) == LN_K, 2.0, values))


def repeat_values(values, rows):
    return np.repeat(values[::rows], rows)[: values.size]


@pytest.mark.parametrize(
    ("rows", "has_yaw_rate"),
    [(20, False), pytest.param(20, True, marks=pytest.mark.proof), pytest.param(2, True, marks=pytest.mark.proof)],
)
def test_repeated_values_of_a_slow_sensor_do_not_bias_t(simulation, read_table, rows, has_yaw_rate):
    """With the repeated values, T was 6.9 +- 0.6 s instead of 5."""
    time = np.arange(6000) * 0.05
    rudder = simulation.steps(time, 0.35, 15.0, 0.2)
    motion = simulation.boat(0.1, 5.0, 50.0, 0.02).motion(time, rudder)
    sensors = simulation.recorded(time, rudder, *motion)
    heading_deg = np.degrees(sensors.heading_rad) % 360.0
    header, columns = "time_s,rudder_deg,heading_deg", [time, np.degrees(rudder)]
    columns.append(np.round(repeat_values(heading_deg, rows), 1))
    if has_yaw_rate:
        header += ",yaw_rate_deg_s"
        columns.append(repeat_values(np.degrees(sensors.yaw_rate_rad_s), rows))
    recording = read_table(table(header, columns))
    assert any(f"heading_deg changes in every {rows}th row only" in note for note in recording.notes)
    assert np.median(np.diff(recording.time_s)) == pytest.approx(0.05 * rows)
    estimates = identify([recording]).judgement.estimates
    for estimate, true in ((estimates["K"], 0.1), (estimates["T"], 5.0)):
        assert estimate.verdict == "identifiable"
        assert abs(estimate.value - true) < 3.0 * estimate.se


@pytest.mark.parametrize("has_pulses", [pytest.param(True, marks=pytest.mark.proof), False])
def test_model_is_identified_from_an_ardupilot_log(simulation, tmp_path, capsys, has_pulses):
    time = np.arange(3000) * 0.1
    rudder = simulation.zigzag(time, 0.35, 20.0)
    motion = simulation.boat(0.049, 4.0, 17.0).motion(time, rudder)
    path = tmp_path / "00000012.BIN"
    path.write_bytes(ardupilot_log(simulation.recorded(time, rudder, *motion), pulses=has_pulses))
    assert main(["identify", str(path), "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    for name, true in (("K", 0.049), ("T", 4.0)):
        assert data[name]["verdict"] == "identifiable"
        assert abs(data[name]["value"] - true) < max(4.0 * data[name]["se"], 0.01 * true)
    assert data["speed_m_s"] == pytest.approx(0.4, rel=1e-3)
    for text in ("the output of SERVO2" if has_pulses else "STER.SteerOut", "45 deg"):
        assert any(text in note for note in data["notes"])


def ardupilot_log(recording, *, pulses):
    columns = (recording.time_s, recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s)
    return log_bytes(*columns, pulses=pulses)


def test_ardupilot_log_without_a_rudder_is_refused(simulation, tmp_path, capsys):
    time = np.arange(100) * 0.1
    data = ardupilot_log(simulation.recorded(time, 0.1 * time, time, time), pulses=False)
    path = tmp_path / "x.BIN"
    path.write_bytes(data.replace(b"STER", b"STIR"))
    assert main(["identify", str(path)]) == 2
    assert "no rudder: neither" in capsys.readouterr().err
