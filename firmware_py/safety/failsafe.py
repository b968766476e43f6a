"""Which fault decides the mode, and which mode: pure, and the only judge of failsafes.

A fault for which a mode is chosen calls for it from when it is set until it goes, only while the boat is armed. It acts
in a mode that steers. In MANUAL the operator does, so only the loss of the operator acts there; in a HOLD that was
ordered the boat was told to do nothing. In a mode that a failsafe chose every fault acts: nobody has been asked.
Of those that act the first of the table's order of precedence decides, the others wait until it has gone. It takes the
best mode of its ladder that is possible, and a better one once it becomes possible. Any intent of the operator
after that wins: none of the faults that stand acts again before it has gone and come back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.mode_table import MODES, Mode, RudderBy, failsafe_ladder
from firmware_py.common.records import Event, Severity
from firmware_py.faults.table import PRECEDENCE, TABLE, Fault


class FailsafeState(msgspec.Struct, frozen=True):
    """The faults of the last tick and those that call for a mode, as bits; the one that decides, and its mode."""

    active: int = 0
    calling: int = 0
    fault: Fault | None = None
    mode: Mode | None = None


class FailsafeInput(msgspec.Struct, frozen=True):
    """What a decision depends on; `overruled`: the operator has decided in this tick."""

    active: int
    mode: Mode
    by_failsafe: bool
    armed: bool
    overruled: bool
    modes: Mapping[Fault, Mode | None]  # of the faults whose parameters choose; None: alert only
    possible: Callable[[Mode], bool]
    resume: bool


class Decision(msgspec.Struct, frozen=True):
    """The mode to enter, or that what was interrupted goes on; and the events."""

    enter: Mode | None = None
    resume: bool = False
    events: tuple[Event, ...] = ()


NOTHING = Decision()

# The faults that may act, as bits, by what moves the rudder.
_ACTING: Mapping[RudderBy, int] = {
    RudderBy.NOTHING: 0,
    RudderBy.STICK: sum(1 << fault for fault, row in TABLE.items() if row.acts_in_manual),
    RudderBy.HEADING: sum(1 << fault for fault in TABLE),
}


def decide(state: FailsafeState, given: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Judge a tick."""
    if not given.active and not state.active:
        return state, NOTHING
    overruled = given.overruled or not given.armed or (state.mode is not None and given.mode is not state.mode)
    if overruled:
        state = FailsafeState(active=state.active)
    # A fault whose parameter has been set to "alert only" meanwhile calls for nothing any more.
    modes = {fault: mode for fault, mode in given.modes.items() if mode is not None}
    choosable = given.active & sum(1 << fault for fault in modes)
    calling = state.calling & choosable
    if given.armed:
        calling |= choosable & ~state.active
    state = replace(state, active=given.active, calling=calling)
    acting = calling & _ACTING[RudderBy.HEADING if given.by_failsafe else MODES[given.mode].rudder_by]
    fault = next((fault for fault in PRECEDENCE if acting >> fault & 1), None)
    if fault is None:
        return _end(state, given)
    ladder = failsafe_ladder(modes[fault])
    mode = next((mode for mode in ladder if mode is Mode.HOLD or given.possible(mode)), Mode.HOLD)
    if state.fault is fault and state.mode in ladder and ladder.index(mode) >= ladder.index(state.mode):
        return state, NOTHING
    state = replace(state, fault=fault, mode=mode)
    if mode is given.mode:
        return state, NOTHING
    lacking = "" if mode is ladder[0] else f", {ladder[0].name} is impossible"
    event = Event(TABLE[fault].severity, f"Failsafe: {mode.name}{lacking}")
    return state, Decision(enter=mode, events=(event,))


def _end(state: FailsafeState, given: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Go on with what was interrupted, or stay, once nothing calls for a mode any more."""
    if state.fault is None:
        return state, NOTHING
    resumes = given.resume or TABLE[state.fault].always_resumes
    state = FailsafeState(active=state.active, calling=state.calling)
    if resumes:
        return state, Decision(resume=True)
    return state, Decision(events=(Event(Severity.NOTICE, f"Failsafe over: {given.mode.name} stays"),))
