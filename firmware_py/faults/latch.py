"""Latch of the faults: applies debounce and clear times, and creates the events."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from firmware_py.common.records import Event, Severity
from firmware_py.faults.row import FaultInput
from firmware_py.faults.table import TABLE, Fault

_CONDITIONS = tuple(row.is_present for row in TABLE.values())


class LatchState(msgspec.Struct, frozen=True):
    """Start and last time of each condition (None: neither it nor its fault is present), and the faults as bits."""

    since_s: tuple[float | None, ...] = (None,) * len(TABLE)
    last_present_s: tuple[float | None, ...] = (None,) * len(TABLE)
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
    start_times_s: list[float | None] = []
    last_times_s: list[float | None] = []
    active = 0
    events: list[Event] = []
    rows = zip(TABLE.items(), state.since_s, state.last_present_s, conditions, strict=True)
    for (fault, row), previous_start_s, previous_last_s, is_present in rows:
        was_set = state.is_set(fault)
        last_s = now_s if is_present else previous_last_s
        is_kept = is_present or (was_set and last_s is not None and now_s - last_s < row.clear_s)
        start_s = (now_s if previous_start_s is None else previous_start_s) if is_kept else None
        start_times_s.append(start_s)
        last_times_s.append(last_s if is_kept else None)
        is_set = start_s is not None and (was_set or now_s - start_s >= row.debounce_s)
        active |= is_set << fault
        if is_set and not was_set:
            events.append(Event(row.severity, row.text))
        elif was_set and not is_set:
            events.append(Event(Severity.NOTICE, row.recovery))
    return LatchState(tuple(start_times_s), tuple(last_times_s), active), tuple(events)


def arming_refusal(active: int) -> str:
    """Return the reason for which the faults set (as bits) forbid arming; empty if none does."""
    if not active:
        return ""
    return next((row.arming_refusal for fault, row in TABLE.items() if row.arming_refusal and active >> fault & 1), "")
