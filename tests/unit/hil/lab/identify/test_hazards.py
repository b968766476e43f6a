"""Logs that once gave a wrong model with a good verdict: each is refused, or right."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from firmware_py.common.parameters import parse_file
from hil.__main__ import main
from hil.errors import UsageError
from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.identify.predict import Start
from hil.lab.identify.recording import Recording, Source
from hil.lab.identify.refine import refine
from hil.lab.identify.stretch import Timing
from hil.lab.identify.suggest import suggest
from hil.lab.identify.verdict import LARGEST_ERROR
from support.paths import DATA

LONG = DATA / "manoeuvre" / "yacht_avnav_20160815.csv"
SHORT = DATA / "manoeuvre" / "yacht_gpsd_bundg_zeus.csv"
NAMES = ("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s", "speed_m_s")


def repeated(recording, times, scatter=0.0):
    """Return a log over and over, with a little noise so that no two are the same."""
    source = np.random.default_rng(1)
    span = recording.time_s[-1] - recording.time_s[0] + float(np.median(np.diff(recording.time_s)))
    columns = {name: np.tile(getattr(recording, name), times) for name in NAMES[1:]}
    columns["yaw_rate_rad_s"] = columns["yaw_rate_rad_s"] + scatter * source.standard_normal(columns["rudder_rad"].size)
    time_s = np.concatenate([recording.time_s + number * span for number in range(times)])
    return replace(recording, time_s=time_s, **columns)


def values(found):
    return np.array([found.judgement.estimates[name].value for name in ("K", "T", "alpha", "delta0")])


@pytest.mark.parametrize("times", [pytest.param(times, marks=pytest.mark.proof) for times in (4, 10, 100)])
def test_a_log_that_stands_there_again_and_again_gives_the_answer_of_one(times):
    whole = read(LONG).part(Source(LONG, 0, 500))
    once, often = identify([whole]), identify([repeated(whole, times)])
    np.testing.assert_array_equal(values(once), values(often))
    assert once.choice == often.choice
    assert any(f"stand there {times} times; counted once" in note for note in often.data.notes)


def test_the_same_file_twice_is_counted_once():
    part = read(SHORT)
    assert np.array_equal(values(identify([part])), values(identify([part, replace(part, name="again")])))


@pytest.mark.proof
def test_a_long_log_is_not_averaged_over_its_turning_lag():
    """Averages over 4 s of a boat whose T is 1.3 s gave K of the wrong sign, and the advice to reverse the rudder."""
    found = identify([repeated(read(LONG), 4, 1e-5)], model="linear", speed="scaled")
    estimates = found.judgement.estimates
    assert estimates["K"].value == pytest.approx(0.316, rel=0.05)
    assert estimates["T"].value == pytest.approx(1.32, rel=0.1)
    assert not any("negative" in warning for warning in found.judgement.warnings)


@pytest.mark.proof
def test_a_slow_ship_sampled_fast_is_found_as_well(yard):
    """Where the finest averages show nothing but noise the coarse ones must tell."""
    time = np.arange(20_000) * 0.5
    boat = yard.boat(0.02, 200.0)
    rudder = yard.steps(time, 0.35, 600.0, 0.05)
    heading, rate = boat.motion(time, rudder)
    found = identify([yard.recorded(time, rudder, heading, rate, noise=2.0, rate_noise=0.5)], model="linear")
    assert found.judgement.estimates["K"].value == pytest.approx(0.02, rel=0.02)
    assert found.judgement.estimates["T"].value == pytest.approx(200.0, rel=0.05)


@pytest.mark.parametrize(("path", "low", "high"), [(LONG, 100, 112), (SHORT, 30, 40), (SHORT, 60, 72)])
def test_a_few_seconds_tell_no_model(path, low, high):
    judgement = identify([read(path).part(Source(path, low, high))]).judgement
    assert not judgement.usable
    assert {one.verdict for one in judgement.estimates.values()} == {"not identifiable"}


@pytest.mark.parametrize("seconds", [8.0, 12.0])
def test_a_few_seconds_of_a_clean_boat_tell_no_model_either(yard, seconds):
    time = np.arange(round(seconds * 10)) * 0.1
    boat, rudder = yard.boat(0.049, 4.0, 17.0), yard.steps(time, 0.5, 3.0, 0.5)
    judgement = identify([yard.recorded(time, rudder, *boat.motion(time, rudder))]).judgement
    assert not judgement.usable
    assert any("too short" in warning or "next to nothing" in warning for warning in judgement.warnings)


def kept_on_course(seed, drift_s, *, goal_rad=0.0, drift_rad=0.0524, integral=0.0, slew_rad_s=0.52, waves=None):
    """Return a log of a boat that a PD keeps on course while a slow disturbance pushes: K 0.049, T 4.

    waves: how far they have turned her at each row, rudder or not.
    """
    source, step, rows = np.random.default_rng(seed), 0.1, 12_000
    psi = rate = rudder = whole = 0.0
    push, keep = drift_rad * source.standard_normal(), np.exp(-step / drift_s)
    table = np.empty((rows, 4))
    yaw = np.zeros(rows) if waves is None else waves
    swing = np.gradient(yaw, step)
    for row in range(rows):
        goal = goal_rad * (1 if (row // 600) % 2 else -1)
        seen = psi + yaw[row] + 0.005 * source.standard_normal()
        turning = rate + swing[row] + 0.0017 * source.standard_normal()
        table[row] = row * step, rudder, seen, turning
        whole += integral * (goal - seen) * step
        wanted = np.clip(goal - seen - 4.0 * turning + whole, -0.52, 0.52)
        rudder += np.clip(wanted - rudder, -0.1 * slew_rad_s, 0.1 * slew_rad_s)
        push = keep * push + drift_rad * np.sqrt(1.0 - keep**2) * source.standard_normal()
        for _ in range(2):
            psi, rate = psi + 0.05 * rate, rate + 0.05 * (0.049 * (rudder - push) - rate) / 4.0
    return Recording("kept", *table.T, None)


@pytest.mark.parametrize(
    ("seed", "drift_s", "integral", "channels"),
    [
        (1, 100.0, 0.0, "h"),
        pytest.param(9, 1000.0, 0.01, "hr", marks=pytest.mark.proof),
        pytest.param(2, 300.0, 0.0, "hr", marks=pytest.mark.proof),
        pytest.param(9, 1000.0, 0.01, "h", marks=pytest.mark.proof),
    ],
)
def test_a_log_kept_on_course_is_refused(seed, drift_s, integral, channels):
    recording = kept_on_course(seed, drift_s, integral=integral)
    if channels == "h":
        recording = replace(recording, yaw_rate_rad_s=None)
    found = identify([recording])
    assert not found.judgement.usable
    assert found.loop.answered > 0.0
    data = json.loads(report.as_json(found, 0.0, suggest(found.fit, found.judgement)))
    assert data["closed_loop"]
    assert data["K"]["verdict"] == "not identifiable"
    assert "closed loop" in report.as_text(found, None)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("channels", "sign"),
    [
        ("h", -1.0),
        pytest.param("hr", 1.0, marks=pytest.mark.proof),
        pytest.param("h", 1.0, marks=pytest.mark.proof),
        pytest.param("hr", -1.0, marks=pytest.mark.proof),
    ],
)
def test_a_log_kept_on_course_in_waves_does_not_give_the_helm_for_the_boat(yard, channels, sign):
    """A rudder that answers the waves within a sample looks like a boat without T that turns against it."""
    waves = yard.wave_yaw(12_000, 0.1, 0.026, 5.0, np.random.default_rng(1))
    recording = kept_on_course(3, 40.0, drift_rad=0.0175, waves=waves).rows(slice(None, None, 5))
    recording = replace(recording, rudder_rad=sign * recording.rudder_rad)
    if channels == "h":
        recording = replace(recording, yaw_rate_rad_s=None)
    found = identify([recording])
    assert not found.judgement.usable
    assert found.loop.explained > 0.25
    assert not any("RUD_REVERSE" in warning for warning in found.judgement.warnings)


def test_one_circle_alone_tells_no_model(yard):
    """K, alpha and the offset stand for each other there: the fit ends nowhere, and its errors say nothing."""
    time = np.arange(1800) * 0.5
    rudder = np.minimum(0.52 * time, 0.436)
    heading, rate = yard.boat(0.08, 6.0, 30.0, 0.035).motion(time, rudder)
    judgement = identify([yard.recorded(time, rudder, heading, rate, rate_noise=0.0)]).judgement
    assert not judgement.usable
    assert {judgement.estimates[name].verdict for name in ("K", "alpha", "delta0")} == {"not identifiable"}


@pytest.mark.parametrize(("rows", "leg"), [(800, 40.0), (1600, 40.0)])
def test_a_clean_manoeuvre_that_the_equation_hardly_fits_tells_the_ratio(yard, rows, leg):
    """Of a ship of second order what is left is few readings' worth: it was refused, all but explained as it was."""
    time = np.arange(rows) * 0.1
    rudder = yard.zigzag(time, 0.35, leg, 0.1)
    top, bottom, _ = cont2discrete(([0.1], [80.0, 18.0, 1.0]), 0.1, "foh")
    rate = lfilter(top.ravel(), bottom, rudder)
    heading = np.concatenate(([0.0], np.cumsum(0.05 * (rate[1:] + rate[:-1]))))
    found = identify([yard.recorded(time, rudder, heading, rate, noise=0.02, rate_noise=0.002)])
    assert found.fit.effective_rows < 30.0
    assert {found.judgement.estimates[name].verdict for name in "KT"} == {"only the ratio K/T is identifiable"}
    assert abs(found.judgement.ratio.value - 0.1 / 18.0) < 2.5 * found.judgement.ratio.se


