"""Scores, tables and limits of a comparison; its runs are tested in tests/process/test_seas.py."""

import json
import math

import numpy as np
import pytest

from firmware_py.model.kt import OCEAN_RAMBLER
from hil.__main__ import main
from hil.cli.compare import as_entries, text
from hil.lab.compare import pid
from hil.lab.compare.runs import OURS, PAPER, Row, Task, sail_one
from hil.lab.compare.score import Score, Turn, mean_of, score_of, turns_of
from hil.ship import scenarios
from hil.sim import runner
from hil.sim.goals import parse_goals
from hil.sim.truth import Truth


def truth_of(error_rad, rudder_rad, goal_rad=None):
    time_s = 0.1 * np.arange(error_rad.size)
    goal = np.zeros(error_rad.size) if goal_rad is None else goal_rad
    nothing = np.zeros(error_rad.size)
    heading = goal + error_rad
    return Truth(time_s, heading, heading, nothing, rudder_rad, rudder_rad, goal, nothing, nothing, nothing)


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


def test_the_table_shows_mean_and_largest_rms():
    scores = tuple(Score(rms_deg, 100.0, 0.0, 3.0, 40.0) for rms_deg in (1.0, 7.0))
    head, _, row = text([Row("tank", OURS, scores)]).splitlines()
    assert head.split()[:3] == ["rms", "deg", "worst"]
    assert row.removeprefix(OURS.name).split()[:3] == ["5.00", "7.00", "100"]


def test_short_goals_are_ignored():
    goal = np.where(np.arange(4101) < 1000, 0.3, 0.0)
    error = np.where(np.arange(4101) < 1000, 1.0, np.radians(1.0))
    assert score_of(truth_of(error, np.zeros(4101), goal)).rms_deg == pytest.approx(1.0)
    with pytest.raises(ValueError, match="300"):
        score_of(truth_of(np.zeros(1000), np.zeros(1000)))


def test_a_turn_is_settled_after_100_s_within_the_limit():
    error = np.full(6001, np.radians(4.0))
    error[:300] = np.radians(-60.0)
    error[900] = np.radians(9.0)  # after 60 s within the limit
    error[2500] = np.radians(6.0)  # after the turn has settled
    assert turns_of(truth_of(error, np.zeros(6001))) == (Turn(pytest.approx(9.0), pytest.approx(90.1)),)
    error[::900] = np.radians(-6.0)
    assert turns_of(truth_of(error, np.zeros(6001)))[0].settled_s == math.inf
    assert turns_of(truth_of(np.zeros(6001), np.zeros(6001))) == ()


def test_an_unknown_disturbance_is_refused(capsys):
    assert main(["compare", "swell", "--with", "raft"]) == 2
    assert "use one of float" in capsys.readouterr().err


def test_the_mean_rms_is_that_of_all_runs():
    mean = mean_of([Score(3.0, 100.0, 1.0, 2.0, 20.0), Score(4.0, 300.0, -1.0, 4.0, 30.0)])
    assert mean == Score(math.sqrt(12.5), 200.0, 0.0, 3.0, 25.0)


@pytest.mark.proof
def test_the_tuned_pid_is_a_good_reference():
    goals = parse_goals("0:0,120:60,720:-30")
    found = {
        name: mean_of(
            [score_of(pid.sail(scenarios.find_scenario(name), seed, goals, 1320.0, pid.TUNED)) for seed in (921, 922)]
        )
        for name in ("tank", "sea", "coast")
    }
    assert found["tank"].rms_deg < 0.3
    assert found["sea"].rms_deg < 1.8
    assert found["sea"].travel_deg_per_h < 5000.0
    assert abs(found["sea"].mean_deg) < 0.3


def test_the_command_prints_and_writes_its_results(tmp_path, capsys, monkeypatch):
    """The sea with gusts has no exact limit."""
    monkeypatch.setattr("hil.lab.compare.limit.TRAVEL_WEIGHTS", (0.1, 1.0))
    monkeypatch.setattr("hil.cli.progress.PIPE_INTERVAL_S", math.inf)
    file = tmp_path / "found.json"
    figures = tmp_path / "figures.json"
    words = ["compare", "sea", "gusts", "--only", "ours", "--seeds", "1", "--limit", "--json", str(file)]
    words += ["--figures", str(figures)]
    assert main([*words, "--goal", "0:60"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert OURS.name in output.out
    assert "compiled twin" in output.out
    assert output.out.count("with a receiver") == 1
    row, _ = json.loads(file.read_text())
    assert (row["scenario"], row["sailed_by"], len(row["seeds"])) == ("sea", "compiled twin", 1)
    assert f"{row['mean']['rms_deg']:.2f}" in output.out
    kept = json.loads(figures.read_text()).values()
    assert {one["command"] for one in kept} == {"rambler-hil compare --seeds 1 --goal 0:60"}


@pytest.mark.parametrize(
    "words",
    [("nowhere",), ("tank", "--seeds", "0"), ("tank", "--goal", "x"), ("tank", "--prices", "nan"), ("--json", "/no/f")],
)
def test_a_usage_error_is_one_line(words, capsys):
    assert main(["compare", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("name", ["sea", pytest.param("weak", marks=pytest.mark.proof)])
def test_the_limit_falls_with_travel_and_with_a_receiver(name):
    from hil.lab.compare.limit import at_travel, limits  # noqa: PLC0415

    curves = [limits(scenarios.find_scenario(name), OCEAN_RAMBLER, receiver=receiver) for receiver in (False, True)]
    for curve in curves:
        rms = [at_travel(curve, travel) for travel in (500.0, 1000.0, 2000.0, 8000.0)]
        assert rms == sorted(rms, reverse=True)
    assert at_travel(curves[1], 1000.0) < at_travel(curves[0], 1000.0)
    if name == "sea":  # results of an independent program
        assert at_travel(curves[0], 1607.0) == pytest.approx(1.32, abs=0.02)
        assert at_travel(curves[0], 3512.0) == pytest.approx(1.19, abs=0.02)


def test_figures_of_the_documentation_contain_finite_means_only():
    score = Score(1.0, 700.0, 0.1, 2.0, math.inf)
    found = as_entries([Row("sea", OURS, (score, score))], {"commit": "abc"}, [(1.5, 1.2)])
    assert found["compare_sea_rambler_rms"] == {"value": 1.0, "unit": "deg", "note": "2 seeds", "commit": "abc"}
    assert found["compare_sea_rambler_limit_receiver"]["value"] == 1.2
    assert "compare_sea_rambler_near" not in found


def test_runs_of_a_comparison_have_no_display_of_their_own(monkeypatch):
    seen = []

    def run(options):
        seen.append(options)
        raise InterruptedError

    monkeypatch.setattr(runner, "run", run)
    task = Task(("tank",), (1,), parse_goals("0:0"), 60.0)
    with pytest.raises(InterruptedError):
        sail_one(task, "tank", PAPER, 1)
    assert [options.live_display for options in seen] == [False]
