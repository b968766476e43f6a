"""Scores, tables and limits of a comparison; tests/process/test_seas.py tests its runs."""

import json
import math

import numpy as np
import pytest

from firmware_py.model.kt import OCEAN_RAMBLER
from hil.__main__ import main
from hil.cli.compare import as_entries, text
from hil.lab.compare import pid
from hil.lab.compare.runs import OURS, PAPER, Row, Task, run_one
from hil.lab.compare.score import Score, Turn, mean_of, score_of, turns_of
from hil.ship import scenarios
from hil.sim import runner
from hil.sim.goals import parse_goals
from hil.sim.truth import Truth


def truth_of(error_rad, rudder_rad, goal_rad=None):
    time_s = 0.1 * np.arange(error_rad.size)
    goal = np.zeros(error_rad.size) if goal_rad is None else goal_rad
    zeros = np.zeros(error_rad.size)
    heading = goal + error_rad
    return Truth(time_s, heading, heading, zeros, rudder_rad, rudder_rad, goal, zeros, zeros, zeros)


def test_scores_use_the_steady_part():
    count = 6001
    error = np.full(count, np.radians(2.0))
    error[:2000] = np.radians(np.linspace(-60.0, 4.0, 2000))
    rudder = np.zeros(count)
    rudder[2000::2] = np.radians(0.5)
    score = score_of(truth_of(error, rudder))
    assert score.rms_deg == pytest.approx(2.0)
    assert score.mean_deg == pytest.approx(2.0)
    assert score.travel_deg_per_h == pytest.approx(0.5 * 10.0 * 3600.0, rel=1e-3)
    assert score.overshoot_deg == pytest.approx(4.0)
    assert score.near_s == pytest.approx(171.8, abs=0.2)


def test_table_shows_mean_and_largest_rms():
    scores = tuple(Score(rms_deg, 100.0, 0.0, 3.0, 40.0) for rms_deg in (1.0, 7.0))
    header, _, row = text([Row("tank", OURS, scores)]).splitlines()
    assert header.split()[:3] == ["rms", "deg", "worst"]
    assert row.removeprefix(OURS.name).split()[:3] == ["5.00", "7.00", "100"]


def test_short_goals_are_ignored():
    goal = np.where(np.arange(4101) < 1000, 0.3, 0.0)
    error = np.where(np.arange(4101) < 1000, 1.0, np.radians(1.0))
    assert score_of(truth_of(error, np.zeros(4101), goal)).rms_deg == pytest.approx(1.0)
    with pytest.raises(ValueError, match="300"):
        score_of(truth_of(np.zeros(1000), np.zeros(1000)))


def test_turn_has_settled_after_100_s_within_the_limit():
    error = np.full(6001, np.radians(4.0))
    error[:300] = np.radians(-60.0)
    error[900] = np.radians(9.0)  # after 60 s within the limit, so not settled before
    error[2500] = np.radians(6.0)  # when the turn has settled
    assert turns_of(truth_of(error, np.zeros(6001))) == (Turn(pytest.approx(9.0), pytest.approx(90.1)),)
    error[::900] = np.radians(-6.0)
    assert turns_of(truth_of(error, np.zeros(6001)))[0].settled_s == math.inf
    assert turns_of(truth_of(np.zeros(6001), np.zeros(6001))) == ()


def test_unknown_disturbance_is_refused(capsys):
    assert main(["compare", "swell", "--with", "raft"]) == 2
    assert "use one of float" in capsys.readouterr().err


def test_mean_rms_is_that_over_all_runs():
    mean = mean_of([Score(3.0, 100.0, 1.0, 2.0, 20.0), Score(4.0, 300.0, -1.0, 4.0, 30.0)])
    assert mean == Score(math.sqrt(12.5), 200.0, 0.0, 3.0, 25.0)


@pytest.mark.proof
def test_tuned_pid_has_small_errors():
    goals = parse_goals("0:0,120:60,720:-30")
    result = {
        name: mean_of(
            [score_of(pid.sail(scenarios.find_scenario(name), seed, goals, 1320.0, pid.TUNED)) for seed in (921, 922)]
        )
        for name in ("tank", "sea", "coast")
    }
    assert result["tank"].rms_deg < 0.3
    assert result["sea"].rms_deg < 1.8
    assert result["sea"].travel_deg_per_h < 5000.0
    assert abs(result["sea"].mean_deg) < 0.3


