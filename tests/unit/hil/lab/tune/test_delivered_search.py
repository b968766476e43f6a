"""Choices of the tuner of the default controller, on analytic error and travel functions."""

import math

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.tune.delivered import Trials, cases_of, default_setting, task_of
from hil.lab.tune.delivered_search import is_no_worse, tune
from hil.lab.tune.loop_kernel import ITAE, RESULTS, TRAVEL
from hil.ship.scenarios import UnknownScenarioError

PRICE, BAND = default_setting()


class AnalyticTrials(Trials):
    """Error and travel are functions of the setting, relative to the defaults."""

    def __init__(self, error, travel):
        self.functions = error, travel
        self.archive = []
        self.reference = self.results(default_setting())
        self.default_score = self._add_score(default_setting(), self.reference)

    def results(self, setting):
        results = np.zeros((1, RESULTS))
        results[0, [ITAE, TRAVEL]] = [function(*setting) for function in self.functions]
        return results


def error_with_minimum(price, band):
    """Return an error with a minimum at a price of 0.6."""
    return 0.9 + 0.3 * math.log(price / 0.6) ** 2 - 0.3 * math.log(PRICE / 0.6) ** 2 + 0.1 + 0.05 * abs(band - BAND)


def travel_decreasing_with_price(price, band):
    return (PRICE / price) ** 0.2 + 0.02 * abs(band - BAND)


def constant(_price, _band):
    return 1.0


def test_better_setting_is_found_and_useless_changes_are_restored():
    result = tune(
        AnalyticTrials(error_with_minimum, constant),
        AnalyticTrials(error_with_minimum, constant),
        ParameterSet(),
        evaluations=60,
    )
    assert not result.keeps_defaults
    assert result.chosen.setting[0] == pytest.approx(0.6, rel=0.1)
    assert result.chosen.setting[1] == BAND
    assert result.fresh_score.error < 1.0
    assert "neither larger than with the defaults" in result.reason


def test_error_and_travel_do_not_exceed_the_defaults_without_a_price():
    trials, fresh = (
        AnalyticTrials(error_with_minimum, travel_decreasing_with_price),
        AnalyticTrials(error_with_minimum, travel_decreasing_with_price),
    )
    result = tune(trials, fresh, ParameterSet(), evaluations=60)
    assert is_no_worse(trials, result.chosen)
    trials = AnalyticTrials(error_with_minimum, travel_decreasing_with_price)
    weighted_result = tune(trials, fresh, ParameterSet(), price=0.1, evaluations=60)
    assert not weighted_result.keeps_defaults
    assert weighted_result.chosen.setting[0] < PRICE
    assert trials.travel(weighted_result.chosen) > 1.0


@pytest.mark.parametrize("evaluations", [20, 60, 75])
def test_number_of_evaluations_is_limited(evaluations):
    result = tune(
        AnalyticTrials(error_with_minimum, constant),
        AnalyticTrials(error_with_minimum, constant),
        ParameterSet(),
        evaluations=evaluations,
    )
    # The result is rounded, and its parameters are restored one by one.
    assert evaluations <= result.evaluations <= evaluations + 3


def test_setting_that_is_not_better_in_fresh_seas_is_rejected():
    result = tune(
        AnalyticTrials(error_with_minimum, constant),
        AnalyticTrials(lambda price, _: 1.0 + abs(price - PRICE), constant),
        ParameterSet(),
    )
    assert result.keeps_defaults
    assert result.chosen.setting == default_setting()
    assert "not in fresh seas" in result.reason


def test_defaults_are_kept_without_a_better_setting():
    result = tune(
        AnalyticTrials(lambda price, _: 1.0 + abs(price - PRICE), constant),
        AnalyticTrials(constant, constant),
        ParameterSet(),
    )
    assert (result.keeps_defaults, result.reason) == (True, "nothing better was found")


class CountingTrials(Trials):
    """Count the trial runs."""

    def __init__(self):
        self.archive, self.reference, self.run_count = [], np.ones((1, RESULTS)), 0

    def results(self, setting):
        self.run_count += 1
        return self.reference


def test_simulated_setting_is_not_simulated_again():
    trials = CountingTrials()
    assert trials.score((1.0, 2.0)) is trials.score((1.0, 2.0))
    trials.score((1.0, 2.5))
    assert (trials.run_count, len(trials.archive)) == (2, 2)


def test_cases_are_all_combinations_of_seas_ships_and_seeds():
    cases = cases_of(["tank", "swell+leeway=8"], (4, 5))
    assert len({(case.text, case.ship, case.seed) for case in cases}) == len(cases) == 12
    assert cases[-1].scenario.disturbances.leeway.body_deg == 8.0
    with pytest.raises(UnknownScenarioError):
        cases_of(["pond"], (1,))


def test_duration_is_longer_for_a_slow_ship():
    default, slow_ship_ = task_of(OCEAN_RAMBLER, 0.5), task_of(KtModel(0.005, 60.0, 100.0, 0.0, 0.4), 0.5)
    assert slow_ship_[2] > 2.0 * default[2]
    assert default[0].leg_ticks * 2 == round((default[2] - 150.0) * 10)
