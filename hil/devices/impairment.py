"""Faults of a serial line and of its device: a wrapper that corrupts the bytes of any emulator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hil.devices.emulator import Emulator

_MAX_GARBAGE_BYTES = 16

Span = tuple[float, float]  # begin and end, s


class Impaired:
    """An emulator behind a line that loses, changes, duplicates and inserts bytes.

    `drop`, `flip` (one bit) and `duplicate` are probabilities per byte, in both directions; `garbage` is the
    probability per message of 1 to 16 random bytes before it. `silent` suppresses the output, `deaf` the commands to
    the device; `frozen` repeats the last message at the device's rate. All may be changed at any time. During the
    spans the line is silent, deaf or frozen.
    """

    def __init__(
        self,
        emulator: Emulator,
        rng: np.random.Generator,
        *,
        drop: float = 0.0,
        flip: float = 0.0,
        duplicate: float = 0.0,
        garbage: float = 0.0,
        silent_spans: Sequence[Span] = (),
        deaf_spans: Sequence[Span] = (),
        frozen_spans: Sequence[Span] = (),
    ) -> None:
        """Wrap an emulator; with the defaults bytes are unchanged and no random numbers are drawn."""
        self.drop = drop
        self.flip = flip
        self.duplicate = duplicate
        self.garbage = garbage
        self.silent = False
        self.deaf = False
        self.frozen = False
        self.silent_spans = silent_spans
        self.deaf_spans = deaf_spans
        self.frozen_spans = frozen_spans
        self._emulator = emulator
        self._rng = rng
        self._last_message = b""

    def receive(self, now_s: float, data: bytes) -> None:
        """Corrupt and forward commands, unless the line is deaf."""
        if not (self.deaf or _is_within(now_s, self.deaf_spans)):
            self._emulator.receive(now_s, self._corrupt(data))

    def next_output_s(self) -> float:
        """Return the time of the device's next output."""
        return self._emulator.next_output_s()

    def take_output(self, now_s: float) -> bytes:
        """Return the output of the device, corrupted; no bytes while silent."""
        data = self._emulator.take_output(now_s)
        if not data:
            return b""
        if self.frozen or _is_within(now_s, self.frozen_spans):
            data = self._last_message or data
        self._last_message = data
        if self.silent or _is_within(now_s, self.silent_spans):
            return b""
        return self._corrupt(data)

    def _corrupt(self, data: bytes) -> bytes:
        if not data or not (self.drop or self.flip or self.duplicate or self.garbage):
            return data
        corrupted = bytearray()
        if self._rng.random() < self.garbage:
            corrupted += self._rng.bytes(int(self._rng.integers(1, _MAX_GARBAGE_BYTES + 1)))
        draws = self._rng.random((len(data), 3))
        bits = self._rng.integers(0, 8, len(data))
        for byte, (drop, flip, duplicate), bit in zip(data, draws, bits, strict=True):
            if drop < self.drop:
                continue
            received = byte ^ (1 << int(bit)) if flip < self.flip else byte
            corrupted += bytes([received]) * (2 if duplicate < self.duplicate else 1)
        return bytes(corrupted)


def _is_within(now_s: float, spans: Sequence[Span]) -> bool:
    return any(begin_s <= now_s < end_s for begin_s, end_s in spans)
