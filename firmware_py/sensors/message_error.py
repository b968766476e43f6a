"""Reasons for the rejection of a message, as reported by `rambler decode`."""

from __future__ import annotations

CHECKSUM = "checksum"
NO_CHECKSUM = "no checksum"
MALFORMED = "malformed"
RANGE = "range"


class MessageError(ValueError):
    """A message is rejected for its content; not raised outside this package.

    `error` is CHECKSUM, MALFORMED or RANGE; the text is a short printable reason with the name of the value.
    """

    def __init__(self, error: str, text: str) -> None:
        """Store the error and the text."""
        super().__init__(text)
        self.error = error


def check_range(value: float, low: float, high: float, name: str = "") -> float:
    """Return the value, or raise MessageError if it is outside [low, high] or NaN."""
    if low <= value <= high:
        return value
    raise MessageError(RANGE, f"{name} {value:.10g} out of range".lstrip())
