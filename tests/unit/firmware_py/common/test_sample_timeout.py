"""Timeout of a source of samples, adapted to its interval."""

import math

import pytest

from firmware_py.common.sample_timeout import learn_interval_s, timeout_s


def timeout_after(*steps_s, min_timeout_s=1.0):
    interval_s = math.nan
    for step_s in steps_s:
        interval_s = learn_interval_s(interval_s, step_s, min_timeout_s)
    return timeout_s(interval_s, min_timeout_s)


@pytest.mark.parametrize(
    ("step_s", "expected_s"), [(0.02, 1.0), (0.1, 1.0), (0.4, 1.0), (0.5, 1.25), (1.0, 2.5), (2.0, 5.0), (60.0, 5.0)]
)
def test_timeout_allows_one_missed_sample(step_s, expected_s):
    assert timeout_after(*[step_s] * 30) == pytest.approx(expected_s)


def test_timeout_before_the_second_sample():
    assert timeout_s(math.nan, 1.0) == 2.5


@pytest.mark.parametrize("interval_s", [math.nan, 0.5])
def test_first_sample_does_not_change_the_interval(interval_s):
    assert learn_interval_s(interval_s, math.nan, 1.0) == pytest.approx(interval_s, nan_ok=True)


def test_timeout_is_at_most_five_minimum_timeouts():
    assert timeout_s(30.0, 1.0) == 5.0


def test_sentences_of_one_burst_do_not_shorten_the_timeout():
    assert timeout_after(*[0.98, 0.01, 0.01] * 9) > 1.5


@pytest.mark.parametrize("samples_per_burst", [8, 10, 50])
def test_bursts_of_an_adapter_do_not_shorten_the_timeout(samples_per_burst):
    burst = [1.0, *[0.0] * (samples_per_burst - 1)]
    assert timeout_after(*burst * 20) == 2.5


def test_effect_of_a_gap_ends_after_13_samples():
    assert timeout_after(*[0.1] * 30, 600.0) == 5.0
    assert timeout_after(*[0.1] * 30, 600.0, *[0.1] * 13) == 1.0


def test_backward_clock_step_does_not_change_the_interval():
    assert timeout_after(*[0.1] * 30, -5.0) == 1.0