def test_an_autopilot_that_changes_course_tells_the_boat_and_is_told():
    found = identify([kept_on_course(6, 100.0, goal_rad=0.52)])
    gain = found.judgement.estimates["K"]
    assert gain.verdict == "identifiable"
    assert abs(gain.value - 0.049) < 3.0 * gain.se
    assert found.loop.explained > 0.9
    assert any("the rudder answers what it does not explain" in text for text in found.judgement.warnings)


@pytest.mark.proof
def test_an_autopilot_s_rudder_is_not_taken_to_stand_still_between_rows(yard):
    """What pushed her since the last row has moved the rudder by this one: as if it had waited; T a seventh less."""
    waves = yard.wave_yaw(12_000, 0.1, 0.026, 6.0, np.random.default_rng(2))
    recording = kept_on_course(2, 100.0, goal_rad=0.52, slew_rad_s=0.2, waves=waves).rows(slice(None, None, 10))
    found = identify([replace(recording, yaw_rate_rad_s=None)])
    assert found.choice.timing.timing is Timing.RAMP
    assert abs(found.judgement.estimates["T"].value / 4.0 - 1.0) < 0.05


@pytest.mark.proof
def test_a_plan_sailed_in_waves_is_no_closed_loop(yard):
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, 0.35, 40.0)
    heading, rate = yard.boat(0.049, 4.0, 17.0).motion(time, rudder)
    wave = yard.wave_yaw(time.size, 0.1, np.radians(4.0), 2.53, np.random.default_rng(0))
    found = identify([yard.recorded(time, rudder, heading + wave, rate + np.gradient(wave, time))])
    assert found.loop.answered == 0.0
    assert found.judgement.estimates["K"].verdict == "identifiable"


