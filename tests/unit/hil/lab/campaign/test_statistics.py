"""Statistics of campaigns, compared with scipy, with published values and by coverage in simulations."""

import math

import numpy as np
import pytest

from hil.lab.campaign import statistics

ONE_GROUP = np.zeros(200)


@pytest.fixture(scope="module")
def stats():
    from scipy import stats  # noqa: PLC0415 - takes a second to import

    return stats


def test_proportion_has_wilsons_interval(stats):
    result = statistics.proportion(5, 50)
    expected = stats.binomtest(5, 50).proportion_ci(method="wilson")
    assert result.value == 0.1
    assert (result.low, result.high) == (pytest.approx(expected.low), pytest.approx(expected.high))
    for runs in (9, 24, 1000):
        assert (statistics.proportion(0, runs).low, statistics.proportion(runs, runs).high) == (0.0, 1.0)
    assert statistics.proportion(0, 0) == statistics.Estimate(0.0, 0.0, 1.0)


def test_ranks_equal_those_of_scipy_and_infinity_ranks_last(stats):
    values = np.random.default_rng(1).integers(0, 20, 200).astype(float)
    assert np.array_equal(statistics.ranks(values), stats.rankdata(values))
    assert statistics.ranks(np.array([3.0, math.inf, 1.0, math.inf])).tolist() == [2.0, 3.5, 1.0, 3.5]


def test_rank_correlation_equals_spearmans(stats):
    random = np.random.default_rng(2)
    one = random.normal(size=200)
    other = np.exp(one) + random.normal(size=200)
    result = statistics.rank_correlation(one, other, ONE_GROUP)
    assert result.value == pytest.approx(stats.spearmanr(one, other).statistic)
    assert -1.0 < result.low < result.value < result.high < 1.0
    assert statistics.rank_correlation(one, -np.exp(one), ONE_GROUP).value == pytest.approx(-1.0)


def test_interval_of_a_rank_correlation_covers_the_true_value():
    random = np.random.default_rng(3)
    covered = 0
    for _ in range(400):
        result = statistics.rank_correlation(random.normal(size=100), random.normal(size=100), ONE_GROUP[:100])
        covered += result.low <= 0.0 <= result.high
    assert 0.92 <= covered / 400 <= 0.98


def test_correlation_within_groups_of_different_means():
    random = np.random.default_rng(4)
    groups, drawn_values = np.arange(200) % 2, random.normal(size=200)
    score = drawn_values + 1000.0 * groups
    assert statistics.rank_correlation(drawn_values, score, groups).value == pytest.approx(1.0)
    assert statistics.rank_correlation(drawn_values, score, ONE_GROUP).value < 0.8


def test_no_correlation_for_few_pairs_or_constant_values():
    numbers = np.arange(200.0)
    assert statistics.rank_correlation(numbers[:9], numbers[:9], ONE_GROUP[:9]) is None
    assert statistics.rank_correlation(numbers, ONE_GROUP, ONE_GROUP) is None
    assert statistics.rank_correlation(numbers, np.full(200, np.nan), ONE_GROUP) is None
    partly_known = np.where(numbers < 100, np.nan, numbers)
    assert statistics.rank_correlation(partly_known, numbers, ONE_GROUP).value == pytest.approx(1.0)


@pytest.mark.parametrize("size", [300, pytest.param(12_345, marks=pytest.mark.proof)])
def test_width_of_the_bootstrap_interval_of_a_mean(size):
    values = np.random.default_rng(5).normal(3.0, 2.0, size)
    result = statistics.mean(values, 1)
    half_width = 1.96 * np.std(values) / math.sqrt(size)
    assert result.value == np.mean(values)
    assert result.high - result.value == pytest.approx(half_width, rel=0.15)
    assert result.value - result.low == pytest.approx(half_width, rel=0.15)
    assert result == statistics.mean(values, 1)
    assert result != statistics.mean(values, 2)


