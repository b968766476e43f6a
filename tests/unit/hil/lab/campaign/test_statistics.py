import math

import numpy as np
import pytest

from hil.lab.campaign import statistics

ONE_GROUP = np.zeros(200)


@pytest.fixture(scope="module")
def stats():
    from scipy import stats  # noqa: PLC0415 - takes a second to import

    return stats


def test_a_share_has_wilsons_interval(stats):
    found = statistics.share(5, 50)
    expected = stats.binomtest(5, 50).proportion_ci(method="wilson")
    assert found.value == 0.1
    assert (found.low, found.high) == (pytest.approx(expected.low), pytest.approx(expected.high))
    for runs in (9, 24, 1000):
        assert (statistics.share(0, runs).low, statistics.share(runs, runs).high) == (0.0, 1.0)
    assert statistics.share(0, 0) == statistics.Estimate(0.0, 0.0, 1.0)


def test_ranks_equal_those_of_scipy_and_infinity_ranks_last(stats):
    values = np.random.default_rng(1).integers(0, 20, 200).astype(float)
    assert np.array_equal(statistics.ranks(values), stats.rankdata(values))
    assert statistics.ranks(np.array([3.0, math.inf, 1.0, math.inf])).tolist() == [2.0, 3.5, 1.0, 3.5]


def test_a_rank_correlation_is_spearmans(stats):
    random = np.random.default_rng(2)
    one = random.normal(size=200)
    other = np.exp(one) + random.normal(size=200)
    found = statistics.rank_correlation(one, other, ONE_GROUP)
    assert found.value == pytest.approx(stats.spearmanr(one, other).statistic)
    assert -1.0 < found.low < found.value < found.high < 1.0
    assert statistics.rank_correlation(one, -np.exp(one), ONE_GROUP).value == pytest.approx(-1.0)


def test_coverage_of_the_interval_of_a_rank_correlation():
    random = np.random.default_rng(3)
    held = 0
    for _ in range(400):
        found = statistics.rank_correlation(random.normal(size=100), random.normal(size=100), ONE_GROUP[:100])
        held += found.low <= 0.0 <= found.high
    assert 0.92 <= held / 400 <= 0.98


def test_correlation_within_groups_of_different_means():
    random = np.random.default_rng(4)
    groups, drawn = np.arange(200) % 2, random.normal(size=200)
    score = drawn + 1000.0 * groups
    assert statistics.rank_correlation(drawn, score, groups).value == pytest.approx(1.0)
    assert statistics.rank_correlation(drawn, score, ONE_GROUP).value < 0.8


def test_no_correlation_for_few_pairs_or_constant_values():
    numbers = np.arange(200.0)
    assert statistics.rank_correlation(numbers[:9], numbers[:9], ONE_GROUP[:9]) is None
    assert statistics.rank_correlation(numbers, ONE_GROUP, ONE_GROUP) is None
    assert statistics.rank_correlation(numbers, np.full(200, np.nan), ONE_GROUP) is None
    spoilt = np.where(numbers < 100, np.nan, numbers)
    assert statistics.rank_correlation(spoilt, numbers, ONE_GROUP).value == pytest.approx(1.0)


@pytest.mark.parametrize("size", [300, pytest.param(12_345, marks=pytest.mark.proof)])
def test_width_of_the_bootstrap_interval_of_a_mean(size):
    values = np.random.default_rng(5).normal(3.0, 2.0, size)
    found = statistics.mean(values, 1)
    reach = 1.96 * np.std(values) / math.sqrt(size)
    assert found.value == np.mean(values)
    assert found.high - found.value == pytest.approx(reach, rel=0.15)
    assert found.value - found.low == pytest.approx(reach, rel=0.15)
    assert found == statistics.mean(values, 1)
    assert found != statistics.mean(values, 2)


def test_independent_samples_have_a_wider_interval_than_pairs():
    random = np.random.default_rng(6)
    before = random.normal(0.0, 2.0, 300)
    after = before + random.normal(0.5, 0.1, 300)
    apart, paired = statistics.difference(before, after, 1), statistics.mean(after - before, 1)
    assert apart.value == pytest.approx(paired.value)
    assert apart.high - apart.low > 10.0 * (paired.high - paired.low)


