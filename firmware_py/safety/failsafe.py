"""Which fault decides the mode, and which mode: pure, and the only judge of failsafes.

A fault whose action is a mode acts once, when it is set, and only while the boat is armed and not
in MANUAL or HOLD. The gravest of those that act decides. It takes the best mode of its ladder
that is possible, and a better one once it becomes possible. Any intent of the operator after
that wins: none of the faults that stand acts again before it has gone and come back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from firmware_py.common.records import Event, Mode, Severity
from firmware_py.faults.kinds import LADDERS, Action, Fault
from firmware_py.faults.table import TABLE

LEFT_ALONE = (Mode.MANUAL, Mode.HOLD)


@dataclass(frozen=True, slots=True)
class FailsafeState:
    """The faults of the last tick and those that call for a mode, as bits; the one that decides, and its mode."""

    active: int = 0
    calling: int = 0
    fault: Fault | None = None
    mode: Mode | None = None


@dataclass(frozen=True, slots=True)
class FailsafeInput:
    """What a decision depends on; `overruled`: the operator has decided in this tick."""

    active: int
    mode: Mode
    armed: bool
    overruled: bool
    actions: Mapping[Fault, Action]  # those that parameters choose
    possible: Callable[[Mode], bool]
    resume: bool


@dataclass(frozen=True, slots=True)
class Decision:
    """The mode to enter, or that what was interrupted goes on; and the events."""

    enter: Mode | None = None
    resume: bool = False
    events: tuple[Event, ...] = ()


NOTHING = Decision()


def decide(state: FailsafeState, given: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Judge a tick."""
    if not given.active and not state.active:
        return state, NOTHING
    overruled = given.overruled or not given.armed or (state.mode is not None and given.mode is not state.mode)
    if overruled:
        state = FailsafeState(active=state.active)
    calling = state.calling & given.active
    if given.armed and given.mode not in LEFT_ALONE:
        calling |= _modal(given) & given.active & ~state.active
    state = replace(state, active=given.active, calling=calling)
    if not calling:
        return _ended(state, given)
    row = min((row for row in TABLE if calling >> row.fault & 1), key=lambda row: (row.severity, row.fault))
    ladder = LADDERS[given.actions[row.fault]]
    mode = next((mode for mode in ladder if mode is Mode.HOLD or given.possible(mode)), Mode.HOLD)
    if state.fault is row.fault and state.mode in ladder and ladder.index(mode) >= ladder.index(state.mode):
        return state, NOTHING
    state = replace(state, fault=row.fault, mode=mode)
    if mode is given.mode:
        return state, NOTHING
    lacking = "" if mode is ladder[0] else f", {ladder[0].name} is impossible"
    event = Event(row.severity, f"Failsafe: {mode.name}{lacking}")
    return state, Decision(enter=mode, events=(event,))


def _ended(state: FailsafeState, given: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Go on with what was interrupted, or stay, once nothing calls for a mode any more."""
    if state.fault is None:
        return state, NOTHING
    state = FailsafeState(active=state.active)
    if given.resume:
        return state, Decision(resume=True)
    return state, Decision(events=(Event(Severity.NOTICE, f"Failsafe over: {given.mode.name} stays"),))


def _modal(given: FailsafeInput) -> int:
    """Return the faults whose chosen action is a mode, as bits."""
    return sum(1 << fault for fault, action in given.actions.items() if action in LADDERS)
