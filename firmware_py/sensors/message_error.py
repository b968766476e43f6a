"""Why a message is refused, in the words of `rambler decode`."""

from __future__ import annotations

CHECKSUM = "checksum"
NO_CHECKSUM = "no checksum"
MALFORMED = "malformed"
RANGE = "range"


class MessageError(ValueError):
    """A message is refused by its content; never leaves this package.

    `error` is MALFORMED or RANGE; the text says which value and why, short and printable.
    """

    def __init__(self, error: str, text: str) -> None:
        """Keep the error and the text."""
        super().__init__(text)
        self.error = error


def within(value: float, low: float, high: float, name: str = "") -> float:
    """Return the value, or raise MessageError when it is outside [low, high] or not a number."""
    if low <= value <= high:
        return value
    raise MessageError(RANGE, f"{name} {value:.10g} out of range".lstrip())
