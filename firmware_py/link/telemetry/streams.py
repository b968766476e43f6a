"""Intervals of telemetry messages: when each row of the telemetry table is sent to a peer."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from firmware_py.link.telemetry.table import ROWS_OF, TABLE, TelemetryRow
from firmware_py.link.wire.urls import LinkClass

MIN_INTERVAL_S = 0.02  # tick interval of the fastest loop, 50 Hz
# Ground stations request high rates by default; a satellite link rejects them.
MIN_SATELLITE_INTERVAL_S = 10.0
MIN_PAID_INTERVAL_S = 600.0  # LinkClass.MESSAGES: each message is paid
MAX_INTERVAL_S = 3600.0
HIGH_LATENCY2 = 235
_OFF = math.inf

_DEFAULT_RATE_HZ: Mapping[LinkClass, Callable[[TelemetryRow], float]] = {
    LinkClass.FAST: lambda row: row.fast_hz,
    LinkClass.RADIO: lambda row: row.radio_hz,
    LinkClass.SATELLITE: lambda _row: 0.0,
    LinkClass.MESSAGES: lambda _row: 0.0,
}
_MIN_INTERVAL_OF_CLASS_S: Mapping[LinkClass, float] = {
    LinkClass.SATELLITE: MIN_SATELLITE_INTERVAL_S,
    LinkClass.MESSAGES: MIN_PAID_INTERVAL_S,
}


class Streams:
    """Intervals of the telemetry to one peer: those that it requested, or the defaults of the class of its link."""

    __slots__ = ("_default_interval_s", "_due_s", "_interval_s", "_min_interval_s", "_min_stream_interval_s")

    def __init__(self, link_class: LinkClass, now_s: float) -> None:
        """Start with the default rates of the class, and all active messages due. Satellite links have no defaults."""
        self._min_interval_s = _MIN_INTERVAL_OF_CLASS_S.get(link_class, MIN_INTERVAL_S)
        rates_hz = [_DEFAULT_RATE_HZ[link_class](row) for row in TABLE]
        # A stream request must not fill a radio link with messages that rarely change.
        is_radio = link_class is LinkClass.RADIO
        self._min_stream_interval_s = [
            1.0 / row.fast_hz if is_radio and row.fast_hz else MIN_INTERVAL_S for row in TABLE
        ]
        self._default_interval_s = [1.0 / rate_hz if rate_hz else _OFF for rate_hz in rates_hz]
        self._interval_s = list(self._default_interval_s)
        self._due_s = [now_s if rate_hz else _OFF for rate_hz in rates_hz]

    def due_rows(self, now_s: float, tick_s: float) -> Sequence[int]:
        """Return the indices of the rows due within half a tick interval `tick_s`, in order of their due times."""
        limit_s = now_s + 0.5 * tick_s
        if min(self._due_s) > limit_s:  # true in about two thirds of the ticks
            return ()
        rows = [row for row, due_s in enumerate(self._due_s) if due_s <= limit_s]
        rows.sort(key=self._due_s.__getitem__)
        return rows

    def schedule_next(self, row: int, now_s: float, interval_factor: float = 1.0) -> None:
        """Set the next due time of a row that was sent or had no content; missed intervals are skipped.

        `interval_factor` lengthens the interval, for example in power saving.
        """
        interval_s = self._interval_s[row] * interval_factor
        next_s = self._due_s[row] + interval_s
        self._due_s[row] = next_s if next_s > now_s else now_s + interval_s

    def make_due(self, message_id: int, now_s: float) -> None:
        """Make a message due now unless it is off."""
        for row in ROWS_OF.get(message_id, ()):
            if self._interval_s[row] < _OFF:
                self._due_s[row] = now_s

    def postpone(self, message_id: int, now_s: float) -> None:
        """Restart the interval of a message that was sent before it was due."""
        for row in ROWS_OF.get(message_id, ()):
            self._due_s[row] = now_s + self._interval_s[row]

    def make_all_due(self, now_s: float) -> None:
        """Make all active messages due now, after a change of the intervals."""
        self._due_s = [now_s if interval_s < _OFF else _OFF for interval_s in self._interval_s]

    def interval_us(self, message_id: int) -> int | None:
        """Return the interval of a message in microseconds; -1 if it is off, None for an unknown message."""
        rows = ROWS_OF.get(message_id)
        if rows is None:
            return None
        interval_s = self._interval_s[rows[0]]
        return -1 if interval_s == _OFF else round(interval_s * 1e6)

    def set_interval(self, message_id: int, interval_us: float, now_s: float) -> bool:
        """Set an interval: -1 turns the message off, 0 restores its default. Return False if it is rejected.

        The interval of HEARTBEAT cannot be set: without heartbeats a ground station reports a lost link.
        """
        rows = ROWS_OF.get(message_id)
        if rows is None or message_id == 0 or not math.isfinite(interval_us):
            return False
        if interval_us in (-1.0, 0.0):
            for row in rows:
                self._set(row, _OFF if interval_us else self._default_interval_s[row], now_s)
            return True
        if not self._min_interval_s <= interval_us * 1e-6 <= MAX_INTERVAL_S:
            return False
        for row in rows:
            self._set(row, interval_us * 1e-6, now_s)
        return True

    def set_stream(self, stream: int, rate_hz: float, now_s: float) -> None:
        """Set the rate of a MAV_DATA_STREAM (0: off) or of all streams (stream 0).

        A satellite link ignores the request. On a radio link the rate of a message is at most its default on a fast
        link.
        """
        if self._min_interval_s > MIN_INTERVAL_S:
            return
        interval_s = _OFF if rate_hz <= 0.0 else 1.0 / rate_hz
        for index, row in enumerate(TABLE):
            if row.stream is not None and stream in (0, row.stream):
                self._set(index, max(interval_s, self._min_stream_interval_s[index]), now_s)

    def set_high_latency(self, interval_s: float | None, now_s: float) -> None:
        """Set the interval of HIGH_LATENCY2; None turns it off."""
        for row in ROWS_OF[HIGH_LATENCY2]:
            self._set(row, _OFF if interval_s is None else interval_s, now_s)

    def _set(self, row: int, interval_s: float, now_s: float) -> None:
        self._interval_s[row] = interval_s
        self._due_s[row] = _OFF if interval_s == _OFF else now_s
