"""Plausible times, years of two digits, and correction of week number rollovers."""

import datetime as dt
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.calendar import DAY_S, corrected_utc_s, full_year

BUILD_YEAR = 2026
FIRST_UTC_S = 1_767_225_600.0
ROLLOVER_S = 1024.0 * 7.0 * 86_400.0  # GPS weeks have 10 bits


def utc(*date):
    return dt.datetime(*date, tzinfo=dt.UTC).timestamp()


NOW_S = utc(2026, 11, 22)
UNKNOWN = 0.0  # time of a board without a real-time clock


@pytest.mark.parametrize(
    ("digits", "year"), [(26, 2026), (0, 2000), (16, 2016), (75, 2075), (76, 1976), (80, 1980), (99, 1999)]
)
def test_year_of_two_digits_is_the_nearest(digits, year):
    assert full_year(digits) == year


def test_first_plausible_time_is_the_start_of_the_build_year():
    assert utc(BUILD_YEAR, 1, 1) == FIRST_UTC_S


@pytest.mark.parametrize("clock_s", [NOW_S, NOW_S + 0.9 * DAY_S, UNKNOWN, math.nan, utc(2027, 3, 1), utc(2026, 1, 2)])
@pytest.mark.parametrize("last_s", [UNKNOWN, NOW_S - 5.0, NOW_S - 200 * DAY_S, NOW_S + 30 * DAY_S])
def test_correct_time_is_unchanged(clock_s, last_s):
    assert corrected_utc_s(NOW_S, clock_s, last_s) == NOW_S


@pytest.mark.parametrize("rollovers", [1, 2, -1])
@pytest.mark.parametrize("last_s", [UNKNOWN, NOW_S - 100 * DAY_S])
def test_week_rollover_is_corrected_by_the_clock(rollovers, last_s):
    assert corrected_utc_s(NOW_S - rollovers * ROLLOVER_S, NOW_S + 3600.0, last_s) == NOW_S


@pytest.mark.parametrize("rollovers", [1, 2])
@pytest.mark.parametrize("clock_s", [UNKNOWN, utc(2026, 9, 30)])
def test_week_rollover_is_corrected_by_the_newest_log(rollovers, clock_s):
    assert corrected_utc_s(NOW_S - rollovers * ROLLOVER_S, clock_s, utc(2026, 10, 1)) == NOW_S


@pytest.mark.parametrize("stated_s", [utc(1980, 1, 6), utc(2000, 1, 1), utc(2007, 4, 8), utc(2150, 1, 1), math.nan])
def test_impossible_time_without_a_reference_is_none(stated_s):
    assert corrected_utc_s(stated_s, UNKNOWN, UNKNOWN) is None


@pytest.mark.parametrize("stated_s", [utc(1980, 1, 6), utc(2000, 1, 1), utc(2015, 6, 1)])
@pytest.mark.parametrize("clock_s", [UNKNOWN, NOW_S])
def test_default_dates_of_receivers_are_none(stated_s, clock_s):
    assert corrected_utc_s(stated_s, clock_s, NOW_S - 10 * DAY_S) is None


@pytest.mark.parametrize(
    ("stated_s", "clock_s", "last_s", "corrected_s"),
    [
        (FIRST_UTC_S, UNKNOWN, UNKNOWN, FIRST_UTC_S),
        (FIRST_UTC_S - 1.0, UNKNOWN, UNKNOWN, None),
        (utc(2100, 1, 1), UNKNOWN, UNKNOWN, utc(2100, 1, 1)),
        (utc(2100, 1, 1) + 1.0, UNKNOWN, UNKNOWN, None),
        (utc(2100, 1, 1) + 1.0, NOW_S, UNKNOWN, None),
        (0.0, 3.0 * ROLLOVER_S, UNKNOWN, 3.0 * ROLLOVER_S),
        (-1.0, 3.0 * ROLLOVER_S, UNKNOWN, None),
        # The clock may differ by a day.
        (NOW_S - ROLLOVER_S, NOW_S + 86_400.0, UNKNOWN, NOW_S),
        (NOW_S - ROLLOVER_S, NOW_S + 86_400.0, NOW_S + 2 * 86_400.0, NOW_S),
        (NOW_S - ROLLOVER_S, NOW_S + 86_401.0, UNKNOWN, None),
        # The result is at least the last time less a day, and at most a year later.
        (NOW_S - ROLLOVER_S, UNKNOWN, NOW_S + 86_400.0, NOW_S),
        (NOW_S - ROLLOVER_S, UNKNOWN, NOW_S + 86_401.0, None),
        (NOW_S - ROLLOVER_S, FIRST_UTC_S, NOW_S - 364 * 86_400.0 + 30 * 86_400.0, NOW_S),
        (utc(2027, 11, 22) - ROLLOVER_S, UNKNOWN, NOW_S + 86_400.0, utc(2027, 11, 22)),
        (utc(2027, 11, 22) - ROLLOVER_S + 1.0, UNKNOWN, NOW_S + 86_400.0, None),
    ],
)
def test_limits_of_the_correction(stated_s, clock_s, last_s, corrected_s):
    assert corrected_utc_s(stated_s, clock_s, last_s) == corrected_s


def test_wrong_clock_does_not_change_a_correct_time():
    assert corrected_utc_s(NOW_S, utc(2031, 1, 1), UNKNOWN) == NOW_S
    assert corrected_utc_s(NOW_S, utc(2046, 3, 1), UNKNOWN) == NOW_S


TIMES = st.floats(-1e10, 1e10) | st.sampled_from([NOW_S, NOW_S - ROLLOVER_S, math.nan, math.inf, -math.inf])


@given(TIMES, TIMES, TIMES)
def test_any_input_gives_a_plausible_time_or_none(stated_s, clock_s, last_s):
    utc_s = corrected_utc_s(stated_s, clock_s, last_s)
    assert utc_s is None or math.isfinite(utc_s)
