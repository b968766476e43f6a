"""Remembers what was done, so that a command that comes again is acknowledged and not done again."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace

from firmware_py.common.record_class import dataclass
from firmware_py.link.peer import Peer

RETRY_S = 5.0  # a confirmation within this belongs to the earlier command
SATELLITE_RETRY_S = 600.0  # where an acknowledgement takes two minutes
OVERTAKEN_S = 2.0  # what comes with an older sequence number within this was overtaken on the way, or doubled
REPEAT_S = 1.0  # MAVSDK repeats an unanswered COMMAND_INT after half a second
REMEMBERED = 32
_NO_RESULT = 5  # MAV_RESULT_IN_PROGRESS


@dataclass(frozen=True, slots=True)
class CommandRecord:
    """A command as it came: when, with which sequence number, what it asked, over which peer; and its result."""

    t_s: float
    sequence: int
    asked: bytes
    in_whole_numbers: bool  # COMMAND_INT
    peer: Peer
    result: int = _NO_RESULT


class CommandMemory:
    """The latest of each command of each sender, bounded; two that have one number and come by two ways are two."""

    def __init__(self) -> None:
        """Start with nothing done."""
        self._done: OrderedDict[tuple[Peer, int, int, int], CommandRecord] = OrderedDict()

    def __len__(self) -> int:
        """Return how many are remembered."""
        return len(self._done)

    def find_original(
        self, sender: tuple[int, int], command: int, now: CommandRecord, *, confirmed: bool, relative: bool
    ) -> CommandRecord | None:
        """Return the one that this is a retry or a double of, None when it is new."""
        done = self._done.get((now.peer, *sender, command))
        if done is None or done.asked != now.asked or done.in_whole_numbers is not now.in_whole_numbers:
            return None
        age_s = now.t_s - done.t_s
        if confirmed:
            return done if age_s < (SATELLITE_RETRY_S if now.peer.quiet else RETRY_S) else None
        behind = (done.sequence - now.sequence) & 0xFF
        if behind < 128 and age_s < OVERTAKEN_S:
            return done
        return done if relative and now.in_whole_numbers and age_s < REPEAT_S else None

    def remember(self, sender: tuple[int, int], command: int, done: CommandRecord) -> None:
        """Remember a command, in place of the one of its kind."""
        key = (done.peer, *sender, command)
        self._done[key] = done
        self._done.move_to_end(key)
        if len(self._done) > REMEMBERED:
            self._done.popitem(last=False)

    def set_result(self, peer: Peer, sender: tuple[int, int], command: int, result: int) -> None:
        """Note the result of the command that is remembered."""
        key = (peer, *sender, command)
        if key in self._done:
            self._done[key] = replace(self._done[key], result=result)