def written(path, recording, header, units, speed="0.4"):
    columns = [recording.time_s, recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s]
    rows = zip(*(column / unit for column, unit in zip(columns, units, strict=True)), strict=True)
    lines = [",".join(f"{value:.6f}" for value in row) + f",{speed}" for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")


@pytest.fixture(scope="module")
def zigzag(yard):
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, 0.35, 20.0)
    return yard.recorded(time, rudder, *yard.boat(0.049, 4.0, 17.0).motion(time, rudder), noise=0.1, rate_noise=0.03)


DEGREE = np.pi / 180.0


@pytest.mark.parametrize(
    ("heading", "speed"), [("wrapped at 360", "0.4"), ("on a course of 40", "0.4"), ("unwrapped", "")]
)
def test_a_table_all_in_degrees_is_right_or_refused(tmp_path, capsys, zigzag, heading, speed):
    """Taken with the rudder alone in degrees, K was 57 times too large."""
    path, out = tmp_path / "degrees.csv", tmp_path / "x.param"
    turned = zigzag.heading_rad + (40.0 * DEGREE if "course" in heading else 0.0)
    turned = (
        np.mod(turned, 2.0 * np.pi) if "wrapped" in heading else turned + np.linspace(0, 20, 6000) * ("un" in heading)
    )
    rate = zigzag.yaw_rate_rad_s + (20.0 / 600.0 if heading == "unwrapped" else 0.0)
    recording = replace(zigzag, heading_rad=turned, yaw_rate_rad_s=rate)
    written(path, recording, ",".join(NAMES), (1.0, DEGREE, DEGREE, DEGREE), speed)
    assert main(["identify", str(path)]) == 2
    assert "--rudder-unit deg" in capsys.readouterr().err
    code = main(["identify", str(path), "--rudder-unit", "deg", "--json", "-", "--out-params", str(out)])
    said = capsys.readouterr()
    assert code in (0, 2)
    if code == 2:
        assert "heading_deg" in said.err
        assert not out.exists()
    else:
        assert json.loads(said.out)["K"]["value"] == pytest.approx(0.049, rel=0.05)


