"""Knows a message again that a line has doubled, and perhaps held back until what it asked for is long past."""

from __future__ import annotations

from collections import OrderedDict

from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Correspondent
from firmware_py.link.wire.dialect import Message

_DOUBLED_S = 10.0  # what a line doubles comes within this; who asks again does so with another number
_REMEMBERED = 16


class Marks:
    """The number of the frame by which each station has asked last, of each message and each type of plan; bounded."""

    def __init__(self) -> None:
        """Start without any."""
        self._latest: OrderedDict[tuple[Correspondent, int, int], tuple[tuple[int, int], float]] = OrderedDict()

    def is_double(self, station: Correspondent, message: Message, now_s: float) -> bool:
        """Return whether a message is the latest of its kind once more; note it when it is not."""
        key = (station, type(message).id, message.mission_type)
        mark = (getattr(message, "count", 0), message.get_seq())
        before, seen_s = self._latest.get(key, (None, 0.0))
        if mark == before and now_s - seen_s < _DOUBLED_S:
            return True
        keep_latest(self._latest, key, (mark, now_s), _REMEMBERED)
        return False
