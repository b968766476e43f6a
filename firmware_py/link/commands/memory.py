"""Remembers what was done, so that a command that comes again is acknowledged and not done again."""

from __future__ import annotations

from collections import OrderedDict

import msgspec
from msgspec.structs import replace

from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import DOUBLED_S, Correspondent, Sender

RETRY_S = 5.0  # a confirmation within this belongs to the earlier command
SATELLITE_RETRY_S = 600.0  # where an acknowledgement takes two minutes
OVERTAKEN_S = 2.0  # what comes with an older sequence number within this was overtaken on the way, or doubled
RELATIVE_RETRY_S = 30.0  # so long QGroundControl and others go on to repeat what was not acknowledged
REPEAT_S = 1.0  # MAVSDK repeats an unanswered COMMAND_INT after half a second
REMEMBERED = 32
_LATEST = 4  # of each command: a double of an earlier one may come behind its contrary
_NO_RESULT = 5  # MAV_RESULT_IN_PROGRESS


class CommandRecord(msgspec.Struct, frozen=True):
    """A command as it came: when, with which sequence number, what it asked, and who; and its result."""

    t_s: float
    sequence: int
    asked: bytes
    in_whole_numbers: bool  # COMMAND_INT
    station: Correspondent
    result: int = _NO_RESULT


class CommandMemory:
    """The latest few of each command of each station, bounded.

    A relative command done twice turns the boat twice. So those are remembered by the sender's numbers alone: the same
    order by another way is one, even before `Ways` has found that the two ways are one station's.
    """

    def __init__(self) -> None:
        """Start with nothing done."""
        self._done: OrderedDict[tuple[Correspondent | Sender, int], tuple[CommandRecord, ...]] = OrderedDict()

    def __len__(self) -> int:
        """Return how many commands are remembered."""
        return len(self._done)

    def find_original(
        self, command: int, now: CommandRecord, *, confirmed: bool, relative: bool
    ) -> CommandRecord | None:
        """Return the one that this is a retry or a double of, None when it is new."""
        latest, *earlier = self._done.get(_key(now.station, command, relative=relative), (None,))
        if latest is None:
            return None
        if relative:
            for record in (latest, *earlier):
                if _same(record, now) and _is_repeated(record, now, confirmed=confirmed):
                    return record
        if not _same(latest, now):
            return _doubled(now, latest, earlier)
        age_s = now.t_s - latest.t_s
        if confirmed:
            return latest if age_s < (SATELLITE_RETRY_S if now.station.peer.quiet else RETRY_S) else None
        behind = (latest.sequence - now.sequence) & 0xFF
        if behind < 128 and age_s < OVERTAKEN_S:
            return latest
        return latest if relative and now.in_whole_numbers and age_s < REPEAT_S else None

    def remember(self, command: int, done: CommandRecord, *, relative: bool = False) -> None:
        """Remember a command, before those of its kind."""
        key = _key(done.station, command, relative=relative)
        keep_latest(self._done, key, (done, *self._done.get(key, ()))[:_LATEST], REMEMBERED)

    def set_result(
        self, station: Correspondent, command: int, sequence: int, result: int, *, relative: bool = False
    ) -> None:
        """Note the result of the command that came with a sequence number, if it is remembered."""
        key = _key(station, command, relative=relative)
        records = list(self._done.get(key, ()))
        for number, record in enumerate(records):
            if record.sequence == sequence:
                records[number] = replace(record, result=result)
                self._done[key] = tuple(records)
                return


def _key(station: Correspondent, command: int, *, relative: bool) -> tuple[Correspondent | Sender, int]:
    return station.sender if relative else station, command


def _is_repeated(record: CommandRecord, now: CommandRecord, *, confirmed: bool) -> bool:
    """Whether a relative command was executed before: sent again with a confirmation, or a duplicate frame."""
    age_s = now.t_s - record.t_s
    way = now.station.peer.way
    if confirmed:
        return age_s < (SATELLITE_RETRY_S if now.station.peer.quiet else RELATIVE_RETRY_S)
    # A program that was started again counts from 0 again, and comes by a new way.
    there = way is not record.station.peer.way and way.since_s < record.t_s + OVERTAKEN_S
    return there and record.sequence == now.sequence and age_s < DOUBLED_S


def _same(one: CommandRecord, other: CommandRecord) -> bool:
    return one.asked == other.asked and one.in_whole_numbers is other.in_whole_numbers


def _doubled(now: CommandRecord, latest: CommandRecord, earlier: list[CommandRecord]) -> CommandRecord | None:
    """Return the one before the latest of which this is the very frame, which a line has held back and doubled."""
    if now.sequence == latest.sequence:  # a sender that does not count
        return None
    return next(
        (
            record
            for record in earlier
            if record.sequence == now.sequence and _same(record, now) and now.t_s - record.t_s < OVERTAKEN_S
        ),
        None,
    )
