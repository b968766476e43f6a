"""Search for the constants of the control law, on analytic functions and in one simulated sea."""

import json
import math

import numpy as np
import pytest

from firmware_py.control.law import DEFAULT_CONSTANTS
from hil.__main__ import main
from hil.lab.tune import law


class AnalyticTrials(law.LawTrials):
    """Two seas of one seed: rms error and travel as functions of the setting."""

    def __init__(self, rms, travel):
        self.names, self.seeds, self.price, self.seas = ("one", "two"), (1,), law.PRICE, [None, None]
        self.functions = rms, travel
        self.default_results = self.results(law.DELIVERED_SETTING)

    def results(self, setting):
        rms, travel = (function(*setting) for function in self.functions)
        return np.array([[[rms, travel]], [[2.0 * rms, 3.0 * travel]]])


def rms_with_minimum(gain_factor, *_):
    """Return an rms error with a minimum at a gain_factor of 100."""
    return 1.0 + math.log(gain_factor / 100.0) ** 2


def constant(*_):
    return 800.0


def no_progress(_text, _part):
    return None


def test_present_constants_are_those_of_the_law_and_inside_the_bounds():
    assert (
        DEFAULT_CONSTANTS.gain_factor, DEFAULT_CONSTANTS.crossover_rad_s, DEFAULT_CONSTANTS.rest_rad,
        DEFAULT_CONSTANTS.band_sqrt_s,
    ) == law.DELIVERED_SETTING  # fmt: skip
    assert all(bound.low < value < bound.high for bound, value in zip(law.BOUNDS, law.DELIVERED_SETTING, strict=True))
    assert tuple(bound.field for bound in law.BOUNDS) == DEFAULT_CONSTANTS._fields


def test_costs_are_relative_to_the_present_constants():
    trials = AnalyticTrials(lambda *_: 1.0, constant)
    results = np.array([[[1.0, 800.0]], [[2.0, 3200.0]]])
    assert trials.costs(results) == pytest.approx([1.0, (4.0 + 1.6) / (4.0 + 1.2)])
    assert trials.cost(np.full((2, 1, 2), np.nan)) == math.inf


def test_a_loss_in_one_sea_has_a_penalty():
    trials = AnalyticTrials(lambda *_: 1.0, constant)
    within = np.array([[[0.5, 800.0]], [[2.0, 2440.0]]])
    assert trials.cost(within) == np.mean(trials.costs(within))
    beyond = np.array([[[0.5, 900.0]], [[2.1, 2400.0]]])  # 1.125 of the travel, 1.05 of the error
    assert trials.cost(beyond) == pytest.approx(np.mean(trials.costs(beyond)) + 0.105 + 0.05)


def test_better_constants_are_found_and_confirmed_in_fresh_seas():
    result = law.search(
        AnalyticTrials(rms_with_minimum, constant), AnalyticTrials(rms_with_minimum, constant), 400, 1, no_progress
    )
    assert result.is_better
    assert result.setting[0] == pytest.approx(100.0, rel=0.08)
    assert result.cost == result.fresh_cost < 1.0
    assert (
        law.search(
            AnalyticTrials(rms_with_minimum, constant), AnalyticTrials(rms_with_minimum, constant), 400, 1, no_progress
        ).setting
        == result.setting
    )


@pytest.mark.parametrize("evaluations", [20, 60, 75])
def test_number_of_evaluations_is_limited(evaluations):
    result = law.search(
        AnalyticTrials(rms_with_minimum, constant),
        AnalyticTrials(rms_with_minimum, constant),
        evaluations,
        1,
        no_progress,
    )
    # Settings that are equal to three digits are simulated once.
    assert 0.9 * evaluations <= result.evaluations <= evaluations


def test_constants_that_are_not_better_in_fresh_seas_are_rejected():
    opposite_trials = AnalyticTrials(lambda gain_factor, *_: 1.0 / rms_with_minimum(gain_factor), constant)
    result = law.search(AnalyticTrials(rms_with_minimum, constant), opposite_trials, 400, 1, no_progress)
    assert (result.is_better, result.fresh_cost > 1.0) == (False, True)
    assert "the present constants are kept" in law.text(
        AnalyticTrials(rms_with_minimum, constant), opposite_trials, result
    )


@pytest.mark.timeout(600)  # the loop is compiled first
def test_command_prints_seeds_and_constants(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(law, "SECONDS", 640.0)
    monkeypatch.setattr(law, "GOALS", law.parse_goals("0:0,120:60"))
    monkeypatch.setattr(law, "SEEDS", 1)
    monkeypatch.setattr(law, "FRESH_SEEDS", 1)
    path = tmp_path / "law.json"
    arguments = ["--law", "--scenarios", "tank", "--evaluations", "20", "--json", str(path)]
    assert main(["tune", *arguments]) == 0
    output, result = capsys.readouterr().out, json.loads(path.read_text())
    assert "seeds 101, fresh 1000104" in output
    assert f"{result['evaluations']} settings in 1 runs each" in output
    assert result["trial_runs"] == result["evaluations"]
    assert [row["scenario"] for row in result["fresh_seas"]] == ["tank"]
    assert result["better"] == (result["fresh_cost"] < 1.0 and result["found"] != result["delivered"])
    assert result["delivered"]["gain_factor"] == DEFAULT_CONSTANTS.gain_factor
