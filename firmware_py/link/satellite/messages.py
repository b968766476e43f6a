"""What waits to be sent by satellite, and how several frames share a message."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping

import msgspec

from firmware_py.link.satellite.budget import Kind
from firmware_py.link.satellite.modem import LONGEST_OUT

_DEPTHS: Mapping[Kind, int] = {Kind.EVENT: 16, Kind.REPORT: 24, Kind.ANSWER: 16}


class Bundle(msgspec.Struct, frozen=True):
    """Frames that go out in one message."""

    frames: tuple[tuple[Kind, bytes], ...] = ()

    @property
    def content(self) -> bytes:
        """The message."""
        return b"".join(frame for _, frame in self.frames)


class MessageQueue:
    """What waits, by kind and never without bound; nothing leaves it but by `remove`, or is counted in `dropped`.

    A report that finds the queue full takes the place of the oldest: where she is now is worth more than where she was.
    """

    def __init__(self) -> None:
        """Start with nothing."""
        self._queues: Mapping[Kind, deque[bytes]] = {kind: deque() for kind in _DEPTHS}
        self.dropped: dict[Kind, int] = dict.fromkeys(_DEPTHS, 0)

    def __len__(self) -> int:
        """Return how many frames wait."""
        return sum(len(queue) for queue in self._queues.values())

    def offer(self, kind: Kind, frame: bytes) -> None:
        """Queue a frame, or drop one and count it."""
        queue = self._queues[kind]
        if len(queue) >= _DEPTHS[kind]:
            self.dropped[kind] += 1
            if kind is not Kind.REPORT:
                return
            queue.popleft()
        queue.append(frame)

    def compose(self, fits: Callable[[Kind, int], bool]) -> Bundle:
        """Return what goes out next: events, then the newest reports, then answers, as far as `fits` pays for it.

        `fits` takes the kind of the last frame and the bytes of the whole message.
        """
        frames: list[tuple[Kind, bytes]] = []
        size = 0
        for kind, frame in self._in_order():
            longer = size + len(frame)
            if longer <= LONGEST_OUT and fits(kind, longer):
                frames.append((kind, frame))
                size = longer
        return Bundle(tuple(frames))

    def _in_order(self) -> Iterator[tuple[Kind, bytes]]:
        for kind, queue in self._queues.items():
            for frame in reversed(queue) if kind is Kind.REPORT else queue:
                yield kind, frame

    def remove(self, bundle: Bundle) -> None:
        """Forget what was sent; a report that has lost its place meanwhile is gone already."""
        for kind, frame in bundle.frames:
            if frame in self._queues[kind]:
                self._queues[kind].remove(frame)
