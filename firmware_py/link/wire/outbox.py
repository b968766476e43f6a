"""Messages that wait to be sent to one peer: by priority, at the speed of the line and of the modem behind it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Protocol

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.wire.frames import MAVLINK1, Packed, stamp, to_mavlink1

_BATCH_BYTES = 1200  # several frames share a datagram: one system call for all, and no fragments
_BURST_S = 0.25  # what an idle line may save up
_LONGEST_FRAME = 280  # with its signature
_OFFERED = 10  # of so many heartbeats in MAVLink 1 one goes in MAVLink 2 as well, for who understands it by now
_HEARTBEAT = bytes(3)  # its number
_STALE_S = 3.0  # what could not leave for this long is of no use to anybody

_BULK_SHARE = 0.7  # of a line: the rest is for telemetry and answers
_FRAMES_AT_ONCE = 44  # on a network, in one call of the loop: four datagrams, about 0.4 ms
_WAITING = 64  # messages in the queue of answers; half of what it holds

_LOW, _FILLING, _EMPTY = 20, 50, 90  # percent of the modem's buffer that is free, as ArduPilot judges it
_PACE_HALF, _PACE_LESS, _PACE_MORE = 0.5, 0.8, 1.15  # of the speed, at each word of the modem: about one a second
_ALL = 100
_SILENT_S = 10.0  # a modem that says nothing for so long is none any more
_MIN_BYTES_S = 120.0  # heartbeats and answers in any case, whatever a modem (or who forges one) says


class Priority(IntEnum):
    """What goes first when the line is too slow for everything."""

    URGENT = 0  # heartbeats and acknowledgements
    REPLY = 1  # what a ground station has asked for, messages to the operator
    TELEMETRY = 2


class Sealer(Protocol):
    """Signs what leaves on one link, while there is a key."""

    @property
    def overhead_bytes(self) -> int:
        """What a signature adds to a frame; 0 while there is no key."""

    def seal(self, packed: Packed, sequence: int) -> bytes:
        """Return the frame with this sequence number, signed."""


class Unsealed:
    """Signs nothing."""

    overhead_bytes = 0
    seal = staticmethod(stamp)


_UNSEALED = Unsealed()

_DEPTHS = {Priority.URGENT: 64, Priority.REPLY: 128, Priority.TELEMETRY: 64}


class Outbox:
    """Queues of packed messages and the sequence counter that stamps them.

    A frame gets its sequence number when it leaves, so that what is dropped here does
    not look like loss on the way. `dropped` counts what found a queue full.

    `credit_bytes` is what may be sent to one who may not be where he says he is: what exceeds it is dropped. None is
    without limit. `first_version`: all leaves in MAVLink 1, and what that does not have is left out.
    """

    __slots__ = (
        "_blocked_since_s",
        "_byte_rate",
        "_bytes",
        "_heartbeats",
        "_queues",
        "_sealer",
        "_send",
        "_sequence",
        "credit_bytes",
        "dropped",
        "mavlink1_only",
        "sent_bytes",
    )

    def __init__(self, send: Callable[[bytes], bool], byte_rate: float | None, sealer: Sealer = _UNSEALED) -> None:
        """Take the way out and, for a line, its speed in bytes a second."""
        self._send = send
        self._sealer = sealer
        self._byte_rate = byte_rate
        self._bytes: TokenBucket | None = None  # what the line takes; None for a network
        if byte_rate is not None:
            self._bytes = TokenBucket(max(byte_rate * _BURST_S, _LONGEST_FRAME), byte_rate)
        self._queues: tuple[deque[Packed], ...] = tuple(deque() for _ in Priority)
        self._sequence = 0
        self._blocked_since_s: float | None = None
        self.credit_bytes: int | None = None
        self.dropped = 0
        self.sent_bytes = 0
        self.mavlink1_only = False
        self._heartbeats = 0  # in MAVLink 1

    def pace(self, share: float, now_s: float) -> None:
        """Send at this share of the line's speed from now on."""
        if self._bytes is not None and self._byte_rate is not None:
            self._bytes.pace(share * self._byte_rate, now_s)

    def push(self, packed: Packed, priority: Priority) -> None:
        """Queue a message, or drop and count it."""
        if self.mavlink1_only and packed.seed:
            self._push_mavlink1(packed, priority)
        else:
            self._push(packed, priority)

    def _push_mavlink1(self, packed: Packed, priority: Priority) -> None:
        if packed.frame[7:10] == _HEARTBEAT:
            self._heartbeats += 1
            if self._heartbeats % _OFFERED == 0:
                self._push(packed, priority)
        converted = to_mavlink1(packed)
        if converted is not None:
            self._push(converted, priority)

    def _push(self, packed: Packed, priority: Priority) -> None:
        queue = self._queues[priority]
        if len(queue) >= _DEPTHS[priority] or not self._spend_credit(packed):
            self.dropped += 1
        else:
            queue.append(packed)

    def _spend_credit(self, packed: Packed) -> bool:
        if self.credit_bytes is None:
            return True
        size = self.size_of(packed)
        if size > self.credit_bytes:
            return False
        self.credit_bytes -= size
        return True

    def affordable(self, frame_bytes: int) -> float:
        """Return how many frames of a size its credit pays for."""
        return math.inf if self.credit_bytes is None else self.credit_bytes // frame_bytes

    def waiting(self, priority: Priority) -> int:
        """Return the number of messages of this and higher priorities that wait."""
        return sum(map(len, self._queues[: priority + 1]))

    def size_of(self, packed: Packed) -> int:
        """Return how many bytes a message is on the line."""
        return len(packed.frame) + self._sealer.overhead_bytes

    def room_bytes(self, now_s: float) -> float:
        """Return how much telemetry the line would take now, beside what waits already."""
        if self.credit_bytes is not None:
            return 0.0
        if self._bytes is None:
            return float(_BATCH_BYTES * 4)
        level_bytes = self._bytes.level(now_s)
        return level_bytes - sum(self.size_of(packed) for queue in self._queues for packed in queue)

    def flush(self, now_s: float) -> None:
        """Send what may be sent now; telemetry that does not fit is dropped, since newer will come."""
        while any(self._queues) and (batch := self._batch(now_s)):
            data, sequence = self._stamped(batch)
            if not self._send(data):
                self._drop_when_blocked(now_s)
                break
            self._blocked_since_s = None
            self._sequence = sequence
            self.sent_bytes += len(data)
            if self._bytes is not None:
                self._bytes.spend(len(data))
            self._forget(len(batch))
        self._drop(self._queues[Priority.TELEMETRY])

    def _stamped(self, batch: Sequence[Packed]) -> tuple[bytes, int]:
        """Return the frames as they leave, and the number of the next; what others have packed stays as it is."""
        signs = self._sealer.overhead_bytes > 0
        frames, sequence = [], self._sequence
        for packed in batch:
            if not packed.seed:
                frames.append(packed.frame)
                continue
            first = packed.frame[0] == MAVLINK1  # it has no signatures
            frames.append(self._sealer.seal(packed, sequence) if signs and not first else stamp(packed, sequence))
            sequence = (sequence + 1) & 0xFF
        return b"".join(frames), sequence

    def _drop_when_blocked(self, now_s: float) -> None:
        """Forget what waits once a line has been away for long: old acknowledgements would mislead."""
        if self._blocked_since_s is None:
            self._blocked_since_s = now_s
        elif now_s - self._blocked_since_s > _STALE_S:
            for queue in self._queues:
                self._drop(queue)

    def _drop(self, queue: deque[Packed]) -> None:
        self.dropped += len(queue)
        queue.clear()

    def _batch(self, now_s: float) -> list[Packed]:
        allowed = _BATCH_BYTES if self._bytes is None else min(_BATCH_BYTES, self._bytes.level(now_s))
        batch: list[Packed] = []
        overhead = self._sealer.overhead_bytes
        for queue in self._queues:
            for packed in queue:
                allowed -= len(packed.frame) + overhead
                if allowed < 0:
                    return batch
                batch.append(packed)
        return batch

    def _forget(self, count: int) -> None:
        for queue in self._queues:
            while count and queue:
                queue.popleft()
                count -= 1


