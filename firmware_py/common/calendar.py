"""Which times a calendar clock can show; a clock that shows another one is as good as none."""

from __future__ import annotations

FIRST_UTC_S = 1_767_225_600.0  # 2026-01-01: whatever says an earlier time is wrong
LAST_UTC_S = 4_102_444_800.0  # 2100-01-01: so is whatever says a later one


def is_possible(utc_s: float) -> bool:
    """Return whether a clock may be right that says this; NaN never is."""
    return FIRST_UTC_S <= utc_s <= LAST_UTC_S
