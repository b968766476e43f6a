"""Failsafes: which fault decides the mode, and which mode it is. Pure.

A fault whose parameter chooses a mode calls for that mode while it is set and the boat is armed. It acts in a mode in
which the autopilot steers. In MANUAL only the loss of the ground station acts, and in a HOLD that the operator ordered
none. In a mode that a failsafe chose, every fault acts.

Of the faults that act, the first in the order of precedence decides; the others wait until it has cleared. It takes the
best possible mode of its ladder, and a better one once that becomes possible. A later intent of the operator overrules
all faults that are set; each of them acts again only after it has cleared.
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
    """Inputs of a decision; `overruled`: the operator has decided in this tick."""

    active: int
    mode: Mode
    by_failsafe: bool
    armed: bool
    overruled: bool
    modes: Mapping[Fault, Mode | None]  # of the faults whose parameters choose; None: alert only
    possible: Callable[[Mode], bool]
    resume: bool


class Decision(msgspec.Struct, frozen=True):
    """Mode to enter, whether the interrupted mode resumes, and the events."""

    enter: Mode | None = None
    resume: bool = False
    events: tuple[Event, ...] = ()


NO_DECISION = Decision()

# Faults that may act, as bits, by the source of the rudder command.
_ACTING: Mapping[RudderBy, int] = {
    RudderBy.NOTHING: 0,
    RudderBy.STICK: sum(1 << fault for fault, row in TABLE.items() if row.acts_in_manual),
    RudderBy.HEADING: sum(1 << fault for fault in TABLE),
}


def decide(state: FailsafeState, inputs: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Return the state and the decision of a tick."""
    if not inputs.active and not state.active:
        return state, NO_DECISION
    overruled = inputs.overruled or not inputs.armed or (state.mode is not None and inputs.mode is not state.mode)
    if overruled:
        state = FailsafeState(active=state.active)
    # A fault whose parameter has been set to "alert only" meanwhile no longer calls for a mode.
    modes = {fault: mode for fault, mode in inputs.modes.items() if mode is not None}
    choosable = inputs.active & sum(1 << fault for fault in modes)
    calling = state.calling & choosable
    if inputs.armed:
        calling |= choosable & ~state.active
    state = replace(state, active=inputs.active, calling=calling)
    acting = calling & _ACTING[RudderBy.HEADING if inputs.by_failsafe else MODES[inputs.mode].rudder_by]
    fault = next((fault for fault in PRECEDENCE if acting >> fault & 1), None)
    if fault is None:
        return _end(state, inputs)
    ladder = failsafe_ladder(modes[fault])
    mode = next((mode for mode in ladder if mode is Mode.HOLD or inputs.possible(mode)), Mode.HOLD)
    if state.fault is fault and state.mode in ladder and ladder.index(mode) >= ladder.index(state.mode):
        return state, NO_DECISION
    state = replace(state, fault=fault, mode=mode)
    if mode is inputs.mode:
        return state, NO_DECISION
    impossible = "" if mode is ladder[0] else f", {ladder[0].name} not possible"
    event = Event(TABLE[fault].severity, f"Failsafe: {mode.name}{impossible}")
    return state, Decision(enter=mode, events=(event,))


def _end(state: FailsafeState, inputs: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Resume the interrupted mode, or keep the present one, once no fault calls for a mode."""
    if state.fault is None:
        return state, NO_DECISION
    resumes = inputs.resume or TABLE[state.fault].always_resumes
    state = FailsafeState(active=state.active, calling=state.calling)
    if resumes:
        return state, Decision(resume=True)
    return state, Decision(
        events=(Event(Severity.NOTICE, f"Failsafe ended: {inputs.mode.name} stays until a mode is set"),)
    )
