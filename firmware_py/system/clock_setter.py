"""Sets the computer's clock from GPS if no other program synchronises it; the clock of the loop is not affected."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

from firmware_py.common.calendar import DAY_S, is_possible
from firmware_py.common.records import Event, PositionSample, Severity

SET_NEVER, SET_IF_INVALID, SET_IF_UNSYNCHRONISED = range(3)  # CLK_SET

MIN_AGREEING_TIMES = 5  # consecutive times that must agree
AGREEMENT_TOLERANCE_S = 1.0
# A sentence of a receiver may arrive a second after its time.
MAX_ERROR_S = {SET_IF_INVALID: DAY_S, SET_IF_UNSYNCHRONISED: 2.0}
CHECK_INTERVAL_S = 60.0
RETRY_S = 3600.0  # after a permission error


class ClockSetter:
    """Compares the times of GPS and ground stations with the computer's clock and sets it.

    Each time is stored as its difference from the clock of the loop, which does not jump.
    """

    def __init__(
        self, utc_s: Callable[[], float], set_utc_s: Callable[[float], bool], is_synchronised: Callable[[], bool]
    ) -> None:
        """Store the functions that read the clock, set it, and check whether it is synchronised."""
        self._utc_s = utc_s
        self._set_utc_s = set_utc_s
        self._is_synchronised = is_synchronised
        self._gps_offsets_s: deque[float] = deque(maxlen=MIN_AGREEING_TIMES)
        self._station_offsets_s: deque[float] = deque(maxlen=MIN_AGREEING_TIMES)
        self._next_check_s = -math.inf

    def add_station_time(self, utc_s: float, now_s: float) -> None:
        """Add the time of a ground station."""
        self._station_offsets_s.append(utc_s - now_s)

    def update(self, policy: int, fixes: Sequence[PositionSample], now_s: float) -> tuple[Event, ...]:
        """Add the fixes of a tick; set the clock if `policy` (CLK_SET) requires it; return the event."""
        self._gps_offsets_s.extend(fix.utc_s - fix.t_s for fix in fixes if fix.utc_s is not None)
        if policy == SET_NEVER or now_s < self._next_check_s:
            return ()
        utc_s = self._utc_s()
        is_impossible = not is_possible(utc_s)
        offset_s, source = _agreed_offset_s(self._gps_offsets_s, now_s), "GPS"
        if offset_s is None and is_impossible and not self._gps_offsets_s:
            offset_s, source = _agreed_offset_s(self._station_offsets_s, now_s), "a ground station"
        if offset_s is None:
            return ()
        self._next_check_s = now_s + CHECK_INTERVAL_S
        error_s = utc_s - (offset_s + now_s)
        if not is_impossible and (abs(error_s) <= MAX_ERROR_S[policy] or self._is_synchronised()):
            return ()
        if not self._set_utc_s(offset_s + now_s):
            self._next_check_s = now_s + RETRY_S
            text = f"Clock is {error_s:.0f} s off and may not be set (needs CAP_SYS_TIME)"
            return (Event(Severity.WARNING, text),)
        return (Event(Severity.NOTICE, f"Clock set from {source}: it was {error_s:.0f} s off"),)


def _agreed_offset_s(offsets_s: deque[float], now_s: float) -> float | None:
    """Return the latest difference, None unless MIN_AGREEING_TIMES agree and the time is possible; NaN never agrees."""
    if len(offsets_s) < MIN_AGREEING_TIMES:
        return None
    latest_s = offsets_s[-1]
    has_agreement = all(abs(offset_s - latest_s) <= AGREEMENT_TOLERANCE_S for offset_s in offsets_s)
    return latest_s if has_agreement and is_possible(latest_s + now_s) else None
