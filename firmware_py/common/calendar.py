"""Plausible times of a calendar clock, and correction of incomplete ones."""

from __future__ import annotations

import math

BUILD_YEAR = 2026  # two-digit years are resolved to the nearest year
FIRST_UTC_S = 1_767_225_600.0  # 2026-01-01
LAST_UTC_S = 4_102_444_800.0  # 2100-01-01

DAY_S = 86_400.0
# GPS week numbers restart at 0 after 1024 weeks; the time of an old receiver may be wrong by a multiple of that.
# Source: IS-GPS-200, 20.3.3.3.1.1.
ROLLOVER_S = 1024 * 7 * DAY_S
MAX_AGE_S = 365 * DAY_S  # maximum of a corrected time minus the last known time


def is_possible(utc_s: float) -> bool:
    """Return whether a clock time is plausible; False for NaN."""
    return FIRST_UTC_S <= utc_s <= LAST_UTC_S


def full_year(two_digits: int) -> int:
    """Return the year with these two digits that is nearest to BUILD_YEAR."""
    return BUILD_YEAR + (two_digits - BUILD_YEAR + 50) % 100 - 50


def corrected_utc_s(stated_s: float, clock_s: float, last_s: float) -> float | None:
    """Return the time of a receiver, corrected for week number rollover; None for an impossible time.

    `clock_s` is the time of the computer, `last_s` the time of the newest log; implausible values are ignored. A time
    that differs from the clock by a multiple of 1024 weeks, within a day, is corrected. A time before
    FIRST_UTC_S is corrected, too, if the result is at most a year after the later of both.
    """
    known_s = max((utc_s for utc_s in (clock_s, last_s) if is_possible(utc_s)), default=None)
    if known_s is None or not 0.0 <= stated_s <= LAST_UTC_S:
        return stated_s if is_possible(stated_s) else None
    if is_possible(clock_s):
        rollovers = round((clock_s - stated_s) / ROLLOVER_S)
        if abs(stated_s + rollovers * ROLLOVER_S - clock_s) <= DAY_S:
            return stated_s + rollovers * ROLLOVER_S if rollovers else stated_s
    if is_possible(stated_s):
        return stated_s
    earliest_s = known_s - DAY_S
    corrected_s = stated_s + math.ceil((earliest_s - stated_s) / ROLLOVER_S) * ROLLOVER_S
    return corrected_s if corrected_s <= earliest_s + MAX_AGE_S else None
