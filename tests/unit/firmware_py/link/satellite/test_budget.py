"""Credits by day and month, counted before they are spent."""

import math

import pytest

from firmware_py.link.satellite.messages import Kind
from firmware_py.link.satellite.record import Ledger, Limits
from support.satellite import START_UTC_S

LIMITS = Limits(day=10, month=20, credit_bytes=50)
DAY_S = 86400.0


@pytest.mark.parametrize(("size", "credits_"), [(0, 1), (1, 1), (50, 1), (51, 2), (54, 2), (340, 7)])
def test_a_message_costs_whole_credits(size, credits_):
    assert LIMITS.cost(size) == credits_


def test_what_is_less_urgent_leaves_some_for_what_is_more():
    ledger = Ledger().charged(7)
    assert [ledger.room(LIMITS, kind) for kind in Kind] == [2, 2, 0, 3]
    assert Ledger().room(Limits(0, 0, 50), Kind.ANSWER) == math.inf


def test_a_later_day_begins_again_and_the_month_goes_on():
    ledger = Ledger().at(START_UTC_S).charged(9)
    later = ledger.at(START_UTC_S + DAY_S)
    assert (later.day_used, later.month_used, later.total) == (0, 9, 9)
    assert ledger.at(START_UTC_S + DAY_S, under_way=2).day_used == 2
    assert ledger.at(START_UTC_S + 30 * DAY_S).month_used == 0


def test_a_clock_that_is_set_back_or_wrong_gives_nothing_away():
    ledger = Ledger().at(START_UTC_S).charged(9)
    for utc_s in (START_UTC_S - DAY_S, START_UTC_S - 400 * DAY_S, 0.0, math.nan, -1.0, 1e300):
        assert ledger.at(utc_s).day_used == 9
        assert ledger.at(utc_s).month_used == 9
    # A clock that was ahead for a while counts on from what it has brought along.
    assert ledger.at(START_UTC_S - DAY_S).at(START_UTC_S).day_used == 0


def test_more_is_not_given_back_than_was_taken():
    assert Ledger().charged(2).charged(-3) == Ledger()
