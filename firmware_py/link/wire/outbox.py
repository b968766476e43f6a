"""Messages queued for one peer: by priority, within the rate of the line and of the modem behind it; bounded."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Protocol

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.wire.frames import MAVLINK1, Packed, stamp, to_mavlink1

_BATCH_BYTES = 1200  # several frames share a datagram: one system call for all, and no fragments
_BURST_S = 0.25  # of the line's rate that an idle line may save up
_LONGEST_FRAME = 280  # with its signature
_OFFERED = 10  # every so many heartbeats in MAVLink 1 one is sent in MAVLink 2, too, for a peer that has changed
_HEARTBEAT = bytes(3)  # its number
_STALE_S = 3.0  # queued messages are dropped when a line has been blocked for longer

_BULK_SHARE = 0.7  # of a line, for long transfers: the rest is for telemetry and replies
_FRAMES_AT_ONCE = 44  # on a network, in one call of the loop: four datagrams, about 0.4 ms
_WAITING = 64  # replies, half of the capacity of their queue

_LOW, _FILLING, _EMPTY = 20, 50, 90  # percent of the modem's buffer that is free, as ArduPilot judges it
_PACE_HALF, _PACE_LESS, _PACE_MORE = 0.5, 0.8, 1.15  # of the speed, at each word of the modem: about one a second
_ALL = 100
_SILENT_S = 10.0  # without RADIO_STATUS the line is taken for one without a modem
_MIN_BYTES_S = 120.0  # for heartbeats and replies, whatever a real or forged RADIO_STATUS says


class Priority(IntEnum):
    """Order of sending on a line that is too slow for all messages."""

    URGENT = 0  # heartbeats and acknowledgements
    REPLY = 1  # replies to requests, texts to the operator
    TELEMETRY = 2


class Sealer(Protocol):
    """Signs the frames of one link while there is a key."""

    @property
    def overhead_bytes(self) -> int:
        """Bytes that a signature adds to a frame; 0 without a key."""

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

    A frame gets its sequence number when it leaves, so that a dropped message does not look like loss on the link.
    `dropped` counts messages that found a queue full or exceeded the credit.

    `credit_bytes` limits what is sent to an unproven peer; None: no limit. `mavlink1_only`: messages are sent in
    MAVLink 1, without those that it lacks.
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
        """Take the function that sends and, for a line, its rate in bytes a second."""
        self._send = send
        self._sealer = sealer
        self._byte_rate = byte_rate
        self._bytes: TokenBucket | None = None  # None for a network
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
        """Set the share of the line's rate."""
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
        """Return the number of frames of a size within the credit."""
        return math.inf if self.credit_bytes is None else self.credit_bytes // frame_bytes

    def waiting(self, priority: Priority) -> int:
        """Return the number of queued messages of this and higher priorities."""
        return sum(map(len, self._queues[: priority + 1]))

    def size_of(self, packed: Packed) -> int:
        """Return the bytes of a message on the line."""
        return len(packed.frame) + self._sealer.overhead_bytes

    def room_bytes(self, now_s: float) -> float:
        """Return the room for telemetry on the line, after the queued messages."""
        if self.credit_bytes is not None:
            return 0.0
        if self._bytes is None:
            return float(_BATCH_BYTES * 4)
        level_bytes = self._bytes.level(now_s)
        return level_bytes - sum(self.size_of(packed) for queue in self._queues for packed in queue)

    def flush(self, now_s: float) -> None:
        """Send as much as the line takes now; telemetry that does not fit is dropped, since newer will follow."""
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
        """Return the stamped or signed frames, and the next sequence number; routed frames stay as they are."""
        signs = self._sealer.overhead_bytes > 0
        frames, sequence = [], self._sequence
        for packed in batch:
            if not packed.seed:
                frames.append(packed.frame)
                continue
            first = packed.frame[0] == MAVLINK1  # without signatures
            frames.append(self._sealer.seal(packed, sequence) if signs and not first else stamp(packed, sequence))
            sequence = (sequence + 1) & 0xFF
        return b"".join(frames), sequence

    def _drop_when_blocked(self, now_s: float) -> None:
        """Drop all messages after a line has been blocked for long: old acknowledgements would mislead."""
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
    """The part of a line for long transfers to a peer."""

    __slots__ = ("_byte_rate", "_bytes", "can_continue")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the rate of the line in bytes a second; None for a network."""
        self._byte_rate = byte_rate
        self._bytes: TokenBucket | None = None
        if byte_rate is not None:
            rate = _BULK_SHARE * byte_rate
            burst = max(rate * _BURST_S, float(_LONGEST_FRAME))
            self._bytes = TokenBucket(burst, rate, is_full=False, max_elapsed_s=_BURST_S * 4)
        self.can_continue = False  # another call of the loop could send more at once

    def pace(self, share: float, now_s: float) -> None:
        """Set the share of the line's rate."""
        if self._bytes is not None and self._byte_rate is not None:
            self._bytes.pace(_BULK_SHARE * share * self._byte_rate, now_s)

    def mark_unfinished(self) -> None:
        """Note that a transfer has more to send: on a line at the next tick, on a network at once."""
        self.can_continue = self._bytes is None

    def frames(self, frame_bytes: int, waiting: int, now_s: float) -> int:
        """Return the number of frames of a size that may be queued now, with `waiting` replies in the queue."""
        if waiting >= _WAITING:
            return 0
        if self._bytes is None:
            return _FRAMES_AT_ONCE if waiting == 0 else 0
        return min(int(self._bytes.level(now_s) // frame_bytes), _WAITING - waiting)

    def spend(self, spent_bytes: int) -> None:
        """Count queued bytes."""
        if self._bytes is not None:
            self._bytes.spend(spent_bytes)


class RadioPace:
    """The share of a line's rate that the radio modem behind it accepts, by RADIO_STATUS."""

    __slots__ = ("_heard_s", "_min_share", "share")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the rate of the line in bytes a second; None for a network, which has no modem."""
        self._min_share = 1.0 if byte_rate is None else min(1.0, _MIN_BYTES_S / byte_rate)
        self.share = 1.0
        self._heard_s = 0.0

    def update(self, free_percent: int, now_s: float) -> None:
        """Take the free part of the modem's buffer; a value out of range is ignored."""
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
        """Return to the full rate if the modem reports no more; return whether that is a change."""
        if self.share == 1.0 or now_s - self._heard_s <= _SILENT_S:
            return False
        self.share = 1.0
        return True
