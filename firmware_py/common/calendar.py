"""Which times a calendar clock can show, and what those mean that show too little of one."""

from __future__ import annotations

import math

BUILD_YEAR = 2026  # of this version: years of two digits are those nearest to it
FIRST_UTC_S = 1_767_225_600.0  # 2026-01-01: whatever says an earlier time is wrong
LAST_UTC_S = 4_102_444_800.0  # 2100-01-01: so is whatever says a later one

DAY_S = 86_400.0
# GPS counts weeks modulo 1024; a receiver that has missed a turn, or whose makers thought of none, is off by as much.
# Source: IS-GPS-200, 20.3.3.3.1.1.
ROLLOVER_S = 1024 * 7 * DAY_S
AWAY_S = 365 * DAY_S  # what lies this long after the last known time at most is believed to follow it


def is_possible(utc_s: float) -> bool:
    """Return whether a clock may be right that says this; NaN never is."""
    return FIRST_UTC_S <= utc_s <= LAST_UTC_S


def full_year(two_digits: int) -> int:
    """Return the year of two digits that lies nearest to the year of this version."""
    return BUILD_YEAR + (two_digits - BUILD_YEAR + 50) % 100 - 50


def mended_utc_s(stated_s: float, clock_s: float, last_s: float) -> float | None:
    """Return the time that a receiver means, whose weeks may have rolled over; None for one that cannot be.

    `clock_s` is what the computer's clock says, `last_s` when it was known last: the time of the newest log. Those that
    are no possible times are not heeded. What is 1024 weeks or a multiple off the clock to within a day is mended by
    that. So is what lies before this version's time and so mended follows the later of both within a year.
    """
    known_s = max((utc_s for utc_s in (clock_s, last_s) if is_possible(utc_s)), default=None)
    if known_s is None or not 0.0 <= stated_s <= LAST_UTC_S:
        return stated_s if is_possible(stated_s) else None
    if is_possible(clock_s):
        turns = round((clock_s - stated_s) / ROLLOVER_S)
        if abs(stated_s + turns * ROLLOVER_S - clock_s) <= DAY_S:
            return stated_s + turns * ROLLOVER_S if turns else stated_s
    if is_possible(stated_s):
        return stated_s
    earliest_s = known_s - DAY_S
    mended_s = stated_s + math.ceil((earliest_s - stated_s) / ROLLOVER_S) * ROLLOVER_S
    return mended_s if mended_s <= earliest_s + AWAY_S else None
