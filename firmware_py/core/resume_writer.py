"""Decides when the resume record is written: at once after commands, but rate-limited to protect the flash card.

A token bucket limits the writes. Streams of goals leave most tokens to acknowledged goals, and those leave the rest to
commands: a stream over months causes a write in ten seconds, and no operator waits for a write.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from msgspec.structs import replace

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.core import last_position
from firmware_py.core.resume import NOTHING, Moment, Resume, resume_of, to_bytes
from firmware_py.core.state import State

FINE_INTERVAL_S: Final = 30.0
REFRESH_S: Final = 600.0  # maximum age of the record
BURST, RATE_HZ = 1000.0, 0.1  # limit of writes


class Difference(IntEnum):
    """Difference of a record from the stored one, in ascending order."""

    NONE = 0
    FINE = 1  # values that change continuously
    GOAL = 2  # goals, which a companion computer or a stick may change many times a second
    ORDER = 3  # mode, arming, mission item, fence


# Minimum number of tokens in the bucket for a write.
_MIN_TOKENS: Final[Mapping[Difference, float]] = {Difference.FINE: 900.0, Difference.GOAL: 900.0, Difference.ORDER: 1.0}
_MIN_TOKENS_ACKNOWLEDGED_GOAL: Final = 100.0


def difference_between(record: Resume, stored: Resume | None) -> Difference:
    """Return the difference of a record from the stored one (None: there is none)."""
    if stored is not None and _is_fresh(stored, record):
        record = replace(record, utc_s=stored.utc_s, machine_s=stored.machine_s, place=stored.place)
    if record == stored:
        return Difference.NONE
    if stored is None or _orders(record) != _orders(stored):
        return Difference.ORDER
    return Difference.FINE if _without_fine(record) == _without_fine(stored) else Difference.GOAL


def _is_fresh(stored: Resume, record: Resume) -> bool:
    """Return whether time and position of the stored record are still good enough; not after a clock change."""
    if stored.place is None or record.place is None:
        valid_for_s = REFRESH_S if stored.place is record.place else 0.0
    else:
        valid_for_s = last_position.valid_for_s(stored.place, REFRESH_S)
    return max(abs(record.utc_s - stored.utc_s), record.machine_s - stored.machine_s) < valid_for_s


def _orders(record: Resume) -> tuple[object, ...]:
    mission = replace(record.mission, elapsed_s=0.0, task=None, line_start=None, pause_task=None)
    return record.modes.mode, record.modes.armed, record.fence_enabled, mission


def _without_fine(record: Resume) -> Resume:
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
    """Decides when the record is written, by the last record and the recent number of writes."""

    def __init__(self, begun: Moment) -> None:
        """Start without a record; `begun` is the moment at which `now_s` was 0."""
        self._begun = begun
        self._stored: Resume | None = None
        self._seen: tuple[object, ...] = ()  # parts of the last state, without fine values
        self._fine_due_s = -math.inf
        self._bucket = TokenBucket(BURST, RATE_HZ)
        self.is_current = True  # except for fine changes

    def update(
        self, state: State, now_s: float, utc_s: float, *, is_awaited: bool = False, last: bool = False
    ) -> bytes | None:
        """Return the record to be stored now; None if it has not changed or the rate limit forbids it.

        `is_awaited`: an acknowledgement waits for it. `last`: the process ends.
        """
        if state.parameters["BOOT_RESUME"] == NOTHING:
            # The record on disk is no longer updated.
            self._stored, self._seen, self.is_current = None, (), True
            return None
        before, self._seen = self._seen, (state.modes, state.guidance, state.plans, state.home)
        if self.is_current and not last and now_s < self._fine_due_s and _are_identical(self._seen, before):
            return None  # most ticks
        record = resume_of(state, self._begun.at(now_s, utc_s))
        difference = difference_between(record, self._stored)
        if last and record != self._stored:
            difference = max(difference, Difference.FINE)  # exact position and time
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
        goal = is_awaited and difference is Difference.GOAL
        return self._bucket.level(now_s) >= (_MIN_TOKENS_ACKNOWLEDGED_GOAL if goal else _MIN_TOKENS[difference])
