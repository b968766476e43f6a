"""Choices of the tuner of the default controller, on analytic error and travel functions."""

import math

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.tune.delivered import Trials, cases_of, default_setting, task_of
from hil.lab.tune.delivered_search import no_worse, tune
from hil.lab.tune.loop_kernel import ITAE, RESULTS, TRAVEL
from hil.ship.scenarios import UnknownScenarioError

PRICE, BAND = default_setting()


class MadeUp(Trials):
    """Error and travel are functions of the setting, relative to the defaults."""

    def __init__(self, error, travel):
        self.made_up = error, travel
        self.archive = []
        self.reference = self.results(default_setting())
        self.delivered = self._keep(default_setting(), self.reference)

    def results(self, setting):
        results = np.zeros((1, RESULTS))
        results[0, [ITAE, TRAVEL]] = [one(*setting) for one in self.made_up]
        return results


def hollow(price, band):
    """Smallest at a price of 0.6."""
    return 0.9 + 0.3 * math.log(price / 0.6) ** 2 - 0.3 * math.log(PRICE / 0.6) ** 2 + 0.1 + 0.05 * abs(band - BAND)


def less_with_price(price, band):
    return (PRICE / price) ** 0.2 + 0.02 * abs(band - BAND)


def flat(_price, _band):
    return 1.0


def test_a_better_setting_is_found_and_useless_changes_are_restored():
    found = tune(MadeUp(hollow, flat), MadeUp(hollow, flat), ParameterSet(), evaluations=60)
    assert not found.kept
    assert found.chosen.setting[0] == pytest.approx(0.6, rel=0.1)
    assert found.chosen.setting[1] == BAND
    assert found.fresh.error < 1.0
    assert "neither larger than with the defaults" in found.why


def test_error_and_travel_do_not_exceed_the_defaults_without_a_price():
    trials, fresh = MadeUp(hollow, less_with_price), MadeUp(hollow, less_with_price)
    found = tune(trials, fresh, ParameterSet(), evaluations=60)
    assert no_worse(trials, found.chosen)
    trials = MadeUp(hollow, less_with_price)
    close = tune(trials, fresh, ParameterSet(), price=0.1, evaluations=60)
    assert not close.kept
    assert close.chosen.setting[0] < PRICE
    assert trials.travel(close.chosen) > 1.0


@pytest.mark.parametrize("evaluations", [20, 60, 75])
def test_number_of_evaluations(evaluations):
    found = tune(MadeUp(hollow, flat), MadeUp(hollow, flat), ParameterSet(), evaluations=evaluations)
    # The result is rounded, and its parameters are restored one by one.
    assert evaluations <= found.evaluations <= evaluations + 3


def test_a_setting_that_is_not_better_in_fresh_seas_is_rejected():
    found = tune(MadeUp(hollow, flat), MadeUp(lambda price, _: 1.0 + abs(price - PRICE), flat), ParameterSet())
    assert found.kept
    assert found.chosen.setting == default_setting()
    assert "not in fresh seas" in found.why


def test_the_defaults_are_kept_if_nothing_is_better():
    found = tune(MadeUp(lambda price, _: 1.0 + abs(price - PRICE), flat), MadeUp(flat, flat), ParameterSet())
    assert (found.kept, found.why) == (True, "nothing better was found")


class Counted(Trials):
    """Trial runs of which only the number is of interest."""

    def __init__(self):
        self.archive, self.reference, self.sailed = [], np.ones((1, RESULTS)), 0

    def results(self, setting):
        self.sailed += 1
        return self.reference


def test_a_setting_that_has_been_sailed_is_not_sailed_again():
    trials = Counted()
    assert trials.score((1.0, 2.0)) is trials.score((1.0, 2.0))
    trials.score((1.0, 2.5))
    assert (trials.sailed, len(trials.archive)) == (2, 2)


def test_cases_are_all_seas_ships_and_seeds():
    cases = cases_of(["tank", "swell+leeway=8"], (4, 5))
    assert len({(case.text, case.ship, case.seed) for case in cases}) == len(cases) == 12
    assert cases[-1].scenario.disturbances.leeway.body_deg == 8.0
    with pytest.raises(UnknownScenarioError):
        cases_of(["pond"], (1,))


def test_the_duration_grows_for_a_slow_ship():
    usual, slow = task_of(OCEAN_RAMBLER, 0.5), task_of(KtModel(0.005, 60.0, 100.0, 0.0, 0.4), 0.5)
    assert slow[2] > 2.0 * usual[2]
    assert usual[0].leg_ticks * 2 == round((usual[2] - 150.0) * 10)
