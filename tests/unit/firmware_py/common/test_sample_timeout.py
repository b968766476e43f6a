"""A source is lost by its own rate, and no gap makes it slow for long."""

import math

import pytest

from firmware_py.common.sample_timeout import learn_interval_s, timeout_s


def learned(*steps_s, shortest_s=1.0):
    interval_s = math.nan
    for step_s in steps_s:
        interval_s = learn_interval_s(interval_s, step_s, shortest_s)
    return timeout_s(interval_s, shortest_s)


@pytest.mark.parametrize(
    ("step_s", "lost_s"), [(0.02, 1.0), (0.1, 1.0), (0.4, 1.0), (0.5, 1.25), (1.0, 2.5), (2.0, 5.0), (60.0, 5.0)]
)
def test_one_sample_may_be_missed(step_s, lost_s):
    assert learned(*[step_s] * 30) == pytest.approx(lost_s)


def test_before_a_second_sample_a_source_counts_as_slow():
    assert timeout_s(math.nan, 1.0) == 2.5


def test_the_timeout_is_at_most_five_minimum_timeouts():
    assert timeout_s(30.0, 1.0) == 5.0


def test_a_burst_of_several_sentences_is_not_a_fast_source():
    assert learned(*[0.98, 0.01, 0.01] * 9) > 1.5


@pytest.mark.parametrize("together", [8, 10, 50])
def test_bursts_of_an_adapter_do_not_shorten_the_timeout(together):
    burst = [1.0, *[0.0] * (together - 1)]
    assert learned(*burst * 20) == 2.5


def test_the_effect_of_a_gap_ends_after_a_few_samples():
    assert learned(*[0.1] * 30, 600.0) == 5.0
    assert learned(*[0.1] * 30, 600.0, *[0.1] * 13) == 1.0


def test_a_backward_clock_step_does_not_change_the_interval():
    assert learned(*[0.1] * 30, -5.0) == 1.0
