"""STATUSTEXT: messages to the operator, in chunks, and not too many of them."""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from collections.abc import Iterator
from typing import NamedTuple

from firmware_py.common.records import Event, Severity
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.link.latest import keep_latest
from firmware_py.link.wire.dialect import Message, mavlink, text_of

_CHUNK = 50
_LONGEST = 250
_SAME_S = 2.0  # the same text is not repeated within this
_SAME_LATEST_S = 60.0  # limit of this time, which doubles while the cause continues
_KNOWN_TEXTS = 32
_BURST = 8  # texts in a burst
_RATE_HZ = 2.0  # and on average
_REMEMBERED = 5
_AGES = ((172_800.0, 86_400.0, "d"), (7_200.0, 3_600.0, "h"), (60.0, 60.0, "min"))  # minimum age, unit in seconds
_FAULT_OF = {row.recovery: row.text for row in FAULTS.values()}


def text_messages(severity: Severity, text: str, number: int) -> list[Message]:
    """Return the STATUSTEXT messages of a text; `number` identifies the chunks of a long one."""
    data = text_of(text, _LONGEST)
    if len(data) <= _CHUNK:
        return [mavlink.MAVLink_statustext_message(int(severity), data)]
    # A chunk that is not full ends the text, so an empty one follows a full last one.
    starts = range(0, len(data) + 1, _CHUNK)
    return [
        mavlink.MAVLink_statustext_message(int(severity), data[start : start + _CHUNK], number, index)
        for index, start in enumerate(starts)
    ]


class _SentText(NamedTuple):
    """Time of a text, the time until it may be sent again, and whether it was held back since."""

    t_s: float
    quiet_s: float = _SAME_S
    held_back: bool = False


class TextLimiter:
    """Limits repeated texts to one peer: those with a continuous cause become rarer."""

    def __init__(self) -> None:
        """Start with a full burst."""
        self._sent_texts: OrderedDict[str, _SentText] = OrderedDict()
        self._tokens = TokenBucket(_BURST, _RATE_HZ)

    def admit(self, text: str, now_s: float) -> bool:
        """Return whether a text may be sent now, and count it."""
        last = self._sent_texts.get(text, _SentText(-math.inf))
        age_s = now_s - last.t_s
        if age_s < last.quiet_s:
            self._sent_texts[text] = last._replace(held_back=True)
            return False
        if not self._tokens.spend_one(now_s):
            return False
        streams = last.held_back and age_s < 2.0 * last.quiet_s
        quiet_s = min(2.0 * last.quiet_s, _SAME_LATEST_S) if streams else _SAME_S
        keep_latest(self._sent_texts, text, _SentText(now_s, quiet_s), _KNOWN_TEXTS)
        return True


class RecentWarnings:
    """The latest warnings, for stations that connect later, with their age; without cleared faults."""

    def __init__(self) -> None:
        """Start empty."""
        self._events: deque[tuple[float, Event]] = deque(maxlen=_REMEMBERED)

    def note(self, event: Event, now_s: float) -> None:
        """Store a warning; the text of a recovery removes that of its fault."""
        if event.severity <= Severity.WARNING:
            self._events.append((now_s, event))
        elif (gone := _FAULT_OF.get(event.text)) is not None:
            kept = [(told_s, other) for told_s, other in self._events if other.text != gone]
            self._events = deque(kept, maxlen=_REMEMBERED)

    def recent_events(self, now_s: float) -> Iterator[Event]:
        """Yield the warnings, the oldest first."""
        for told_s, event in self._events:
            yield Event(event.severity, _age_prefix(now_s - told_s) + event.text)


def _age_prefix(age_s: float) -> str:
    for least_s, unit_s, unit in _AGES:
        if age_s >= least_s:
            return f"{age_s / unit_s:.0f} {unit} ago: "
    return ""