@pytest.mark.proof
def test_integral_of_the_pid_is_constant_at_the_rudder_limit():
    """Otherwise the overshoot of this turn is 23 deg."""
    truth = pid.sail(scenarios.find_scenario("calm"), 1, parse_goals("0:0,30:170"), 200.0, pid.TUNED)
    assert math.degrees(np.unwrap(truth.heading_low_rad).max()) < 176.0


def test_command_prints_and_writes_its_results(tmp_path, capsys, monkeypatch):
    """Only the sea without gusts has an exact limit."""
    monkeypatch.setattr("hil.lab.compare.limit.TRAVEL_WEIGHTS", (0.1, 1.0))
    monkeypatch.setattr("hil.cli.progress.PIPE_INTERVAL_S", math.inf)
    json_path = tmp_path / "found.json"
    figures_path = tmp_path / "figures.json"
    arguments = ["compare", "sea", "gusts", "--only", "ours", "--seeds", "1", "--limit", "--json", str(json_path)]
    arguments += ["--figures", str(figures_path)]
    assert main([*arguments, "--goal", "0:60"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert OURS.name in output.out
    assert "compiled twin" in output.out
    assert output.out.count("with a receiver") == 1
    row, _ = json.loads(json_path.read_text())
    assert (row["scenario"], row["sailed_by"], len(row["seeds"])) == ("sea", "compiled twin", 1)
    assert f"{row['mean']['rms_deg']:.2f}" in output.out
    entries = json.loads(figures_path.read_text()).values()
    assert {entry["command"] for entry in entries} == {"rambler-hil compare --seeds 1 --goal 0:60"}


@pytest.mark.parametrize(
    "arguments",
    [("nowhere",), ("tank", "--seeds", "0"), ("tank", "--goal", "x"), ("tank", "--prices", "nan"), ("--json", "/no/f")],
)
def test_usage_error_is_one_line(arguments, capsys):
    assert main(["compare", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("name", ["sea", pytest.param("weak", marks=pytest.mark.proof)])
def test_limit_decreases_with_travel_and_with_a_receiver(name):
    from hil.lab.compare.limit import at_travel, limits  # noqa: PLC0415

    curves = [limits(scenarios.find_scenario(name), OCEAN_RAMBLER, receiver=receiver) for receiver in (False, True)]
    for curve in curves:
        rms = [at_travel(curve, travel) for travel in (500.0, 1000.0, 2000.0, 8000.0)]
        assert rms == sorted(rms, reverse=True)
    assert at_travel(curves[1], 1000.0) < at_travel(curves[0], 1000.0)
    if name == "sea":  # results of an independent program
        assert at_travel(curves[0], 1607.0) == pytest.approx(1.32, abs=0.02)
        assert at_travel(curves[0], 3512.0) == pytest.approx(1.19, abs=0.02)


def test_figures_of_the_documentation_contain_only_finite_means():
    score = Score(1.0, 700.0, 0.1, 2.0, math.inf)
    result = as_entries([Row("sea", OURS, (score, score))], {"commit": "abc"}, [(1.5, 1.2)])
    assert result["compare_sea_rambler_rms"] == {"value": 1.0, "unit": "deg", "note": "2 seeds", "commit": "abc"}
    assert result["compare_sea_rambler_limit_receiver"]["value"] == 1.2
    assert "compare_sea_rambler_near" not in result


def test_runs_of_a_comparison_have_no_live_display(monkeypatch):
    options_seen = []

    def run(options):
        options_seen.append(options)
        raise InterruptedError

    monkeypatch.setattr(runner, "run", run)
    task = Task(("tank",), (1,), parse_goals("0:0"), 60.0)
    with pytest.raises(InterruptedError):
        run_one(task, "tank", PAPER, 1)
    assert [options.live_display for options in options_seen] == [False]
