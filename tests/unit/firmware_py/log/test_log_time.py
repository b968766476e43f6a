"""Correction of the times of thin-log rows by the clock that is set later in their run."""

import math

import pytest

from firmware_py.log.log_time import corrected_utc_s

NOON_S = 1_798_804_800.0


def rows_of_run(clock_s, count, first_s=60.0, span_s=60.0):
    """Return rows, one per minute, of a run that starts at `clock_s` on the calendar clock."""
    return [(clock_s + first_s + 60.0 * row, first_s + 60.0 * row, span_s) for row in range(count)]


def correct(rows):
    return corrected_utc_s(*zip(*rows, strict=True))


@pytest.mark.parametrize("wrong_s", [0.0, 946_684_800.0, NOON_S - 5e6, 4e9, math.nan])
def test_rows_before_the_clock_was_set_are_corrected(wrong_s):
    rows = rows_of_run(NOON_S, 5)
    wrong_rows = [(wrong_s + t_s, t_s, span_s) for _, t_s, span_s in rows[:3]]
    assert correct([*wrong_rows, *rows[3:]]) == [utc_s for utc_s, _, _ in rows]


def test_each_of_200_runs_from_1970_has_its_own_offset():
    """A receiver sets the clock after two minutes; runs that end earlier stay without a date."""
    rows, expected = [], []
    for start in range(200):
        true_rows = rows_of_run(NOON_S + 3600.0 * start, 1 + start % 5)
        early_rows = rows_of_run(0.0, len(true_rows))
        rows += [*early_rows[:2], *true_rows[2:]]
        expected += [utc_s for utc_s, _, _ in (true_rows if len(true_rows) > 2 else early_rows)]
    assert correct(rows) == expected


def test_correct_times_are_unchanged():
    rows = [*rows_of_run(NOON_S, 3), *rows_of_run(NOON_S + 1e4, 3, first_s=7.0, span_s=6.5)]
    assert correct(rows) == [utc_s for utc_s, _, _ in rows]
    assert corrected_utc_s([], [], []) == []
