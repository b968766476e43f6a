"""Corrects or removes the time of a GNSS receiver with a week number rollover, and reports it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from firmware_py.common.calendar import corrected_utc_s
from firmware_py.common.interfaces import Position
from firmware_py.common.records import DeviceHealth, PositionSample

MIN_AGREEING_FIXES = 5  # consecutive fixes: wrong times during the start of a receiver are not reported


class DatedPosition:
    """A wrapper of an interfaces.Position that corrects the time of its fixes."""

    def __init__(
        self, position: Position, clock_utc_s: Callable[[], float], last_s: float, say: Callable[[str], None]
    ) -> None:
        """Wrap a driver; `last_s` is the time of the newest log (0 for none), `say` reports to the operator."""
        self._position = position
        self._clock_utc_s = clock_utc_s
        self._last_s = last_s
        self._say = say
        self._verdict = self._reported = ""
        self._agreeing = 0

    def fileno(self) -> int:
        """Return the descriptor to wait for, or -1."""
        return self._position.fileno()

    def receive(self, now_s: float) -> None:
        """Read the received bytes."""
        self._position.receive(now_s)

    def poll(self) -> Sequence[PositionSample]:
        """Return the fixes since the last poll, with corrected times or None."""
        return tuple(map(self._dated, self._position.poll()))

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the device."""
        return self._position.health(now_s)

    def _dated(self, fix: PositionSample) -> PositionSample:
        stated_s = fix.utc_s
        if stated_s is None:
            return fix
        utc_s = corrected_utc_s(stated_s, self._clock_utc_s(), self._last_s)
        self._judge("" if utc_s == stated_s else "refused" if utc_s is None else "mended", stated_s, utc_s)
        return fix if utc_s == stated_s else replace(fix, utc_s=utc_s)

    def _judge(self, verdict: str, stated_s: float, utc_s: float | None) -> None:
        """Report a change of the verdict after MIN_AGREEING_FIXES consecutive fixes."""
        self._agreeing = self._agreeing + 1 if verdict == self._verdict else 1
        self._verdict = verdict
        if self._agreeing < MIN_AGREEING_FIXES or verdict == self._reported:
            return
        self._reported = verdict
        if not verdict:
            self._say("GPS date recovered")
        elif utc_s is None:
            self._say(f"GPS date {_date(stated_s)} invalid: time not used")
        else:
            self._say(f"GPS week rollover: {_date(stated_s)} corrected to {_date(utc_s)}")


def _date(utc_s: float) -> str:
    return dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%d")
