"""A command for the boat in the keyed short form (docs/how-to/satellite.md), independent of the boat's decoder."""

from __future__ import annotations

import hashlib
import hmac
import struct
from typing import Any

_FIRST_BYTE = 0xB5
_CONTEXT = b"sbd short form 1"
_EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
_UNITS_HZ = 100
_CODE_BYTES = 8


class MessageNumbers:
    """Strictly increasing message numbers, which state the time of writing in units of 10 ms."""

    def __init__(self) -> None:
        """Start without a message."""
        self._last = 0

    def next(self, utc_s: float) -> int:
        """Return the number of a message written at utc_s."""
        self._last = max(int((utc_s - _EPOCH_S) * _UNITS_HZ), self._last + 1)
        return self._last


def encode(message: Any, sender: tuple[int, int], number: int, key: bytes, imei: str) -> bytes:
    """Return a MAVLink message of a sender (system, component) in the short form, bound to key and modem."""
    frame = message.get_msgbuf()
    # The payload of a MAVLink 2 or 1 frame, without the trailing zeros.
    payload = bytes(frame[10 : 10 + frame[1]] if frame[0] == 0xFD else frame[6 : 6 + frame[1]]).rstrip(b"\0") or b"\0"
    signed_bytes = (
        bytes((_FIRST_BYTE,))
        + number.to_bytes(5, "little")
        + struct.pack("<BBH", *sender, message.get_msgId())
        + payload
    )
    code = hmac.new(key, _CONTEXT + imei.encode("ascii") + signed_bytes, hashlib.sha256).digest()
    return signed_bytes + code[:_CODE_BYTES]
