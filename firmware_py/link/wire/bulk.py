"""How much of a long transfer goes to a peer at one time, beside its telemetry and answers."""

from __future__ import annotations

from firmware_py.common.token_bucket import TokenBucket

_SHARE = 0.7  # of a line: the rest is for telemetry and answers
_BURST_S = 0.25  # what an idle line may save up, as in the outbox
_LONGEST_FRAME = 280
_FRAMES_AT_ONCE = 44  # on a network, in one call of the loop: four datagrams, about 0.4 ms
_WAITING = 64  # messages in the queue of answers; half of what it holds


class BulkShare:
    """The part of a peer's line that long transfers may use."""

    __slots__ = ("_byte_rate", "_bytes", "can_continue")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the speed of the line in bytes a second; None for a network."""
        self._byte_rate = byte_rate
        self._bytes: TokenBucket | None = None
        if byte_rate is not None:
            rate = _SHARE * byte_rate
            burst = max(rate * _BURST_S, float(_LONGEST_FRAME))
            self._bytes = TokenBucket(burst, rate, full=False, longest_s=_BURST_S * 4)
        self.can_continue = False  # more could go at once, were the loop to call again

    def pace(self, share: float, now_s: float) -> None:
        """Use the part of this share of the line's speed from now on."""
        if self._bytes is not None and self._byte_rate is not None:
            self._bytes.pace(_SHARE * share * self._byte_rate, now_s)

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
