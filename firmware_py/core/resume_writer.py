"""Decides when the resume record is written: at once after commands, with a rate limit to protect the flash card.

A token bucket limits the writes. A stream of goals may use only a part of the tokens, acknowledged goals a larger part,
and commands all of them. So a stream over months causes a write every ten seconds, and commands are not delayed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from msgspec.structs import replace

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.core import last_position
from firmware_py.core.resume import OFF, Moment, Resume, resume_of, to_bytes
from firmware_py.core.state import State

FINE_INTERVAL_S: Final = 30.0  # minimum time between writes of fine changes
MAX_AGE_S: Final = 600.0  # of the stored record
BURST, RATE_HZ = 1000.0, 0.1  # limits of the token bucket


class Difference(IntEnum):
    """Difference of a record from the stored one, in ascending order."""

    NONE = 0
    FINE = 1  # values that change continuously
    GOAL = 2  # goals, which a companion computer or a stick can change many times a second
    ORDER = 3  # mode, arming, mission item, fence


# Minimum number of tokens in the bucket for a write.
_MIN_TOKENS: Final[Mapping[Difference, float]] = {Difference.FINE: 900.0, Difference.GOAL: 900.0, Difference.ORDER: 1.0}
_MIN_TOKENS_ACKNOWLEDGED_GOAL: Final = 100.0


def difference_between(record: Resume, stored: Resume | None) -> Difference:
    """Return the difference of a record from the stored one; None: nothing is stored."""
    if stored is not None and _is_fresh(stored, record):
        record = replace(record, utc_s=stored.utc_s, machine_s=stored.machine_s, place=stored.place)
    if record == stored:
        return Difference.NONE
    if stored is None or _orders(record) != _orders(stored):
        return Difference.ORDER
    return Difference.FINE if _without_fine(record) == _without_fine(stored) else Difference.GOAL


def _is_fresh(stored: Resume, record: Resume) -> bool:
    """Return whether time and position of the stored record are recent enough; False after a change of the clock."""
    if stored.place is None or record.place is None:
        valid_for_s = MAX_AGE_S if stored.place is record.place else 0.0
    else:
        valid_for_s = last_position.valid_for_s(stored.place, MAX_AGE_S)
    return max(abs(record.utc_s - stored.utc_s), record.machine_s - stored.machine_s) < valid_for_s


def _orders(record: Resume) -> tuple[object, ...]:
    """Return the parts of a record that only commands and decisions change."""
    mission = replace(record.mission, elapsed_s=0.0, task=None, line_start=None, pause_task=None)
    return record.modes.mode, record.modes.armed, record.fence_enabled, mission


def _without_fine(record: Resume) -> Resume:
    """Return the record without values that change continuously."""
    return replace(
        record,
        utc_s=0.0,
        machine_s=0.0,
        mission=replace(record.mission, elapsed_s=0.0),
        orbit=replace(record.orbit, turned_rad=0.0),
        water=None,
        place=None,
    )


def _are_identical(parts: tuple[object, ...], others: tuple[object, ...]) -> bool:
    return len(parts) == len(others) and all(part is other for part, other in zip(parts, others, strict=True))


class ResumeWriter:
    """Stored record, and the token bucket of its writes."""

    def __init__(self, begun: Moment) -> None:
        """Start without a stored record; `begun` is the moment at which `now_s` was 0."""
        self._begun = begun
        self._stored: Resume | None = None
        self._last_parts: tuple[object, ...] = ()  # parts of the last state without fine values
        self._fine_due_s = -math.inf
        self._bucket = TokenBucket(BURST, RATE_HZ)
        self.is_current = True  # the stored record is, except for fine changes

    def update(
        self, state: State, now_s: float, utc_s: float, *, is_awaited: bool = False, last: bool = False
    ) -> bytes | None:
        """Return the record to store now; None if it has not changed or the rate limit forbids a write.

        `is_awaited`: an acknowledgement waits for it. `last`: the process ends.
        """
        if state.parameters["BOOT_RESUME"] == OFF:
            # The record on disk is no longer updated.
            self._stored, self._last_parts, self.is_current = None, (), True
            return None
        previous, self._last_parts = self._last_parts, (state.modes, state.guidance, state.plans, state.home)
        if self.is_current and not last and now_s < self._fine_due_s and _are_identical(self._last_parts, previous):
            return None  # in most ticks
        record = resume_of(state, self._begun.at(now_s, utc_s))
        difference = difference_between(record, self._stored)
        if last and record != self._stored:
            difference = max(difference, Difference.FINE)  # for the exact position and time
        may_write = last or self._may_write(difference, now_s, is_awaited=is_awaited)
        if now_s >= self._fine_due_s:
            self._fine_due_s = now_s + FINE_INTERVAL_S
        self.is_current = difference <= Difference.FINE
        if difference is Difference.NONE or not may_write:
            return None
        self._bucket.spend(1.0)
        self._stored, self.is_current = record, True
        self._fine_due_s = now_s + FINE_INTERVAL_S
        return to_bytes(record)

    def _may_write(self, difference: Difference, now_s: float, *, is_awaited: bool) -> bool:
        if difference is Difference.NONE or (difference is Difference.FINE and now_s < self._fine_due_s):
            return False
        is_acknowledged_goal = is_awaited and difference is Difference.GOAL
        return self._bucket.level(now_s) >= (
            _MIN_TOKENS_ACKNOWLEDGED_GOAL if is_acknowledged_goal else _MIN_TOKENS[difference]
        )
