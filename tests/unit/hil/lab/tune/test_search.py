"""Trials, the front and the practical tuner."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.tune import search
from hil.lab.tune.loop_kernel import ITAE, TRAVEL
from hil.lab.tune.search import BOUNDS, Box, tune
from hil.lab.tune.trials import DEG_PER_H, PAPER, Score, Setting, Trials, front, knee


@pytest.fixture(scope="module", autouse=True)
def few_prices():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "PRICES", (0.3, 1.0))
        yield


@pytest.fixture(scope="module")
def sea() -> Trials:
    return Trials(OCEAN_RAMBLER, ParameterSet(), ["sea"], 1)


def fresh(trials: Trials) -> Trials:
    """The same trials without what was tried before."""
    other = Trials.__new__(Trials)
    other.__dict__.update(trials.__dict__)
    other.archive = [trials.paper]
    return other


@pytest.fixture(scope="module")
def tuned(sea):
    trials = fresh(sea)
    return trials, tune(trials, PAPER, evaluations=150)


def score(error: float, travel: float) -> Score:
    return Score(PAPER, error, error, travel)


def test_the_paper_s_setting_is_the_measure_of_all():
    assert (PAPER.k1, PAPER.k2, PAPER.tau_s, PAPER.deadband_deg) == (40.0, 0.3, 1.5, 0.0)
    assert PAPER.parameters() == Setting.of(ParameterSet()).parameters()


def test_scores_are_ratios_to_the_paper_s(sea):
    assert sea.paper.error == pytest.approx(1.0)
    assert sea.paper.worst_error == pytest.approx(1.0)
    soft = replace(PAPER, k1=10.0)
    result = sea.results([soft])[0]
    got = fresh(sea).scores([soft])[0]
    ratio = result[:, ITAE] / sea.reference[:, ITAE]
    assert got.error == pytest.approx(np.sqrt(np.mean(ratio**2)))
    assert got.worst_error == pytest.approx(np.max(ratio))
    assert got.travel_deg_per_h == pytest.approx(np.mean(result[:, TRAVEL]) * DEG_PER_H)
    assert got.error > 1.0
    assert got.travel_deg_per_h < sea.paper.travel_deg_per_h


def test_the_cost_is_error_and_price_times_travel(sea):
    assert sea.cost(sea.paper, 0.0) == pytest.approx(1.0)
    assert sea.cost(sea.paper, 2.0) == pytest.approx(3.0)
    assert sea.cost(score(float("nan"), 1.0), 1.0) == float("inf")


def test_the_front_holds_what_nothing_beats_in_both():
    points = [score(1.0, 10.0), score(2.0, 5.0), score(1.5, 12.0), score(0.9, 20.0), score(2.0, 6.0), score(1.0, 11.0)]
    assert [(one.error, one.travel_deg_per_h) for one in front(points)] == [(2.0, 5.0), (1.0, 10.0), (0.9, 20.0)]


def test_the_knee_is_the_corner_and_of_few_points_the_best():
    corner = score(1.0, 10.0)
    assert knee([score(10.0, 5.0), corner, score(0.9, 1000.0)]) is corner
    assert knee([score(2.0, 5.0), score(1.0, 9.0)]).error == 1.0


def test_box_and_setting_go_both_ways():
    box = Box(PAPER, only_gains=False)
    setting = Setting(20.0, 1.0, 5.0, 0.5)
    back = box.setting(box.point(setting))
    assert (back.k1, back.k2, back.deadband_deg) == (20.0, 1.0, 0.5)
    assert back.tau_s == pytest.approx(5.0)
    ends = [box.setting(box.low), box.setting(box.high)]
    for bound in BOUNDS:
        assert getattr(ends[0], bound.field) == pytest.approx(bound.low)
        assert getattr(ends[1], bound.field) == pytest.approx(bound.high)


def test_a_setting_outside_the_box_starts_at_its_wall():
    box = Box(PAPER, only_gains=False)
    point = box.point(Setting(150.0, 40.0, 0.1, 9.0))
    assert np.all(point >= box.low)
    assert np.all(point <= box.high)


def test_edges_name_only_what_could_go_on():
    box = Box(PAPER, only_gains=False)
    assert box.edges(Setting(60.0, 0.0, 5.0, 0.0)) == ("CTL_K1 60",)
    assert box.edges(Setting(30.0, 10.0, 0.5, 5.0)) == ("CTL_K2 10", "EST_TAU_S 0.5", "RUD_DBAND_DEG 5")


def test_the_tuner_beats_the_paper_s_gains_in_both(tuned):
    trials, found = tuned
    assert found.chosen.error <= trials.paper.error
    assert found.chosen.travel_deg_per_h < 0.7 * trials.paper.travel_deg_per_h
    assert "CTL_K1" in found.changed
    assert "CTL_K2" in found.changed
    assert "EST_TAU_S" in found.changed  # the waves of the sea are worth filtering
    travels = [one.travel_deg_per_h for one in found.front]
    errors = [one.error for one in found.front]
    assert travels == sorted(travels)
    assert errors == sorted(errors, reverse=True)
    assert found.evaluations == len(trials.archive)


def test_the_same_seed_finds_the_same(sea):
    one, same, other = (tune(fresh(sea), PAPER, price=1.0, evaluations=30, seed=seed) for seed in (1, 1, 5))
    assert same == one
    assert other.front != one.front


@pytest.mark.proof
def test_a_higher_price_buys_less_rudder_work(sea):
    cheap = tune(fresh(sea), PAPER, price=0.1, evaluations=100, only_gains=True)
    dear = tune(fresh(sea), PAPER, price=5.0, evaluations=100, only_gains=True)
    assert dear.chosen.travel_deg_per_h < cheap.chosen.travel_deg_per_h
    assert dear.chosen.error > cheap.chosen.error
    assert (dear.chosen.setting.tau_s, dear.chosen.setting.deadband_deg) == (PAPER.tau_s, PAPER.deadband_deg)
    assert set(dear.changed) == {"CTL_K1", "CTL_K2"}


def test_with_only_the_gains_the_observer_stays_the_vehicle_s(sea):
    present = Setting(30.0, 0.5, 4.0, 0.5)
    found = tune(fresh(sea), present, price=1.0, evaluations=50, only_gains=True)
    assert set(found.changed) == {"CTL_K1", "CTL_K2"}
    assert {(one.setting.tau_s, one.setting.deadband_deg) for one in found.front} == {(4.0, 0.5)}
