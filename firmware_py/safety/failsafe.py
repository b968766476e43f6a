"""Failsafes: select the fault that decides the mode, and that mode. Pure functions.

A fault whose parameter chooses a mode requests that mode while it is active and the boat is armed. It acts in a mode in
which the autopilot steers. In MANUAL only the loss of the ground station acts, and in a HOLD that the operator ordered
no fault acts. In a mode that a failsafe has chosen, every fault acts.

Of the faults that act, the first in the order of precedence decides until it has cleared. It enters the first possible
mode of its ladder (`failsafe_ladder`), and an earlier one of the ladder once that becomes possible. A later intent of
the operator overrules all active faults; each of them acts again only after it has cleared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.mode_table import MODES, Mode, RudderBy, failsafe_ladder
from firmware_py.common.records import Event, Severity
from firmware_py.faults.table import PRECEDENCE, TABLE, Fault


class FailsafeState(msgspec.Struct, frozen=True):
    """Active faults of the last tick and those that request a mode, as bits; the fault that decides, and its mode."""

    active: int = 0
    calling: int = 0
    fault: Fault | None = None
    mode: Mode | None = None


class FailsafeInput(msgspec.Struct, frozen=True):
    """Inputs of a decision; `overruled`: an intent of the operator has overruled the failsafes in this tick."""

    active: int
    mode: Mode
    by_failsafe: bool
    armed: bool
    overruled: bool
    modes: Mapping[Fault, Mode | None]  # by the parameters of the faults; None: alert only
    possible: Callable[[Mode], bool]
    resume: bool


class Decision(msgspec.Struct, frozen=True):
    """Mode to enter, whether the interrupted mode resumes, and the events."""

    enter: Mode | None = None
    resume: bool = False
    events: tuple[Event, ...] = ()


NO_DECISION = Decision()

# Faults that may act, as bits, for each source of the rudder command.
_ACTING: Mapping[RudderBy, int] = {
    RudderBy.NOTHING: 0,
    RudderBy.STICK: sum(1 << fault for fault, row in TABLE.items() if row.acts_in_manual),
    RudderBy.HEADING: sum(1 << fault for fault in TABLE),
}


def decide(state: FailsafeState, inputs: FailsafeInput) -> tuple[FailsafeState, Decision]:
    """Return the state and the decision of a tick."""
    if not inputs.active and not state.active:
        return state, NO_DECISION
    is_overruled = inputs.overruled or not inputs.armed or (state.mode is not None and inputs.mode is not state.mode)
    if is_overruled:
        state = FailsafeState(active=state.active)
    # A fault whose parameter has since been set to "alert only" no longer requests a mode.
    modes = {fault: mode for fault, mode in inputs.modes.items() if mode is not None}
    requestable = inputs.active & sum(1 << fault for fault in modes)
    calling = state.calling & requestable
    if inputs.armed:
        calling |= requestable & ~state.active
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
    """Return the decision if no fault acts: an ended failsafe resumes the interrupted mode or keeps the present one."""
    if state.fault is None:
        return state, NO_DECISION
    has_to_resume = inputs.resume or TABLE[state.fault].always_resumes
    state = FailsafeState(active=state.active, calling=state.calling)
    if has_to_resume:
        return state, Decision(resume=True)
    return state, Decision(
        events=(Event(Severity.NOTICE, f"Failsafe ended: {inputs.mode.name} stays until a mode is set"),)
    )
