"""Trial runs, Pareto front and tuner of fixed gains."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.tune import search
from hil.lab.tune.loop_kernel import ITAE, TRAVEL
from hil.lab.tune.search import BOUNDS, Box, tune
from hil.lab.tune.trials import DEG_PER_H, PAPER, Score, Setting, Trials, knee_of, pareto_front


@pytest.fixture(scope="module", autouse=True)
def few_prices():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "PRICES", (0.3, 1.0))
        yield


@pytest.fixture(scope="module")
def sea() -> Trials:
    return Trials(OCEAN_RAMBLER, ParameterSet(), ["sea"], 1)


def without_archive(trials: Trials) -> Trials:
    """Return the same trials with an empty archive."""
    other = Trials.__new__(Trials)
    other.__dict__.update(trials.__dict__)
    other.archive = [trials.paper]
    return other


@pytest.fixture(scope="module")
def tuned(sea):
    trials = without_archive(sea)
    return trials, tune(trials, PAPER, evaluations=150)


def score(error: float, travel: float) -> Score:
    return Score(PAPER, error, error, travel)


def test_reference_setting_is_that_of_the_paper():
    assert (PAPER.k1, PAPER.k2, PAPER.tau_s, PAPER.deadband_deg) == (40.0, 0.3, 1.5, 0.0)
    assert PAPER.parameters() == Setting.of(ParameterSet()).parameters()


def test_scores_are_ratios_to_the_papers_gains(sea):
    assert sea.paper.error == pytest.approx(1.0)
    assert sea.paper.worst_error == pytest.approx(1.0)
    low_gain = replace(PAPER, k1=10.0)
    result = sea.results([low_gain])[0]
    score_of_setting = without_archive(sea).scores([low_gain])[0]
    ratio = result[:, ITAE] / sea.reference[:, ITAE]
    assert score_of_setting.error == pytest.approx(np.sqrt(np.mean(ratio**2)))
    assert score_of_setting.worst_error == pytest.approx(np.max(ratio))
    assert score_of_setting.travel_deg_per_h == pytest.approx(np.mean(result[:, TRAVEL]) * DEG_PER_H)
    assert score_of_setting.error > 1.0
    assert score_of_setting.travel_deg_per_h < sea.paper.travel_deg_per_h


def test_cost_is_error_plus_price_times_travel(sea):
    assert sea.cost(sea.paper, 0.0) == pytest.approx(1.0)
    assert sea.cost(sea.paper, 2.0) == pytest.approx(3.0)
    assert sea.cost(score(float("nan"), 1.0), 1.0) == float("inf")


def test_pareto_front_contains_the_scores_that_no_pointdominates():
    points = [score(1.0, 10.0), score(2.0, 5.0), score(1.5, 12.0), score(0.9, 20.0), score(2.0, 6.0), score(1.0, 11.0)]
    assert [(point.error, point.travel_deg_per_h) for point in pareto_front(points)] == [
        (2.0, 5.0),
        (1.0, 10.0),
        (0.9, 20.0),
    ]


def test_knee_is_the_corner_or_the_smallest_error_of_two_points():
    corner = score(1.0, 10.0)
    assert knee_of([score(10.0, 5.0), corner, score(0.9, 1000.0)]) is corner
    assert knee_of([score(2.0, 5.0), score(1.0, 9.0)]).error == 1.0


def test_setting_is_converted_to_a_point_and_back():
    box = Box(PAPER, only_gains=False)
    setting = Setting(20.0, 1.0, 5.0, 0.5)
    restored = box.setting(box.point(setting))
    assert (restored.k1, restored.k2, restored.deadband_deg) == (20.0, 1.0, 0.5)
    assert restored.tau_s == pytest.approx(5.0)
    limit_settings = [box.setting(box.low), box.setting(box.high)]
    for bound in BOUNDS:
        assert getattr(limit_settings[0], bound.field) == pytest.approx(bound.low)
        assert getattr(limit_settings[1], bound.field) == pytest.approx(bound.high)


def test_point_of_a_setting_outside_the_box_is_clipped():
    box = Box(PAPER, only_gains=False)
    point = box.point(Setting(150.0, 40.0, 0.1, 9.0))
    assert np.all(point >= box.low)
    assert np.all(point <= box.high)


def test_limit_texts_name_only_limits_of_the_search():
    box = Box(PAPER, only_gains=False)
    assert box.limit_texts(Setting(60.0, 0.0, 5.0, 0.0)) == ("CTL_K1 60",)
    assert box.limit_texts(Setting(30.0, 10.0, 0.5, 5.0)) == ("CTL_K2 10", "EST_TAU_S 0.5", "RUD_DBAND_DEG 5")


def test_tuner_improves_error_and_travel_of_the_papers_gains(tuned):
    trials, result = tuned
    assert result.chosen.error <= trials.paper.error
    assert result.chosen.travel_deg_per_h < 0.7 * trials.paper.travel_deg_per_h
    assert "CTL_K1" in result.changed_names
    assert "CTL_K2" in result.changed_names
    assert "EST_TAU_S" in result.changed_names  # because filtering of the waves reduces the cost
    travels = [point.travel_deg_per_h for point in result.front]
    errors = [point.error for point in result.front]
    assert travels == sorted(travels)
    assert errors == sorted(errors, reverse=True)
    assert result.evaluations == len(trials.archive)


def test_same_seed_gives_the_same_result(sea):
    first, same, other = (tune(without_archive(sea), PAPER, price=1.0, evaluations=30, seed=seed) for seed in (1, 1, 5))
    assert same == first
    assert other.front != first.front


@pytest.mark.proof
def test_higher_price_reduces_the_rudder_travel(sea):
    low_price_result = tune(without_archive(sea), PAPER, price=0.1, evaluations=100, only_gains=True)
    high_price_result = tune(without_archive(sea), PAPER, price=5.0, evaluations=100, only_gains=True)
    assert high_price_result.chosen.travel_deg_per_h < low_price_result.chosen.travel_deg_per_h
    assert high_price_result.chosen.error > low_price_result.chosen.error
    assert (high_price_result.chosen.setting.tau_s, high_price_result.chosen.setting.deadband_deg) == (
        PAPER.tau_s,
        PAPER.deadband_deg,
    )
    assert set(high_price_result.changed_names) == {"CTL_K1", "CTL_K2"}


def test_only_gains_keeps_the_vehicles_observer_constant(sea):
    present = Setting(30.0, 0.5, 4.0, 0.5)
    result = tune(without_archive(sea), present, price=1.0, evaluations=50, only_gains=True)
    assert set(result.changed_names) == {"CTL_K1", "CTL_K2"}
    assert {(point.setting.tau_s, point.setting.deadband_deg) for point in result.front} == {(4.0, 0.5)}
