"""Correction of the times of thin-log rows by the clock that is set later in their run."""

import math

import pytest

from firmware_py.common.records import FixType, PositionSample
from firmware_py.log import schema
from firmware_py.log.dataflash import MessageType, header
from firmware_py.log.log_time import corrected_utc_s, utc_offset_s

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


@pytest.mark.parametrize(("second_s", "is_same_run"), [(119.0, True), (118.9, False)])
def test_rows_that_overlap_by_up_to_a_second_are_of_the_same_run(second_s, is_same_run):
    first_s, _ = correct([(0.0, 60.0, 60.0), (NOON_S, second_s, 60.0)])
    assert first_s == (NOON_S - second_s + 60.0 if is_same_run else 0.0)


def test_correct_times_are_unchanged():
    rows = [*rows_of_run(NOON_S, 3), *rows_of_run(NOON_S + 1e4, 3, first_s=7.0, span_s=6.5)]
    assert correct(rows) == [utc_s for utc_s, _, _ in rows]
    assert corrected_utc_s([], [], []) == []


def log_of_fixes(*fixes):
    """Return a log with fixes at (t_s, utc_s)."""
    samples = [PositionSample(t_s, FixType.FIX_3D, 0.5, 0.5, utc_s=utc_s) for t_s, utc_s in fixes]
    return header(schema.TYPES, 0) + b"".join(schema.POSITION.pack(0.0, sample) for sample in samples)


@pytest.mark.parametrize("labels", ["TimeUS,T,Utc", "TimeUS,Utc,T", "TimeUS,Utc,X"])
def test_a_fix_of_another_version_has_no_offset(labels):
    fix = MessageType(200, "FIX", labels, "QdQ", "sss", "F00")
    assert utc_offset_s(header((fix,), 0) + fix.pack(0, NOON_S, 5)) is None


@pytest.mark.parametrize(
    ("fixes", "offset_s"),
    [
        ([(5.0, NOON_S), (6.0, NOON_S + 9.0)], NOON_S - 5.0),
        ([(1.0, None), (2.0, 1e9), (3.0, 4_102_444_800.0), (4.0, NOON_S)], NOON_S - 4.0),
        ([(math.inf, NOON_S), (7.0, NOON_S)], NOON_S - 7.0),
        ([(1.0, 1e9 + 1.0)], 1e9),
        ([(1.0, None)], None),
        ([], None),
    ],
)
def test_offset_of_a_log_is_that_of_its_first_dated_fix(fixes, offset_s):
    assert utc_offset_s(log_of_fixes(*fixes)) == offset_s