def test_coverage_of_the_interval_of_a_mean_of_few_runs():
    random = np.random.default_rng(8)
    held = 0
    for _ in range(600):
        found = statistics.mean(random.normal(size=8), 1)
        held += found.low <= 0.0 <= found.high
    assert 0.92 <= held / 600 <= 0.98


def test_the_interval_of_two_shares_is_newcombes():
    """Newcombe, table 2, method 10: 56 of 70 and 48 of 80."""
    found = statistics.share_difference(np.arange(80) < 48, np.arange(70) < 56, paired=False)
    assert found.value == pytest.approx(0.2)
    assert (found.low, found.high) == (pytest.approx(0.0524, abs=5e-5), pytest.approx(0.3339, abs=5e-5))


def test_no_failures_in_few_runs_leave_an_interval():
    none = np.zeros(10, bool)
    for paired in (False, True):
        found = statistics.share_difference(none, none, paired=paired)
        assert (found.value, -found.low) == (0.0, found.high)
        assert found.high > 0.2


def test_paired_shares_have_a_narrower_interval():
    random = np.random.default_rng(9)
    before = random.random(400) < 0.2
    after = before & (random.random(400) < 0.7)
    apart, paired = (statistics.share_difference(before, after, paired=one) for one in (False, True))
    assert paired.high - paired.low < apart.high - apart.low
    assert paired.high < 0.0


@pytest.mark.parametrize("runs", [8, 16, *(pytest.param(runs, marks=pytest.mark.proof) for runs in (64, 256))])
def test_coverage_of_the_interval_of_a_median_with_outliers(runs):
    random = np.random.default_rng(runs)
    held = held_of_two = 0
    for _ in range(400):
        one, other = (_settling(random, runs, after_s) for after_s in (40.0, 43.0))
        found = statistics.median(other - 40.0)
        held += found.low <= 3.0 <= found.high
        found = statistics.median_difference(one, other)
        held_of_two += found.low <= 3.0 <= found.high
    assert held >= 0.93 * 400
    assert held_of_two >= 0.93 * 400


def _settling(random, runs, after_s):
    """Return settling times of which 1 % are late by minutes and 1 % are infinite."""
    late_s = random.choice((0.0, 300.0, math.inf), runs, p=(0.98, 0.01, 0.01))
    return after_s + random.normal(0.0, 5.0, runs) + late_s


def test_infinite_medians_and_intervals_equal_to_those_of_scipy(stats):
    assert statistics.median(np.array([1.0] * 3 + [math.inf] * 5)).value == math.inf
    assert statistics.median(np.array([-math.inf, -math.inf, 1.0, 2.0, 4.0, 8.0, math.inf, math.inf])).value == 3.0
    never, soon = np.full(9, math.inf), np.arange(9.0)
    assert statistics.median_difference(soon, never) == statistics.Estimate(math.inf, -math.inf, math.inf)
    assert statistics.median_difference(never, never).value == 0.0
    for runs in (8, 9, 20, 101):
        found = statistics.median(np.arange(runs, dtype=float))
        expected = stats.quantile_test(np.arange(runs), p=0.5).confidence_interval(0.95)
        assert (found.low, found.high) == (expected.low, expected.high)


@pytest.mark.parametrize("runs", [8, 30, 200])
def test_power_of_the_detectable_difference(stats, runs):
    random = np.random.default_rng(runs)
    change = statistics.detectable_difference(1.0, runs)
    values = random.normal(change, 1.0, (4000, runs))
    ends = stats.t.ppf(0.975, runs - 1) * values.std(1, ddof=1) / math.sqrt(runs)
    assert np.mean(values.mean(1) > ends) == pytest.approx(0.8, abs=0.03)
    assert statistics.runs_to_detect(1.0, change) == pytest.approx(runs, abs=1)
