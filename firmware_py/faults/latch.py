"""Set and clear the faults of the table: debounce time, clear time and events."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from firmware_py.common.records import Event, Severity
from firmware_py.faults.row import FaultInput
from firmware_py.faults.table import TABLE, Fault

_CONDITIONS = tuple(row.is_present for row in TABLE.values())


class LatchState(msgspec.Struct, frozen=True):
    """Since when each condition has been present (None: not present), when it last was, and the faults, as bits."""

    since_s: tuple[float | None, ...] = (None,) * len(TABLE)
    stood_s: tuple[float | None, ...] = (None,) * len(TABLE)
    active: int = 0

    def is_set(self, fault: Fault) -> bool:
        """Return whether a fault is set."""
        return bool(self.active >> fault & 1)


NO_FAULTS = LatchState()


def judge_conditions(tick: FaultInput) -> tuple[bool, ...]:
    """Return whether the condition of each fault is present, in the order of the table."""
    return tuple([is_present(tick) for is_present in _CONDITIONS])


def update(state: LatchState, conditions: Sequence[bool], now_s: float) -> tuple[LatchState, tuple[Event, ...]]:
    """Return the state after a tick, and an event for each fault set or cleared in it.

    `conditions` are in the order of the table.
    """
    if not state.active and not any(conditions):
        return NO_FAULTS, ()
    since: list[float | None] = []
    stood: list[float | None] = []
    active = 0
    events: list[Event] = []
    rows = zip(TABLE.items(), state.since_s, state.stood_s, conditions, strict=True)
    for (fault, row), begun_s, before_s, is_present in rows:
        was_set = state.is_set(fault)
        last_s = now_s if is_present else before_s
        kept = is_present or (was_set and last_s is not None and now_s - last_s < row.clear_s)
        start_s = (now_s if begun_s is None else begun_s) if kept else None
        since.append(start_s)
        stood.append(last_s if kept else None)
        is_set = start_s is not None and (was_set or now_s - start_s >= row.debounce_s)
        active |= is_set << fault
        if is_set and not was_set:
            events.append(Event(row.severity, row.text))
        elif was_set and not is_set:
            events.append(Event(Severity.NOTICE, row.recovery))
    return LatchState(tuple(since), tuple(stood), active), tuple(events)


def arming_refusal(active: int) -> str:
    """Return the reason for which the faults set (as bits) forbid arming; empty if none does."""
    if not active:
        return ""
    return next((row.arming_refusal for fault, row in TABLE.items() if row.arming_refusal and active >> fault & 1), "")