class BulkShare:
    """The part of a peer's line that long transfers may use."""

    __slots__ = ("_byte_rate", "_bytes", "can_continue")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the speed of the line in bytes a second; None for a network."""
        self._byte_rate = byte_rate
        self._bytes: TokenBucket | None = None
        if byte_rate is not None:
            rate = _BULK_SHARE * byte_rate
            burst = max(rate * _BURST_S, float(_LONGEST_FRAME))
            self._bytes = TokenBucket(burst, rate, full=False, longest_s=_BURST_S * 4)
        self.can_continue = False  # more could go at once, were the loop to call again

    def pace(self, share: float, now_s: float) -> None:
        """Use the part of this share of the line's speed from now on."""
        if self._bytes is not None and self._byte_rate is not None:
            self._bytes.pace(_BULK_SHARE * share * self._byte_rate, now_s)

    def mark_unfinished(self) -> None:
        """Say that a transfer has more to send: on a line it waits for a tick, on a network it need not."""
        self.can_continue = self._bytes is None

    def frames(self, frame_bytes: int, waiting: int, now_s: float) -> int:
        """Return how many frames of a size may be queued now, where `waiting` answers wait already."""
        if waiting >= _WAITING:
            return 0
        if self._bytes is None:
            return _FRAMES_AT_ONCE if waiting == 0 else 0
        return min(int(self._bytes.level(now_s) // frame_bytes), _WAITING - waiting)

    def spend(self, spent_bytes: int) -> None:
        """Count what has been queued."""
        if self._bytes is not None:
            self._bytes.spend(spent_bytes)


class RadioPace:
    """The share of a line's speed that the modem behind it keeps up with."""

    __slots__ = ("_heard_s", "_min_share", "share")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the speed of the line in bytes a second; a network has no modem in it."""
        self._min_share = 1.0 if byte_rate is None else min(1.0, _MIN_BYTES_S / byte_rate)
        self.share = 1.0
        self._heard_s = 0.0

    def hear(self, free_percent: int, now_s: float) -> None:
        """Take how much of its buffer is free; what cannot be tells nothing."""
        if not 0 <= free_percent <= _ALL:
            return
        self._heard_s = now_s
        if free_percent < _LOW:
            self.share *= _PACE_HALF
        elif free_percent < _FILLING:
            self.share *= _PACE_LESS
        elif free_percent > _EMPTY:
            self.share *= _PACE_MORE
        self.share = min(max(self.share, self._min_share), 1.0)

    def forget(self, now_s: float) -> bool:
        """Go back to all of it where no modem says anything any more; return whether that changes anything."""
        if self.share == 1.0 or now_s - self._heard_s <= _SILENT_S:
            return False
        self.share = 1.0
        return True
