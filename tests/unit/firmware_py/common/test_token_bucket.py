"""So much at once, and so much a second in the long run."""

import pytest

from firmware_py.common.token_bucket import TokenBucket


def test_a_full_bucket_gives_its_burst_at_once_and_then_its_rate():
    bucket = TokenBucket(3, 2.0)
    assert [bucket.spend_one(10.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.spend_one(10.4), bucket.spend_one(10.5), bucket.spend_one(10.5)] == [False, True, False]


def test_an_idle_bucket_holds_no_more_than_its_burst():
    bucket = TokenBucket(3, 2.0)
    assert bucket.level(1e9) == 3.0


def test_the_gain_of_a_bucket_is_limited():
    bucket = TokenBucket(100, 2.0, full=False, longest_s=4.0)
    assert bucket.level(1e6) == pytest.approx(8.0)


def test_a_clock_that_goes_back_gives_nothing():
    bucket = TokenBucket(10, 1.0, full=False)
    assert bucket.level(5.0) == 5.0
    assert bucket.level(1.0) == 5.0


def test_a_bucket_can_be_overspent():
    bucket = TokenBucket(10, 1.0)
    bucket.spend(12.0)
    assert bucket.level(0.0) == -2.0
    assert not bucket.spend_one(2.5)
    assert bucket.spend_one(3.0)
