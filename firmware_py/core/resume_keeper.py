"""When the resume record is written: at once for what was asked for or decided, and seldom enough for a flash card.

Each write comes out of a bucket. Streams of goals leave most of it to goals that are acknowledged, and those leave
the rest to orders: a stream that goes on for months costs a write in ten seconds, and no operator waits for one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from msgspec.structs import replace

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.core import last_place
from firmware_py.core.resume import NOTHING, Moment, Resume, resume_of, to_bytes
from firmware_py.core.state import State

FINE_INTERVAL_S: Final = 30.0
REFRESH_S: Final = 600.0  # the record is not to be older
BURST, RATE_HZ = 1000.0, 0.1  # writes: so many at once, and in a second in the long run


class Difference(IntEnum):
    """How a record differs from the one kept last, the lesser first."""

    NONE = 0
    FINE = 1  # what changes by itself all the time
    GOAL = 2  # what a companion computer or a stick may change many times a second
    ORDER = 3  # mode, arming, place in the mission, fence


# A write needs so many in the bucket: streams leave some for goals that are acknowledged, and those for orders.
_LEAST: Final[Mapping[Difference, float]] = {Difference.FINE: 900.0, Difference.GOAL: 900.0, Difference.ORDER: 1.0}
_LEAST_FOR_ACKNOWLEDGED_GOAL: Final = 100.0


def difference_between(record: Resume, kept: Resume | None) -> Difference:
    """Return how a record differs from the one that is kept, None when there is none."""
    if kept is not None and _is_fresh(kept, record):
        record = replace(record, utc_s=kept.utc_s, machine_s=kept.machine_s, place=kept.place)
    if record == kept:
        return Difference.NONE
    if kept is None or _orders(record) != _orders(kept):
        return Difference.ORDER
    return Difference.FINE if _without_fine(record) == _without_fine(kept) else Difference.GOAL


def _is_fresh(kept: Resume, record: Resume) -> bool:
    """Whether moment and place of the record that is kept need not be those of now; a clock that was set makes old."""
    if kept.place is None or record.place is None:
        good_for_s = REFRESH_S if kept.place is record.place else 0.0
    else:
        good_for_s = last_place.good_for_s(kept.place, REFRESH_S)
    return max(abs(record.utc_s - kept.utc_s), record.machine_s - kept.machine_s) < good_for_s


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


def _same(parts: tuple[object, ...], others: tuple[object, ...]) -> bool:
    return len(parts) == len(others) and all(part is other for part, other in zip(parts, others, strict=True))


class ResumeKeeper:
    """Decides when the record is written anew, by what was written last and how much was of late."""

    def __init__(self, begun: Moment) -> None:
        """Start with nothing written; `begun` is when the time was 0, of which the calendar is of no matter."""
        self._begun = begun
        self._kept: Resume | None = None
        self._seen: tuple[object, ...] = ()  # what the state looked at last was made of, but for what is fine
        self._fine_due_s = -math.inf
        self._bucket = TokenBucket(BURST, RATE_HZ)
        self.is_current = True  # but for fine changes; or nothing is to be kept

    def update(
        self, state: State, now_s: float, utc_s: float, *, awaited: bool = False, last: bool = False
    ) -> bytes | None:
        """Return the record to be stored now, None while there is nothing to store or no write to spare.

        `awaited`: an acknowledgement waits for it. `last`: nothing comes after it.
        """
        if state.parameters["BOOT_RESUME"] == NOTHING:
            # What lies on disk ages from now on.
            self._kept, self._seen, self.is_current = None, (), True
            return None
        before, self._seen = self._seen, (state.modes, state.guidance, state.plans, state.home)
        if self.is_current and not last and now_s < self._fine_due_s and _same(self._seen, before):
            return None  # most ticks
        record = resume_of(state, self._begun.at(now_s, utc_s))
        difference = difference_between(record, self._kept)
        if last and record != self._kept:
            difference = max(difference, Difference.FINE)  # the place to the last metre, and when
        may_write = last or self._may_write(difference, now_s, awaited=awaited)
        if now_s >= self._fine_due_s:
            self._fine_due_s = now_s + FINE_INTERVAL_S
        self.is_current = difference <= Difference.FINE
        if difference is Difference.NONE or not may_write:
            return None
        self._bucket.spend(1.0)
        self._kept, self.is_current = record, True
        self._fine_due_s = now_s + FINE_INTERVAL_S
        return to_bytes(record)

    def _may_write(self, difference: Difference, now_s: float, *, awaited: bool) -> bool:
        if difference is Difference.NONE or (difference is Difference.FINE and now_s < self._fine_due_s):
            return False
        goal = awaited and difference is Difference.GOAL
        return self._bucket.level(now_s) >= (_LEAST_FOR_ACKNOWLEDGED_GOAL if goal else _LEAST[difference])
