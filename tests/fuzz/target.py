"""A fuzz target: a function of bytes and its allowed errors; division of an input into records; checks."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

MAX_RECORDS = 64
MAX_LINE_LENGTH = 1000  # characters of a refusal


@dataclass(frozen=True)
class Target:
    """A function `run` that accepts any bytes or raises one of `refusals` with at most `lines` lines.

    `words`: typical parts of inputs. `max_bytes`: length of the longest input.
    """

    run: Callable[[bytes], None]
    refusals: tuple[type[Exception], ...] = ()
    words: tuple[bytes, ...] = ()
    max_bytes: int = 4096
    lines: int = 1

    def play(self, data: bytes) -> bool:
        """Run an input; return True if it was accepted, False if it was refused."""
        try:
            self.run(data)
        except self.refusals as refusal:
            lines = str(refusal).split("\n")
            assert len(lines) <= self.lines, len(lines)
            for line in lines:
                check_line(line)
            return False
        return True


def records(data: bytes):
    """Yield kind and body of each record (kind, length, body); the last one may be truncated."""
    offset = 0
    for _ in range(MAX_RECORDS):
        if offset >= len(data):
            return
        length = data[offset + 1] if offset + 1 < len(data) else 0
        yield data[offset], data[offset + 2 : offset + 2 + length]
        offset += 2 + length


def join_records(pairs):
    """Return the input with these records."""
    return b"".join(bytes((kind, len(body))) + body for kind, body in pairs)


def check_line(text):
    """Check that a text is one printable line of limited length."""
    assert text
    assert text.isprintable(), repr(text)
    assert len(text) <= MAX_LINE_LENGTH, len(text)


def check_finite(value, name=""):
    """Check that no number of a record, at any depth, is NaN or infinite."""
    if isinstance(value, float):
        assert math.isfinite(value), f"{name} {value}"
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            check_finite(getattr(value, field), field)
    elif isinstance(value, tuple):
        for item in value:
            check_finite(item, name)


def float_bits(value):
    """Return the bytes of a number, so that -0.0 differs from 0.0."""
    return struct.pack("<d", value)