def test_independent_samples_have_a_wider_interval_than_pairs():
    random = np.random.default_rng(6)
    first = random.normal(0.0, 2.0, 300)
    second = first + random.normal(0.5, 0.1, 300)
    independent, paired = statistics.difference(first, second, 1), statistics.mean(second - first, 1)
    assert independent.value == pytest.approx(paired.value)
    assert independent.high - independent.low > 10.0 * (paired.high - paired.low)


def test_interval_of_a_mean_of_few_runs_covers_the_true_value():
    random = np.random.default_rng(8)
    covered = 0
    for _ in range(600):
        result = statistics.mean(random.normal(size=8), 1)
        covered += result.low <= 0.0 <= result.high
    assert 0.92 <= covered / 600 <= 0.98


def test_difference_of_proportions_has_newcombes_interval():
    """Newcombe, table 2, method 10: 56 of 70 and 48 of 80."""
    result = statistics.proportion_difference(np.arange(80) < 48, np.arange(70) < 56, paired=False)
    assert result.value == pytest.approx(0.2)
    assert (result.low, result.high) == (pytest.approx(0.0524, abs=5e-5), pytest.approx(0.3339, abs=5e-5))


def test_no_failures_in_few_runs_give_a_wide_interval():
    none = np.zeros(10, bool)
    for paired in (False, True):
        result = statistics.proportion_difference(none, none, paired=paired)
        assert (result.value, -result.low) == (0.0, result.high)
        assert result.high > 0.2


def test_paired_proportions_have_a_narrower_interval():
    random = np.random.default_rng(9)
    first = random.random(400) < 0.2
    second = first & (random.random(400) < 0.7)
    independent, paired = (
        statistics.proportion_difference(first, second, paired=is_paired) for is_paired in (False, True)
    )
    assert paired.high - paired.low < independent.high - independent.low
    assert paired.high < 0.0


@pytest.mark.parametrize("runs", [8, 16, *(pytest.param(runs, marks=pytest.mark.proof) for runs in (64, 256))])
def test_interval_of_a_median_with_outliers_covers_the_true_value(runs):
    random = np.random.default_rng(runs)
    covered = covered_of_two = 0
    for _ in range(400):
        one, other = (_settling(random, runs, after_s) for after_s in (40.0, 43.0))
        result = statistics.median(other - 40.0)
        covered += result.low <= 3.0 <= result.high
        result = statistics.median_difference(one, other)
        covered_of_two += result.low <= 3.0 <= result.high
    assert covered >= 0.93 * 400
    assert covered_of_two >= 0.93 * 400


def _settling(random, runs, after_s):
    """Return settling times, of which 1 % are minutes longer and 1 % are infinite."""
    delay_s = random.choice((0.0, 300.0, math.inf), runs, p=(0.98, 0.01, 0.01))
    return after_s + random.normal(0.0, 5.0, runs) + delay_s


def test_infinite_medians_and_intervals_equal_to_those_of_scipy(stats):
    assert statistics.median(np.array([1.0] * 3 + [math.inf] * 5)).value == math.inf
    assert statistics.median(np.array([-math.inf, -math.inf, 1.0, 2.0, 4.0, 8.0, math.inf, math.inf])).value == 3.0
    never, settled = np.full(9, math.inf), np.arange(9.0)
    assert statistics.median_difference(settled, never) == statistics.Estimate(math.inf, -math.inf, math.inf)
    assert statistics.median_difference(never, never).value == 0.0
    for runs in (8, 9, 20, 101):
        result = statistics.median(np.arange(runs, dtype=float))
        expected = stats.quantile_test(np.arange(runs), p=0.5).confidence_interval(0.95)
        assert (result.low, result.high) == (expected.low, expected.high)


@pytest.mark.parametrize("runs", [8, 30, 200])
def test_power_of_the_detectable_difference(stats, runs):
    random = np.random.default_rng(runs)
    change = statistics.detectable_difference(1.0, runs)
    values = random.normal(change, 1.0, (4000, runs))
    limits = stats.t.ppf(0.975, runs - 1) * values.std(1, ddof=1) / math.sqrt(runs)
    assert np.mean(values.mean(1) > limits) == pytest.approx(0.8, abs=0.03)
    assert statistics.runs_to_detect(1.0, change) == pytest.approx(runs, abs=1)
