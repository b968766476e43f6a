"""Rows of the thin log are corrected_utc_s by the clock that their run came to have."""

import math

import pytest

from firmware_py.log.log_time import corrected_utc_s

NOON_S = 1_798_804_800.0


def run(clock_s, count, first_s=60.0, span_s=60.0):
    """Rows of a run, a minute each, by a clock that began at clock_s with the run."""
    return [(clock_s + first_s + 60.0 * row, first_s + 60.0 * row, span_s) for row in range(count)]


def times(*rows):
    return corrected_utc_s(*zip(*rows, strict=True))


@pytest.mark.parametrize("wrong_s", [0.0, 946_684_800.0, NOON_S - 5e6, 4e9, math.nan])
def test_what_was_written_before_the_clock_was_set_is_dated_by_it(wrong_s):
    rows = run(NOON_S, 5)
    before = [(wrong_s + t_s, t_s, span_s) for _, t_s, span_s in rows[:3]]
    assert times(*before, *rows[3:]) == [utc_s for utc_s, _, _ in rows]


def test_two_hundred_starts_at_1970_each_have_their_own_clock():
    """Of most a receiver sets it after two minutes; some are over before that, and stay without a day."""
    rows, expected = [], []
    for start in range(200):
        true = run(NOON_S + 3600.0 * start, 1 + start % 5)
        early = run(0.0, len(true))
        known = len(true) > 2
        rows += [*early[:2], *true[2:]]
        expected += [utc_s for utc_s, _, _ in (true if known else early)]
    assert times(*rows) == expected


def test_a_clock_that_is_not_set_changes_nothing():
    rows = [*run(NOON_S, 3), *run(NOON_S + 1e4, 3, first_s=7.0, span_s=6.5)]
    assert times(*rows) == [utc_s for utc_s, _, _ in rows]
    assert corrected_utc_s([], [], []) == []
