"""Budget of a satellite link: credits per day and month, and its stored record."""

import math

import pytest

from firmware_py.link.satellite.messages import Kind, Window
from firmware_py.link.satellite.record import Ledger, Limits, Record, from_bytes, to_bytes
from support.satellite import START_UTC_S

LIMITS = Limits(day=100, month=200, credit_bytes=50)
DAY_S = 86400.0


@pytest.mark.parametrize(("size", "credits_"), [(0, 1), (1, 1), (50, 1), (51, 2), (54, 2), (340, 7)])
def test_cost_is_rounded_up_to_credits(size, credits_):
    assert LIMITS.cost(size) == credits_


def test_lower_priorities_leave_credits_for_higher_ones():
    ledger = Ledger().charged(7)
    daily_credits = {Kind.EVENT: 95, Kind.REPORT: 90, Kind.ANSWER: 70, Kind.MAILBOX: 100}
    for kind in Kind:
        assert ledger.available(LIMITS, kind) == daily_credits[kind] - 7
    assert Ledger(month_used=150).available(LIMITS, Kind.MAILBOX) == 50
    assert Ledger(month_used=150).available(Limits(100, 0, 50), Kind.MAILBOX) == 100
    assert Ledger().available(Limits(0, 0, 50), Kind.ANSWER) == math.inf


def test_new_day_and_new_month_reset_their_credits():
    ledger = Ledger().at(START_UTC_S).charged(9)
    assert ledger == Ledger(20758, 56 * 12 + 10, 9, 9, 9)  # November 2026
    assert Ledger(day=1).at(0.0).day == 0
    assert [Ledger().at(utc_s).day for utc_s in (DAY_S - 1.0, DAY_S, 9.99e10, 1e11)] == [0, 1, 1_156_250, 0]
    later = ledger.at(START_UTC_S + DAY_S)
    assert (later.day_used, later.month_used, later.total) == (0, 9, 9)
    assert ledger.at(START_UTC_S + DAY_S, under_way=2).day_used == 2
    assert ledger.at(START_UTC_S + 30 * DAY_S).month_used == 0


def test_earlier_or_invalid_clock_keeps_the_used_credits():
    ledger = Ledger().at(START_UTC_S).charged(9)
    for utc_s in (START_UTC_S - DAY_S, START_UTC_S - 400 * DAY_S, 0.0, math.nan, -1.0, 1e300):
        assert ledger.at(utc_s).day_used == 9
        assert ledger.at(utc_s).month_used == 9
    # A clock that returns to the present day starts a new day.
    assert ledger.at(START_UTC_S - DAY_S).at(START_UTC_S).day_used == 0


def test_refund_is_limited_to_the_used_credits():
    assert Ledger().charged(2).charged(-3) == Ledger()


@pytest.mark.parametrize(
    ("record", "is_valid"),
    [
        (Record(Ledger(day=1_000_000, total=1 << 40), Window(used=(2, 3))), True),
        (Record(Ledger(day=1_000_001)), False),
        (Record(Ledger(total=(1 << 40) + 1)), False),
        (Record(Ledger(day_used=-1)), False),
        (Record(window=Window(floor=-1)), False),
        (Record(window=Window(used=(3, 2))), False),
        (Record(window=Window(used=(2, 2))), False),
    ],
)
def test_stored_record_with_impossible_values_is_rejected(record, is_valid):
    content = to_bytes(record)
    if is_valid:
        assert from_bytes(content) == (record, ())
    else:
        with pytest.raises(ValueError, match=r"negative|out of range"):
            from_bytes(content)
