"""A receiver whose weeks have rolled over: its time is mended or left out, and that is told."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from firmware_py.common.calendar import corrected_utc_s
from firmware_py.common.interfaces import Position
from firmware_py.common.records import DeviceHealth, PositionSample

AGREEING = 5  # fixes in a row: what a receiver says as it starts is not worth a word


class DatedPosition:
    """An interfaces.Position around another."""

    def __init__(
        self, position: Position, clock_utc_s: Callable[[], float], last_s: float, say: Callable[[str], None]
    ) -> None:
        """Take the driver, the computer's clock, the time of the newest log (0 for none) and who tells the operator."""
        self._position = position
        self._clock_utc_s = clock_utc_s
        self._last_s = last_s
        self._say = say
        self._verdict = self._told = ""
        self._agreeing = 0

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._position.fileno()

    def receive(self, now_s: float) -> None:
        """Read what has arrived."""
        self._position.receive(now_s)

    def poll(self) -> Sequence[PositionSample]:
        """The fixes since the last poll, with times that can be, or none."""
        return tuple(map(self._dated, self._position.poll()))

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the device."""
        return self._position.health(now_s)

    def _dated(self, fix: PositionSample) -> PositionSample:
        stated_s = fix.utc_s
        if stated_s is None:
            return fix
        utc_s = corrected_utc_s(stated_s, self._clock_utc_s(), self._last_s)
        self._judge("" if utc_s == stated_s else "refused" if utc_s is None else "mended", stated_s, utc_s)
        return fix if utc_s == stated_s else replace(fix, utc_s=utc_s)

    def _judge(self, verdict: str, stated_s: float, utc_s: float | None) -> None:
        """Tell what is made of the times, once several fixes in a row have come to the same."""
        self._agreeing = self._agreeing + 1 if verdict == self._verdict else 1
        self._verdict = verdict
        if self._agreeing < AGREEING or verdict == self._told:
            return
        self._told = verdict
        if not verdict:
            self._say("GPS date is right again")
        elif utc_s is None:
            self._say(f"GPS date {_date(stated_s)} cannot be: its time is not used")
        else:
            self._say(f"GPS week rolled over: {_date(stated_s)} is taken for {_date(utc_s)}")


def _date(utc_s: float) -> str:
    return dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%d")
