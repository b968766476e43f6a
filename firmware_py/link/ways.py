"""Knows one station that comes by several ways, and each of its frames that comes by more than one.

A router sends what its station says over all the links that lead to the boat, byte for byte; a NAT gives a station
another port in the middle of a transfer. To the services a station is one all the while, however it comes: what was
begun by one way goes on by another, and a frame is heard once, by the way by which it came first.

Nothing but the ids and the count of its frames tells a station, and two stations may have the same ids: so ways are
one station's after several frames that are alike to the byte, and two stations' as soon as two frames of one number
are not. Two that say the same at the same time, byte for byte and number for number, are taken for one.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple

from firmware_py.link.latest import keep_latest

DOUBLED_S = 10.0  # a frame that comes by another way does so within this
ALIKE = 3  # so many frames alike make two ways one station's
PARTED = 10  # and so many more where they were found to be two's
MOVED_S = 10.0  # a station that comes by another port goes on within this
LOST = 16  # its frames that may be lost meanwhile
_SENDERS = 8
_NUMBERS = 256
_MAVLINK2 = 0xFD

Sender = tuple[int, int]  # MAVLink system and component


class Way:
    """One way to the boat, and the station that comes by it; `place` is the transport and the computer it is of."""

    __slots__ = ("alike", "heard_s", "place", "since_s", "station")

    def __init__(self, place: object, now_s: float) -> None:
        """Begin as the way of a station of its own."""
        self.place = place
        self.since_s = self.heard_s = now_s
        self.station = object()
        self.alike = 0  # frames that another station was heard to send, too


class _Heard(NamedTuple):
    """A frame as it came first."""

    mark: int
    way: Way
    t_s: float
    order: int  # among its sender's frames


class _Sender:
    """The latest frame of each number of one sender."""

    __slots__ = ("by_number", "count", "last_number")

    def __init__(self) -> None:
        self.by_number: dict[int, _Heard] = {}
        self.count = 0
        self.last_number = 0


class Ways:
    """The latest frames of the latest few senders, and by which way each came first; bounded."""

    def __init__(self) -> None:
        """Start with nothing heard."""
        self._senders: OrderedDict[Sender, _Sender] = OrderedDict()

    def is_double(self, way: Way, frame: bytes, now_s: float) -> bool:
        """Return whether a frame has come already by another way of its station; learn whose way this is.

        What comes twice by one way is not judged: each service knows what to do with it.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        before = None if known is None else known.by_number.get(number)
        way.heard_s = now_s
        if before is None or before.way is way or now_s - before.t_s > DOUBLED_S or before.mark != hash(frame):
            return False
        if before.way.station is way.station:
            return True
        # A program that was started again says what it said before, but not by two ways at once.
        if before.way.heard_s > way.since_s:
            way.alike += 1
            if way.alike >= ALIKE:
                way.station = before.way.station
        return False

    def note(self, way: Way, frame: bytes, now_s: float) -> None:
        """Note a frame that was heard; a number that another frame of the same station bears parts the two ways."""
        sender, number = _address(frame)
        known = self._senders.get(sender) or _Sender()
        mark, before = hash(frame), known.by_number.get(number)
        if before is not None and before.way is not way and now_s - before.t_s <= DOUBLED_S:
            if before.mark == mark:
                return  # it stays the other way's, which is not known to be the same station's yet
            if before.way.station is way.station and known.count - before.order < _NUMBERS // 2:
                way.station, way.alike = object(), -PARTED
        known.count += 1
        known.last_number = number
        known.by_number[number] = _Heard(mark, way, now_s, known.count)
        keep_latest(self._senders, sender, known, _SENDERS)

    def follow(self, way: Way, frame: bytes, now_s: float, *, verified: bool) -> None:
        """Take a new way for that of a station whose frames it goes on with: from the same computer, or signed.

        Who begins with 0 is a program that was started just now, such as a script beside the station.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        if known is None or number == 0:
            return
        last = known.by_number[known.last_number]
        goes_on = 1 <= (number - known.last_number) % _NUMBERS <= LOST
        if goes_on and (verified or last.way.place == way.place) and now_s - last.t_s <= MOVED_S:
            way.station = last.way.station


def _address(frame: bytes) -> tuple[Sender, int]:
    """Return who sent a frame, and its number."""
    if frame[0] == _MAVLINK2:
        return (frame[5], frame[6]), frame[4]
    return (frame[3], frame[4]), frame[2]