def test_a_table_that_says_its_units_is_read_as_it_says(tmp_path, zigzag):
    path = tmp_path / "named.csv"
    written(path, zigzag, "time_s,rudder_deg,heading_deg,yaw_rate_deg_s,speed_m_s", (1.0, DEGREE, DEGREE, DEGREE))
    got = read(path)
    np.testing.assert_allclose(got.heading_rad, zigzag.heading_rad, atol=1e-6)
    np.testing.assert_allclose(got.yaw_rate_rad_s, zigzag.yaw_rate_rad_s, atol=1e-6)
    np.testing.assert_allclose(got.rudder_rad, zigzag.rudder_rad, atol=1e-6)


def test_a_k_beyond_any_ship_of_that_speed_is_refused(yard):
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, 0.35, 20.0)
    heading, rate = yard.boat(0.049 / DEGREE, 4.0).motion(time, rudder)
    recording = replace(yard.recorded(time, rudder, heading, rate), speed_m_s=np.full(time.size, 0.4))
    with pytest.raises(UsageError, match="beyond any ship of"):
        identify([recording])


def test_of_a_lag_longer_than_the_log_nothing_but_that_is_claimed(yard):
    """A tanker that hardly runs straight, 66 s of her zigzag: T was 55 h, known to 9 %, and K no ship's, so refused."""
    time = np.arange(660) * 0.1
    rudder = yard.zigzag(time, 0.35, 16.0)
    boat = yard.boat(0.014 * 1e4, 1e4, 40.0 * 1e4)
    heading, rate = boat.motion(time, rudder)
    recording = replace(yard.recorded(time, rudder, heading, rate), speed_m_s=np.full(time.size, 1.1))
    found = identify([recording], model="cubic")
    estimates = found.judgement.estimates
    assert estimates["T"].value > 66.0
    assert all(estimates[name].se == LARGEST_ERROR for name in ("K", "T", "alpha"))
    assert estimates["K"].verdict == "only the ratio K/T is identifiable"
    assert found.judgement.ratio.value == pytest.approx(0.014, rel=0.1)
    assert "longer than the log" in suggest(found.fit, found.judgement).text


def test_what_is_printed_is_what_is_validated_and_written(tmp_path, capsys):
    """The yacht's printed K and T once were of another model than that of the parameter file."""
    path, out = f"{LONG}:0:1000", tmp_path / "x.param"
    found = identify([read(LONG).part(Source(LONG, 0, 1000))])
    model = found.model()
    np.testing.assert_array_equal(
        values(found), [model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, model.rudder_offset_rad]
    )
    assert main(["identify", path, "--out-params", str(out), "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    written_ = dict(parse_file(out.read_text(), "x"))
    assert written_["MDL_K"] == pytest.approx(data["K"]["value"], rel=1e-4)
    assert written_["MDL_T_S"] == pytest.approx(data["T"]["value"], rel=1e-4)


def test_alpha_and_the_scaling_are_chosen_together(yard):
    """A ship that slows down in her turns, and whose K, T and alpha do not follow: alpha was judged as if they did."""
    time = np.arange(4000) * 0.1
    rudder = yard.steps(time, 0.6, 40.0, 0.5)
    heading, rate = yard.boat(0.1, 3.0, 100.0).motion(time, rudder)
    speed = 0.8 * (1.0 - 0.35 * np.minimum(np.abs(rate) / 0.05, 1.0))
    found = identify([replace(yard.recorded(time, rudder, heading, rate), speed_m_s=speed)])
    assert (found.choice.model, found.choice.scaled) == ("cubic", False)
    np.testing.assert_allclose(values(found)[:3], [0.1, 3.0, 100.0], rtol=0.01)


def test_an_initial_yaw_rate_that_was_measured_is_not_free(yard):
    """Beside a yaw rate that counts for nothing, as one full of waves, its first reading still tells the start."""
    time = np.arange(2000) * 0.1
    rudder = yard.steps(time, 0.35, 20.0, 0.5)
    heading, rate = yard.boat(0.049, 4.0).motion(time, rudder)
    found = identify([yard.recorded(time, rudder, heading, rate, noise=200.0, rate_noise=0.1)], model="linear")
    known, weights = found.fit.problem, found.fit.problem.weights
    assert weights.start == pytest.approx(1.0 / np.radians(0.1) ** 2, rel=0.2)
    begin = replace(found.fit.state, starts=(Start(0.0, 0.5),))
    alone = replace(known, free=(), weights=replace(weights, heading=1.0 / 3.5**2, yaw_rate=0.0))
    (start,) = refine(alone, begin).state.starts
    first = float(known.data.stretches[0].yaw_rate_rad_s[0])
    assert abs(start.yaw_rate_rad_s - first) < np.radians(0.02)
