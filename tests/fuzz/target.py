"""What is fuzzed: a function of bytes, and the refusals that it documents; how an input is cut into records."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

MOST_RECORDS = 64
MOST_LINE = 1000  # characters of a refusal


@dataclass(frozen=True)
class Target:
    """`run` takes any bytes; it may raise `refusals`, each with one line (or as many as `lines`), and nothing else.

    `words` are pieces that an input may well hold; `largest` is the longest input that is tried.
    """

    run: Callable[[bytes], None]
    refusals: tuple[type[Exception], ...] = ()
    words: tuple[bytes, ...] = ()
    largest: int = 4096
    lines: int = 1

    def play(self, data: bytes) -> bool:
        """Run an input; return whether it was taken, False when it was refused."""
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
    """Yield the records of an input: a byte for the kind, one for the length, the body; the last may be cut."""
    at = 0
    for _ in range(MOST_RECORDS):
        if at >= len(data):
            return
        length = data[at + 1] if at + 1 < len(data) else 0
        yield data[at], data[at + 2 : at + 2 + length]
        at += 2 + length


def joined(pairs):
    """Return the input that has these records."""
    return b"".join(bytes((kind, len(body))) + body for kind, body in pairs)


def check_line(text):
    """A message is one line of limited length."""
    assert text
    assert text.isprintable(), repr(text)
    assert len(text) <= MOST_LINE, len(text)


def check_finite(value, name=""):
    """No number of a record, at any depth, is NaN or infinite."""
    if isinstance(value, float):
        assert math.isfinite(value), f"{name} {value}"
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            check_finite(getattr(value, field), field)
    elif isinstance(value, tuple):
        for part in value:
            check_finite(part, name)


def bits(value):
    """Return a value that is equal for equal bits only: -0.0 differs from 0.0."""
    return struct.pack("<d", value)
