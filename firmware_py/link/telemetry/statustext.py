"""STATUSTEXT: texts to the operator, divided into chunks and limited in number."""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from collections.abc import Iterator
from typing import NamedTuple

from firmware_py.common.records import Event, Severity
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.link.latest import keep_latest
from firmware_py.link.wire.dialect import Message, encode_text, mavlink

_CHUNK_BYTES = 50
_MAX_TEXT_BYTES = 250
_MIN_REPEAT_S = 2.0  # minimum time between two equal texts; it doubles while the cause continues
_MAX_REPEAT_S = 60.0  # its maximum
_MAX_STORED_TEXTS = 32
_MAX_BURST_TEXTS = 8
_MAX_RATE_HZ = 2.0  # average of all texts
_MAX_STORED_WARNINGS = 5
_AGE_UNITS = ((172_800.0, 86_400.0, "d"), (7_200.0, 3_600.0, "h"), (60.0, 60.0, "min"))  # minimum age, unit in seconds
_FAULT_TEXT_OF_RECOVERY = {row.recovery: row.text for row in FAULTS.values()}


def text_messages(severity: Severity, text: str, number: int) -> list[Message]:
    """Return the STATUSTEXT messages of a text; `number` identifies the chunks of a long text."""
    data = encode_text(text, _MAX_TEXT_BYTES)
    if len(data) <= _CHUNK_BYTES:
        return [mavlink.MAVLink_statustext_message(int(severity), data)]
    # A chunk that is not full ends the text, so an empty chunk follows if the last one is full.
    starts = range(0, len(data) + 1, _CHUNK_BYTES)
    return [
        mavlink.MAVLink_statustext_message(int(severity), data[start : start + _CHUNK_BYTES], number, index)
        for index, start in enumerate(starts)
    ]


class _SentText(NamedTuple):
    """Time of a text, minimum time until it is repeated, and whether a repetition was suppressed since."""

    t_s: float
    repeat_s: float = _MIN_REPEAT_S
    was_suppressed: bool = False


class TextLimiter:
    """Limits the texts to one peer. While the cause of a text continues, its repetitions become rarer."""

    def __init__(self) -> None:
        """Start without texts."""
        self._sent_texts: OrderedDict[str, _SentText] = OrderedDict()
        self._tokens = TokenBucket(_MAX_BURST_TEXTS, _MAX_RATE_HZ)

    def admit(self, text: str, now_s: float) -> bool:
        """Return whether a text may be sent now, and count it."""
        last = self._sent_texts.get(text, _SentText(-math.inf))
        age_s = now_s - last.t_s
        if age_s < last.repeat_s:
            self._sent_texts[text] = last._replace(was_suppressed=True)
            return False
        if not self._tokens.spend_one(now_s):
            return False
        cause_continues = last.was_suppressed and age_s < 2.0 * last.repeat_s
        repeat_s = min(2.0 * last.repeat_s, _MAX_REPEAT_S) if cause_continues else _MIN_REPEAT_S
        keep_latest(self._sent_texts, text, _SentText(now_s, repeat_s), _MAX_STORED_TEXTS)
        return True


class RecentWarnings:
    """Latest warnings for stations that connect later, without those of cleared faults."""

    def __init__(self) -> None:
        """Start without warnings."""
        self._events: deque[tuple[float, Event]] = deque(maxlen=_MAX_STORED_WARNINGS)

    def add(self, event: Event, now_s: float) -> None:
        """Store a warning; the text of a recovery removes the warning of its fault."""
        if event.severity <= Severity.WARNING:
            self._events.append((now_s, event))
        elif (cleared_text := _FAULT_TEXT_OF_RECOVERY.get(event.text)) is not None:
            remaining = [(t_s, other) for t_s, other in self._events if other.text != cleared_text]
            self._events = deque(remaining, maxlen=_MAX_STORED_WARNINGS)

    def recent_events(self, now_s: float) -> Iterator[Event]:
        """Yield the warnings with their age in the text, the oldest first."""
        for t_s, event in self._events:
            yield Event(event.severity, _age_prefix(now_s - t_s) + event.text)


def _age_prefix(age_s: float) -> str:
    for min_age_s, unit_s, unit in _AGE_UNITS:
        if age_s >= min_age_s:
            return f"{age_s / unit_s:.0f} {unit} ago: "
    return ""
