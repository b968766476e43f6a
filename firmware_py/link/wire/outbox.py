"""Bounded queues of messages to one peer, sent by priority and at most at the rate of the line and of its modem."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Protocol

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.wire.frames import MAVLINK1, MAX_FRAME_BYTES, Packed, stamp, to_mavlink1

_MAX_BATCH_BYTES = 1200  # of the frames in one datagram: one system call and no IP fragments
_MAX_BURST_S = 0.25  # sending time at the rate of the line that an idle line may accumulate
# A peer that changed to MAVLink 2 is detected by its reply to these heartbeats.
_HEARTBEATS_PER_MAVLINK2_HEARTBEAT = 10
_HEARTBEAT_NUMBER = bytes(3)
_MAX_BLOCKED_S = 3.0  # queued messages are dropped when a line has been blocked for longer

_BULK_SHARE = 0.7  # of the rate of a line, for long transfers; the rest is for telemetry and replies
_MAX_NETWORK_FRAMES = 44  # in one call of the loop: four datagrams, about 0.4 ms
_MAX_QUEUED_REPLIES = 64  # with which a long transfer continues: half of the capacity of their queue

# Free share of the buffer of the modem in percent, as in ArduPilot, and the factors of the rate at each RADIO_STATUS,
# which a modem sends about once per second.
_LOW_PERCENT, _REDUCED_PERCENT, _HIGH_PERCENT = 20, 50, 90
_LOW_FACTOR, _REDUCED_FACTOR, _HIGH_FACTOR = 0.5, 0.8, 1.15
_MAX_PERCENT = 100
_MODEM_TIMEOUT_S = 10.0  # after this time without RADIO_STATUS the full rate applies
_MIN_BYTE_RATE = 120.0  # bytes per second for heartbeats and replies, even if a forged RADIO_STATUS reports less


class Priority(IntEnum):
    """Order of sending."""

    URGENT = 0  # heartbeats and acknowledgements
    REPLY = 1  # replies to requests, texts to the operator
    TELEMETRY = 2


class Sealer(Protocol):
    """Signs the frames of one link while there is a key."""

    @property
    def overhead_bytes(self) -> int:
        """Bytes that a signature adds to a frame; 0 without a key."""

    def seal(self, packed: Packed, sequence: int) -> bytes:
        """Return the signed frame with this sequence number."""


class UnsignedSealer:
    """Sealer without a key: frames are not signed."""

    overhead_bytes = 0
    seal = staticmethod(stamp)


_UNSIGNED = UnsignedSealer()

_MAX_QUEUED = {Priority.URGENT: 64, Priority.REPLY: 128, Priority.TELEMETRY: 64}


class Outbox:
    """Queues of packed messages to one peer, and its sequence counter.

    A frame receives its sequence number when it is sent, so that a dropped message does not look like loss on the link.
    `dropped` counts messages that exceeded a queue or the credit and messages dropped from a queue.

    `credit_bytes` limits the data to an unproven peer; None: no limit. `is_mavlink1_only`: messages are sent in
    MAVLink 1, and messages that MAVLink 1 lacks are not sent.
    """

    __slots__ = (
        "_blocked_since_s",
        "_bytes",
        "_mavlink1_heartbeats",
        "_queues",
        "_sealer",
        "_send",
        "_sequence",
        "credit_bytes",
        "dropped",
        "is_mavlink1_only",
        "sent_bytes",
    )

    def __init__(self, send: Callable[[bytes], bool], byte_rate: float | None, sealer: Sealer = _UNSIGNED) -> None:
        """Store the function that sends data; `byte_rate` is in bytes per second, None for a network."""
        self._send = send
        self._sealer = sealer
        self._bytes: TokenBucket | None = None  # None for a network
        if byte_rate is not None:
            self._bytes = TokenBucket(max(byte_rate * _MAX_BURST_S, MAX_FRAME_BYTES), byte_rate)
        self._queues: tuple[deque[Packed], ...] = tuple(deque() for _ in Priority)
        self._sequence = 0
        self._blocked_since_s: float | None = None
        self.credit_bytes: int | None = None
        self.dropped = 0
        self.sent_bytes = 0
        self.is_mavlink1_only = False
        self._mavlink1_heartbeats = 0

    def set_rate_share(self, share: float, now_s: float) -> None:
        """Limit sending to a share (0 to 1) of the rate of the line."""
        if self._bytes is not None:
            self._bytes.set_rate_share(share, now_s)

    def push(self, packed: Packed, priority: Priority) -> None:
        """Queue a message; drop and count it if the queue is full or the credit is spent."""
        if self.is_mavlink1_only and packed.seed:
            self._push_mavlink1(packed, priority)
        else:
            self._push(packed, priority)

    def _push_mavlink1(self, packed: Packed, priority: Priority) -> None:
        if packed.frame[7:10] == _HEARTBEAT_NUMBER:
            self._mavlink1_heartbeats += 1
            if self._mavlink1_heartbeats % _HEARTBEATS_PER_MAVLINK2_HEARTBEAT == 0:
                self._push(packed, priority)
        converted = to_mavlink1(packed)
        if converted is not None:
            self._push(converted, priority)

    def _push(self, packed: Packed, priority: Priority) -> None:
        queue = self._queues[priority]
        if len(queue) >= _MAX_QUEUED[priority] or not self._spend_credit(packed):
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

    def frames_in_credit(self, frame_bytes: int) -> float:
        """Return the number of frames of a size within the credit; infinity without a limit."""
        return math.inf if self.credit_bytes is None else self.credit_bytes // frame_bytes

    def queued_count(self, priority: Priority) -> int:
        """Return the number of queued messages of this and higher priorities."""
        return sum(map(len, self._queues[: priority + 1]))

    def size_of(self, packed: Packed) -> int:
        """Return the size of a message in bytes, with its signature."""
        return len(packed.frame) + self._sealer.overhead_bytes

    def available_bytes(self, now_s: float) -> float:
        """Return the bytes that may be queued in addition and sent at once; 0 for an unproven peer."""
        if self.credit_bytes is not None:
            return 0.0
        if self._bytes is None:
            return float(_MAX_BATCH_BYTES * 4)
        level_bytes = self._bytes.level(now_s)
        return level_bytes - sum(self.size_of(packed) for queue in self._queues for packed in queue)

    def flush(self, now_s: float) -> None:
        """Send as much as the rate of the line allows; drop the remaining telemetry, since newer follows."""
        while any(self._queues) and (batch := self._next_batch(now_s)):
            data, sequence = self._stamp_batch(batch)
            if not self._send(data):
                self._drop_when_blocked(now_s)
                break
            self._blocked_since_s = None
            self._sequence = sequence
            self.sent_bytes += len(data)
            if self._bytes is not None:
                self._bytes.spend(len(data))
            self._remove_sent(len(batch))
        self._drop(self._queues[Priority.TELEMETRY])

    def _stamp_batch(self, batch: Sequence[Packed]) -> tuple[bytes, int]:
        """Return the stamped or signed frames, and the next sequence number; routed frames are not changed."""
        has_key = self._sealer.overhead_bytes > 0
        frames, sequence = [], self._sequence
        for packed in batch:
            if not packed.seed:
                frames.append(packed.frame)
                continue
            signs = has_key and packed.frame[0] != MAVLINK1  # MAVLink 1 has no signatures
            frames.append(self._sealer.seal(packed, sequence) if signs else stamp(packed, sequence))
            sequence = (sequence + 1) & 0xFF
        return b"".join(frames), sequence

    def _drop_when_blocked(self, now_s: float) -> None:
        """Drop all messages when the line has been blocked for long: old acknowledgements would mislead."""
        if self._blocked_since_s is None:
            self._blocked_since_s = now_s
        elif now_s - self._blocked_since_s > _MAX_BLOCKED_S:
            for queue in self._queues:
                self._drop(queue)

    def _drop(self, queue: deque[Packed]) -> None:
        self.dropped += len(queue)
        queue.clear()

    def _next_batch(self, now_s: float) -> list[Packed]:
        """Return the first messages in order of priority that fit into one datagram and the rate of the line."""
        remaining_bytes = _MAX_BATCH_BYTES if self._bytes is None else min(_MAX_BATCH_BYTES, self._bytes.level(now_s))
        batch: list[Packed] = []
        overhead = self._sealer.overhead_bytes
        for queue in self._queues:
            for packed in queue:
                remaining_bytes -= len(packed.frame) + overhead
                if remaining_bytes < 0:
                    return batch
                batch.append(packed)
        return batch

    def _remove_sent(self, count: int) -> None:
        for queue in self._queues:
            while count and queue:
                queue.popleft()
                count -= 1


class BulkShare:
    """Share of the rate of a line for long transfers to a peer."""

    __slots__ = ("_bytes", "can_continue")

    def __init__(self, byte_rate: float | None) -> None:
        """Store the rate of the line in bytes per second; None for a network."""
        self._bytes: TokenBucket | None = None
        if byte_rate is not None:
            rate = _BULK_SHARE * byte_rate
            burst = max(rate * _MAX_BURST_S, float(MAX_FRAME_BYTES))
            self._bytes = TokenBucket(burst, rate, is_full=False, max_elapsed_s=_MAX_BURST_S * 4)
        self.can_continue = False  # whether the loop may send more before the next tick

    def set_rate_share(self, share: float, now_s: float) -> None:
        """Limit sending to a share (0 to 1) of the rate of the line."""
        if self._bytes is not None:
            self._bytes.set_rate_share(share, now_s)

    def mark_unfinished(self) -> None:
        """Register that a transfer has more data: a line continues at the next tick, a network at once."""
        self.can_continue = self._bytes is None

    def max_frames(self, frame_bytes: int, queued_replies: int, now_s: float) -> int:
        """Return the number of frames of a size that may be queued now."""
        if queued_replies >= _MAX_QUEUED_REPLIES:
            return 0
        if self._bytes is None:
            return _MAX_NETWORK_FRAMES if queued_replies == 0 else 0
        return min(int(self._bytes.level(now_s) // frame_bytes), _MAX_QUEUED_REPLIES - queued_replies)

    def spend(self, spent_bytes: int) -> None:
        """Count queued bytes."""
        if self._bytes is not None:
            self._bytes.spend(spent_bytes)


class RadioRate:
    """Share of the rate of a line that its radio modem accepts, from RADIO_STATUS."""

    __slots__ = ("_min_share", "_status_s", "share")

    def __init__(self, byte_rate: float | None) -> None:
        """Store the rate of the line in bytes per second; None for a network, which has no modem."""
        self._min_share = 1.0 if byte_rate is None else min(1.0, _MIN_BYTE_RATE / byte_rate)
        self.share = 1.0
        self._status_s = 0.0  # time of the latest RADIO_STATUS

    def update(self, free_percent: int, now_s: float) -> None:
        """Adapt the share to the free part of the buffer of the modem; ignore a value out of range."""
        if not 0 <= free_percent <= _MAX_PERCENT:
            return
        self._status_s = now_s
        if free_percent < _LOW_PERCENT:
            self.share *= _LOW_FACTOR
        elif free_percent < _REDUCED_PERCENT:
            self.share *= _REDUCED_FACTOR
        elif free_percent > _HIGH_PERCENT:
            self.share *= _HIGH_FACTOR
        self.share = min(max(self.share, self._min_share), 1.0)

    def reset_after_silence(self, now_s: float) -> bool:
        """Return to the full rate if RADIO_STATUS is missing; return whether the share changed."""
        if self.share == 1.0 or now_s - self._status_s <= _MODEM_TIMEOUT_S:
            return False
        self.share = 1.0
        return True
