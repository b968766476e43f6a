"""Another vehicle with the boat's own system id, which is to be told: what a station orders, both may do.

A frame of the boat's own that a loop in somebody's wiring sends back is none.
"""

from __future__ import annotations

import math

from firmware_py.common.records import Severity
from firmware_py.link.context import LinkContext
from firmware_py.link.telemetry.context_fields import UINT32_MAX, boot_ms
from firmware_py.link.wire.dialect import Message, mavlink

_HEARTBEAT, _SYSTEM_TIME = 0, 2
_OTHERS = 5  # frames that are not this boat's own, before it is told
_APART_S = 2.0  # so far two clocks may differ that are one
_ECHO_S = 60.0  # the age of a frame that comes back
_TELL_AGAIN_S = 600.0


class Namesake:
    """Looks at frames that bear the boat's own ids, and tells once in a while when they are another's."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask what the boat says of herself, and to tell through."""
        self._context = context
        self._others = 0  # in a row
        self._told_s = -math.inf

    def look(self, message: Message, now_s: float) -> None:
        """Look at a frame with the boat's own system and component."""
        number = type(message).id
        if number == _HEARTBEAT:
            if (message.type, message.autopilot) == (mavlink.MAV_TYPE_SURFACE_BOAT, self._context.autopilot):
                return  # may be either's
        elif number != _SYSTEM_TIME:
            return
        elif self._own_time(message, now_s):
            self._others = 0
            return
        self._others += 1
        if self._others >= _OTHERS and now_s - self._told_s >= _TELL_AGAIN_S:
            self._told_s = now_s
            text = f"Another vehicle is system {self._context.system}, too: give one of them another LNK_SYSID"
            self._context.send_text_all(Severity.WARNING, text)

    def _own_time(self, message: Message, now_s: float) -> bool:
        """Whether a SYSTEM_TIME may have been this boat's own, lately: what it says of both clocks."""
        age_s = ((boot_ms(now_s + _APART_S) - message.time_boot_ms) & UINT32_MAX) * 1e-3 - _APART_S
        said_s = message.time_unix_usec * 1e-6
        return age_s <= _ECHO_S and (not said_s or abs(self._context.suppliers.utc_s() - age_s - said_s) < _APART_S)
