"""Corrects or removes the time of a GNSS receiver after a week number rollover, and reports it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from firmware_py.common.calendar import corrected_utc_s
from firmware_py.common.interfaces import Position
from firmware_py.common.records import DeviceHealth, PositionSample

MIN_AGREEING_FIXES = 5  # consecutive; wrong times during the start of a receiver are not reported


class TimeCorrectedPosition:
    """An interfaces.Position that corrects the times of the fixes of another one."""

    def __init__(
        self, position: Position, clock_utc_s: Callable[[], float], last_log_s: float, report: Callable[[str], None]
    ) -> None:
        """Store a driver; `last_log_s` is the time of the newest log (0: none), `report` notifies the operator."""
        self._position = position
        self._clock_utc_s = clock_utc_s
        self._last_log_s = last_log_s
        self._report = report
        self._verdict = self._reported_verdict = ""
        self._agreeing_fixes = 0

    def fileno(self) -> int:
        """Return the descriptor to wait for, or -1."""
        return self._position.fileno()

    def receive(self, now_s: float) -> None:
        """Read the received bytes."""
        self._position.receive(now_s)

    def poll(self) -> Sequence[PositionSample]:
        """Return the fixes since the last poll, with corrected times or None."""
        return tuple(map(self._correct_time, self._position.poll()))

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the device."""
        return self._position.health(now_s)

    def _correct_time(self, fix: PositionSample) -> PositionSample:
        received_s = fix.utc_s
        if received_s is None:
            return fix
        utc_s = corrected_utc_s(received_s, self._clock_utc_s(), self._last_log_s)
        self._report_verdict(
            "" if utc_s == received_s else "invalid" if utc_s is None else "corrected", received_s, utc_s
        )
        return fix if utc_s == received_s else replace(fix, utc_s=utc_s)

    def _report_verdict(self, verdict: str, received_s: float, utc_s: float | None) -> None:
        """Report a change of the verdict after MIN_AGREEING_FIXES consecutive fixes."""
        self._agreeing_fixes = self._agreeing_fixes + 1 if verdict == self._verdict else 1
        self._verdict = verdict
        if self._agreeing_fixes < MIN_AGREEING_FIXES or verdict == self._reported_verdict:
            return
        self._reported_verdict = verdict
        if not verdict:
            self._report("GPS date recovered")
        elif utc_s is None:
            self._report(f"GPS date {_format_date(received_s)} invalid: time not used")
        else:
            self._report(f"GPS week rollover: {_format_date(received_s)} corrected to {_format_date(utc_s)}")


def _format_date(utc_s: float) -> str:
    return dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%d")
