"""Token bucket: burst, rate, limits."""

import pytest

from firmware_py.common.token_bucket import TokenBucket


def test_full_bucket_gives_its_burst_and_then_its_rate():
    bucket = TokenBucket(3, 2.0)
    assert [bucket.spend_one(10.0) for _ in range(4)] == [True, True, True, False]
    assert [bucket.spend_one(10.4), bucket.spend_one(10.5), bucket.spend_one(10.5)] == [False, True, False]


def test_level_is_limited_by_burst_and_elapsed_time():
    assert TokenBucket(3, 2.0).level(1e9) == 3.0
    bucket = TokenBucket(100, 2.0, is_full=False, max_elapsed_s=4.0)
    assert bucket.level(1e6) == pytest.approx(8.0)


def test_reduced_rate_applies_from_then_on():
    bucket = TokenBucket(100, 10.0, is_full=False)
    for share, now_s, level in ((0.5, 2.0, 20.0), (1.0, 4.0, 30.0), (0.0, 5.0, 40.0)):
        bucket.set_rate_share(share, now_s)
        assert bucket.level(now_s) == level
    assert bucket.level(9.0) == 40.0


def test_backward_clock_step_adds_no_tokens():
    bucket = TokenBucket(10, 1.0, is_full=False)
    assert bucket.level(5.0) == 5.0
    assert bucket.level(1.0) == 5.0


def test_bucket_can_be_overspent():
    bucket = TokenBucket(10, 1.0)
    bucket.spend(12.0)
    assert bucket.level(0.0) == -2.0
    assert not bucket.spend_one(2.5)
    assert bucket.spend_one(3.0)
